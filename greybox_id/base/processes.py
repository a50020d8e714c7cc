"""The same work on many things, in processes side by side.

Processes are forked: they begin with all that this one holds (models are functions, which cannot be sent), and send
back plain results. Where a system does not fork safely, work is done here, one thing after the other.
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

if TYPE_CHECKING:  # who forks nothing waits for none of this: a fifth of what greybox --help takes
    from concurrent.futures import Future, ProcessPoolExecutor

Result = TypeVar("Result")
FORKS = sys.platform.startswith("linux")
"""Whether processes can be forked; elsewhere libraries of the system forbid it."""

INTERRUPTS = (signal.SIGINT, signal.SIGALRM) if FORKS else ()
"""What Ctrl-C sends, at first and where it would have been lost."""

_child: dict[str, Any] = {"work": None, "working": False, "stopped": False}
"""What a forked process does, whether it is at it, and whether it is to begin nothing more."""


@dataclass
class Done(Generic[Result]):
    """What was done.

    Attributes
    ----------
    by_number : number -> result.
    interrupted : whether Ctrl-C ended it before everything was done.
    cpu_seconds : of other processes.
    """

    by_number: dict[int, Result] = field(default_factory=dict)
    interrupted: bool = False
    cpu_seconds: float = 0.0

    @property
    def results(self) -> list[Result]:
        """Results in the order of their numbers."""
        return [self.by_number[number] for number in sorted(self.by_number)]


def apart(count: int, jobs: int) -> bool:
    """Whether so many pieces of work are done in other processes."""
    return FORKS and min(count, jobs) > 1


def side_by_side(
    work: Callable[[int], Result], count: int, jobs: int, report: Callable[[int, Result], bool] | None = None
) -> Done[Result]:
    """Do the same work for every number from 0.

    Ctrl-C reaches those at work as KeyboardInterrupt, once; what they then hand in is kept.

    Parameters
    ----------
    work : number -> result, which is sent between processes where they are `apart`; there it is to print nothing.
    count : of numbers.
    jobs : processes at a time; 1 does everything here, in order.
    report : is handed every result as it comes; False ends it.

    Raises
    ------
    KeyboardInterrupt : before anything was done.
    GreyboxError : one of the processes was ended from outside.
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
    """The result of some work, done by a process of its own that Ctrl-C ends at once, whatever library is at work.

    In threads beside the main one, which Ctrl-C does not reach, it is done here: a lock of a library that another
    thread holds while a process is forked stays locked in that process for ever.

    Parameters
    ----------
    work : its result, or the exception it ends with, is sent between processes.
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
    done, result = pickle.loads(handed)  # of this process's own child, through a pipe nobody else has
    if not done:
        raise result
    return cast(Result, result)


def _hand_in(work: Callable[[], Any], writing: int) -> None:
    """Do the work in a process of its own, and end it."""
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
    """Meanwhile, interrupts wait: one that came between fork and list would leave a process nobody knows of."""
    if threading.current_thread() is not threading.main_thread():  # it gets none
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
    """Begin nothing more, and interrupt those at work."""
    from multiprocessing import active_children

    pool.shutdown(wait=False, cancel_futures=True)
    for child in active_children():
        os.kill(int(child.pid or 0), signal.SIGUSR1)


def _begin(work: Callable[[int], Any]) -> None:
    _child["work"] = work
    os.environ["GREYBOX_THREADS"] = "1"  # others work beside
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to everyone; the one who began passes it on
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
        _child["working"] = True  # from here on an interrupt is raised; one that came before was noted
        if _child["stopped"]:  # what was handed out already cannot be taken back
            raise KeyboardInterrupt
        with interrupts_return():
            return _child["work"](number), time.process_time() - clock
    finally:
        _child["working"] = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)  # what was to be interrupted has ended


class Pace:
    """How long a number of like pieces of work are still going to take, by those that are done."""

    def __init__(self, pieces: int) -> None:
        self._pieces, self._began = pieces, time.monotonic()

    def left(self, done: int) -> str:
        """In words, with a comma before them; empty where nothing is known yet."""
        if not 0 < done < self._pieces:
            return ""
        seconds = (time.monotonic() - self._began) / done * (self._pieces - done)
        return f", about {duration(seconds)} left"


def duration(seconds: float) -> str:
    """Seconds in words: 99 s, 3 min 05 s."""
    whole = round(seconds)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min {whole % 60:02d} s"
