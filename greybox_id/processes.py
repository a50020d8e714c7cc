"""The same work on many things, in processes side by side.

Processes are forked: they begin with all that this one holds (models are functions, which cannot be sent), and send
back plain results. Where a system does not fork safely, work is done here, one thing after the other.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import active_children, get_context
from typing import Any, Generic, TypeVar

Result = TypeVar("Result")
FORKS = sys.platform.startswith("linux")
"""Whether processes can be forked; elsewhere libraries of the system forbid it."""

_child: dict[str, Any] = {"work": None, "working": False, "stopped": False}
"""What a forked process does, whether it is at it, and whether it is to begin nothing more."""


@dataclass
class Done(Generic[Result]):
    """What was done.

    Attributes
    ----------
    found : number -> result.
    interrupted : whether Ctrl-C ended it before everything was done.
    cpu_seconds : of other processes.
    """

    found: dict[int, Result] = field(default_factory=dict)
    interrupted: bool = False
    cpu_seconds: float = 0.0

    @property
    def results(self) -> list[Result]:
        """Results in the order of their numbers."""
        return [self.found[number] for number in sorted(self.found)]


def apart(count: int, jobs: int) -> bool:
    """Whether so many pieces of work are done in other processes."""
    return FORKS and min(count, jobs) > 1


def side_by_side(
    work: Callable[[int], Result], count: int, jobs: int, told: Callable[[int, Result], bool] | None = None
) -> Done[Result]:
    """Do the same work for every number from 0.

    Ctrl-C reaches those at work as KeyboardInterrupt, once; what they then hand in is kept.

    Parameters
    ----------
    work : number -> result, which is sent between processes where they are `apart`; there it is to print nothing.
    count : of numbers.
    jobs : processes at a time; 1 does everything here, in order.
    told : is handed every result as it comes; False ends it.

    Raises
    ------
    KeyboardInterrupt : before anything was done.
    """
    done: Done[Result] = Done()
    if apart(count, jobs):
        _forked(done, work, count, jobs, told)
    else:
        _here(done, work, count, told)
    if done.interrupted and not done.found:
        raise KeyboardInterrupt
    return done


def _here(
    done: Done[Result], work: Callable[[int], Result], count: int, told: Callable[[int, Result], bool] | None
) -> None:
    try:
        for number in range(count):
            done.found[number] = work(number)
            if told is not None and not told(number, done.found[number]):
                break
    except KeyboardInterrupt:
        done.interrupted = True


def _forked(
    done: Done[Result], work: Callable[[int], Result], count: int, jobs: int, told: Callable[[int, Result], bool] | None
) -> None:
    context = get_context("fork")
    with ProcessPoolExecutor(min(jobs, count), mp_context=context, initializer=_begin, initargs=(work,)) as pool:
        waiting = {pool.submit(_do, number): number for number in range(count)}
        try:
            for own in as_completed(waiting):
                number = waiting[own]
                _take(done, number, own)
                if told is not None and not told(number, done.found[number]):
                    _stop(pool)
                    break
        except KeyboardInterrupt:
            done.interrupted = True
            _stop(pool)
        for late, number in waiting.items():
            if number not in done.found and not late.cancelled():
                try:
                    _take(done, number, late)
                except (BrokenProcessPool, KeyboardInterrupt):
                    done.interrupted = True


def _take(done: Done[Result], number: int, own: Future[tuple[Result, float]]) -> None:
    result, seconds = own.result()
    done.found[number] = result
    done.cpu_seconds += seconds


def _stop(pool: ProcessPoolExecutor) -> None:
    """Begin nothing more, and interrupt those at work."""
    pool.shutdown(wait=False, cancel_futures=True)
    for child in active_children():
        os.kill(int(child.pid or 0), signal.SIGUSR1)


def _begin(work: Callable[[int], Any]) -> None:
    _child["work"] = work
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to everyone; the one who began passes it on
    signal.signal(signal.SIGUSR1, _interrupted)


def _interrupted(*_: object) -> None:
    _child["stopped"] = True
    if _child["working"]:
        _child["working"] = False
        raise KeyboardInterrupt


def _do(number: int) -> tuple[Any, float]:
    if _child["stopped"]:  # what was handed out already cannot be taken back
        raise KeyboardInterrupt
    clock, _child["working"] = time.process_time(), True
    try:
        return _child["work"](number), time.process_time() - clock
    finally:
        _child["working"] = False
