"""Ctrl-C where Python or CasADi would swallow it: it comes again a moment later."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SOON = 0.01
"""Seconds after which an interrupt that would have been lost is tried again."""


def interrupt(frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, or do so a moment later where it would be lost.

    Interrupts that reach Python while CasADi calls it, to convert arguments, or while an object is cleared away, are
    swallowed there. While a solver of CasADi's runs they are taken for a wish to stop.

    Parameters
    ----------
    frame : where the signal came.
    """
    if hasattr(signal, "setitimer") and _would_be_lost(frame):
        _interrupt_soon()
        return
    raise KeyboardInterrupt


@contextmanager
def interrupts_return() -> Iterator[None]:
    """Meanwhile, an interrupt raised where exceptions end unheard comes again a moment later.

    Such places are callbacks of weak references: the interpreter's imports have some.
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
