"""The same work on many items in parallel processes.

Processes are forked: they inherit all objects of this one (models are functions, which cannot be pickled), and return
plain results. On systems that do not fork safely, this process does the work, one item after the other.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from .errors import GreyboxError
from .interrupts import interrupt, interrupts_return

if TYPE_CHECKING:  # imported only when needed: it would be a fifth of the time of greybox --help
    from concurrent.futures import Future, ProcessPoolExecutor

Result = TypeVar("Result")
FORKS = sys.platform.startswith("linux")
"""Whether processes can be forked: system libraries of other platforms forbid it."""

INTERRUPTS = (signal.SIGINT, signal.SIGALRM) if FORKS else ()
"""Signals of Ctrl-C: the first one, and that of a repeated interrupt (see `interrupts`)."""

_child: dict[str, Any] = {"work": None, "working": False, "stopped": False}
"""State of a forked process: its work, whether it is doing an item, and whether it must not begin another one."""


@dataclass
class Done(Generic[Result]):
    """Results of the items done.

    Attributes
    ----------
    by_number : number of the item -> result.
    interrupted : whether Ctrl-C ended the work before all items were done.
    cpu_seconds : CPU time of the other processes.
    """

    by_number: dict[int, Result] = field(default_factory=dict)
    interrupted: bool = False
    cpu_seconds: float = 0.0

    @property
    def results(self) -> list[Result]:
        """Results in the order of the items."""
        return [self.by_number[number] for number in sorted(self.by_number)]


def apart(count: int, jobs: int) -> bool:
    """Whether `count` items are done in other processes."""
    return FORKS and min(count, jobs) > 1


def side_by_side(
    work: Callable[[int], Result], count: int, jobs: int, report: Callable[[int, Result], bool] | None = None
) -> Done[Result]:
    """Do the same work for items 0 to count - 1.

    Ctrl-C raises KeyboardInterrupt once in each working process; results that these then return are kept.

    Parameters
    ----------
    work : number of the item -> result, pickled if the items are `apart`; it must then print nothing.
    count : number of items.
    jobs : number of parallel processes; with 1, this process does all items in order.
    report : called with every number and result as it arrives; returning False ends the work.

    Raises
    ------
    KeyboardInterrupt : interrupted before any item was done.
    GreyboxError : one of the processes was killed from outside.
    """
    done: Done[Result] = Done()
    if apart(count, jobs):
        _forked(done, work, count, jobs, report)
    else:
        _here(done, work, count, report)
    if done.interrupted and not done.by_number:
        raise KeyboardInterrupt
    return done


def elsewhere(work: Callable[[], Result]) -> Result:
    """The result of work done in a forked process, which Ctrl-C ends at once, whatever library is running.

    In threads other than the main one, which Ctrl-C does not reach, the work is done without forking: a library's lock
    that another thread holds during the fork would remain locked in the child for ever.

    Parameters
    ----------
    work : its result, or the exception it raises, is pickled.
    """
    if not FORKS or threading.current_thread() is not threading.main_thread():
        return work()
    import pickle

    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        _hand_in(work, writing)
    os.close(writing)
    try:
        with os.fdopen(reading, "rb") as pipe:
            handed = pipe.read()
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        os.waitpid(child, 0)
    if not handed:  # it was killed
        return work()
    done, result = pickle.loads(handed)  # safe: from this process's child, through a private pipe
    if not done:
        raise result
    return cast(Result, result)


def _hand_in(work: Callable[[], Any], writing: int) -> None:
    """In the forked process: do the work, send its result and exit."""
    import pickle

    try:
        for number in (signal.SIGINT, signal.SIGUSR1):
            signal.signal(number, signal.SIG_DFL)
        try:
            result = pickle.dumps((True, work()))
        except Exception as error:
            result = pickle.dumps((False, error))
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(result)
    finally:
        os._exit(0)


def _here(
    done: Done[Result], work: Callable[[int], Result], count: int, report: Callable[[int, Result], bool] | None
) -> None:
    try:
        for number in range(count):
            done.by_number[number] = work(number)
            if report is not None and not report(number, done.by_number[number]):
                break
    except KeyboardInterrupt:
        done.interrupted = True


def _forked(
    done: Done[Result],
    work: Callable[[int], Result],
    count: int,
    jobs: int,
    report: Callable[[int, Result], bool] | None,
) -> None:
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from concurrent.futures.process import BrokenProcessPool
    from multiprocessing import get_context

    context = get_context("fork")
    with ProcessPoolExecutor(min(jobs, count), mp_context=context, initializer=_begin, initargs=(work,)) as pool:
        waiting: dict[Future[tuple[Result, float]], int] = {}
        try:
            with _waiting():
                for number in range(count):
                    waiting[pool.submit(_do, number)] = number
            for item in as_completed(waiting):
                number = waiting[item]
                _take(done, number, item)
                if report is not None and not report(number, done.by_number[number]):
                    _stop(pool)
                    break
        except KeyboardInterrupt:
            done.interrupted = True
            _stop(pool)
        except BrokenProcessPool as error:
            raise GreyboxError(
                "A worker process was killed, probably because memory ran out; use fewer ‹jobs›."
            ) from error
        for late, number in waiting.items():
            if number not in done.by_number and not late.cancelled():
                try:
                    _take(done, number, late)
                except (BrokenProcessPool, KeyboardInterrupt):
                    done.interrupted = True


@contextmanager
def _waiting() -> Iterator[None]:
    """Defer interrupts within the context: one between fork and registration would leave an unregistered process."""
    if threading.current_thread() is not threading.main_thread():  # other threads receive no signals
        yield
        return
    came: list[int] = []
    before = {number: signal.signal(number, lambda number, _: came.append(number)) for number in INTERRUPTS}
    try:
        yield
    finally:
        for number, heard in before.items():
            signal.signal(number, heard)
        for first in came[:1]:
            signal.raise_signal(first)


def _take(done: Done[Result], number: int, future: Future[tuple[Result, float]]) -> None:
    result, seconds = future.result()
    done.by_number[number] = result
    done.cpu_seconds += seconds


def _stop(pool: ProcessPoolExecutor) -> None:
    """Begin no further item, and interrupt the working processes."""
    from multiprocessing import active_children

    pool.shutdown(wait=False, cancel_futures=True)
    for child in active_children():
        os.kill(int(child.pid or 0), signal.SIGUSR1)


def _begin(work: Callable[[int], Any]) -> None:
    _child["work"] = work
    os.environ["GREYBOX_THREADS"] = "1"  # the processes already use the cores
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes; the parent passes it on
    signal.signal(signal.SIGUSR1, _interrupted)


def _interrupted(number: int, frame: FrameType | None) -> None:
    del number
    _child["stopped"] = True
    if _child["working"]:
        _child["working"] = False
        interrupt(frame)


def _do(number: int) -> tuple[Any, float]:
    clock = time.process_time()
    try:
        _child["working"] = True  # from here on interrupts are raised; an earlier one has set "stopped"
        if _child["stopped"]:  # items already queued in this process cannot be cancelled
            raise KeyboardInterrupt
        with interrupts_return():
            return _child["work"](number), time.process_time() - clock
    finally:
        _child["working"] = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)  # cancel a repeated interrupt: its item has ended


class Pace:
    """Remaining time of a number of similar items, extrapolated from those done."""

    def __init__(self, pieces: int) -> None:
        self._pieces, self._began = pieces, time.monotonic()

    def left(self, done: int) -> str:
        """The remaining time in words, after a comma; empty before the first and after the last item."""
        if not 0 < done < self._pieces:
            return ""
        seconds = (time.monotonic() - self._began) / done * (self._pieces - done)
        return f", about {duration(seconds)} left"


def duration(seconds: float) -> str:
    """Seconds in words: 99 s, 3 min 05 s."""
    whole = round(seconds)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min {whole % 60:02d} s"
