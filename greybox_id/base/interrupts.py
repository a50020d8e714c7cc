"""Ctrl-C where Python or CasADi would swallow it: the interrupt is raised again a moment later."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SOON = 0.01
"""Seconds after which an interrupt that would have been lost is raised again."""


def interrupt(frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, or do so a moment later where it would be lost.

    An exception raised while CasADi calls Python (to convert arguments) or in a `__del__` method is swallowed there.
    While a CasADi solver runs, CasADi handles the interrupt itself and stops the solver.

    Parameters
    ----------
    frame : stack frame in which the signal arrived.
    """
    if hasattr(signal, "setitimer") and _would_be_lost(frame):
        _interrupt_soon()
        return
    raise KeyboardInterrupt


@contextmanager
def interrupts_return() -> Iterator[None]:
    """Within the context, an interrupt raised where Python discards exceptions is raised again a moment later.

    Python discards exceptions in callbacks of weak references; the import system has some.
    """
    heard = sys.unraisablehook

    def hear(raised: Any) -> None:
        if issubclass(raised.exc_type, KeyboardInterrupt) and hasattr(signal, "setitimer"):
            _interrupt_soon()
        else:
            heard(raised)

    sys.unraisablehook = hear
    try:
        yield
    finally:
        sys.unraisablehook = heard


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Within the context, Ctrl-C waits until its end: results of long work are written whole."""
    handler, came = signal.getsignal(signal.SIGINT), list[int]()
    if not callable(handler) or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
    if came:
        handler(came[0], None)


def _interrupt_soon() -> None:
    signal.signal(signal.SIGALRM, lambda _, frame: interrupt(frame))
    signal.setitimer(signal.ITIMER_REAL, SOON)


def _would_be_lost(frame: FrameType | None) -> bool:
    if frame is not None and _of_casadi(frame) and frame.f_code.co_name in ("call", "__call__"):
        return False
    while frame is not None:
        if _of_casadi(frame) or frame.f_code.co_name == "__del__":
            return True
        frame = frame.f_back
    return False


def _of_casadi(frame: FrameType) -> bool:
    return frame.f_globals.get("__name__") == "casadi.casadi"
