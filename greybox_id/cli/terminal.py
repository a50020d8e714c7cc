"""Output to a terminal, without control characters from names of files, columns or units."""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, TextIO, cast

import click

from ..base.interrupts import interrupt, interrupts_return
from ..reports.words import ORDERS, clean

__all__ = ["OutputFailed", "clean", "clean_json", "drop_output", "interrupts", "streams", "tell"]


def clean_json(text: str) -> str:
    """The same JSON with control characters escaped."""
    return ORDERS.sub(lambda item: f"\\u{ord(item[0]):04x}", text)


def tell(line: str) -> None:
    """Print a line on standard error."""
    click.echo(clean(line), err=True)


@contextmanager
def streams() -> Iterator[None]:
    """Open missing standard streams, and print warnings of the toolbox on standard error as sentences."""
    _opened()
    logger, handler = logging.getLogger("greybox_id"), _StandardError()
    logger.addHandler(handler)
    logger.propagate = False
    level = logger.level
    logger.setLevel(logging.INFO)
    before, sys.stdout = sys.stdout, cast(TextIO, _Output(sys.stdout))
    try:
        yield
    finally:
        sys.stdout = before
        logger.removeHandler(handler)
        logger.propagate = True
        logger.setLevel(level)


@contextmanager
def interrupts() -> Iterator[list[int]]:
    """Record the signals of Ctrl-C, and raise each as `KeyboardInterrupt`.

    Commands that keep partial results end as usual; the recorded signals show that they were interrupted. If interrupts
    are ignored, as in the background of a shell, they remain ignored.
    """
    sent: list[int] = []

    def take(number: int, frame: FrameType | None) -> None:
        sent.append(number)
        interrupt(frame)

    heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not heeded or threading.current_thread() is not threading.main_thread():
        yield sent
        return
    signal.signal(signal.SIGINT, take)
    try:
        with interrupts_return():
            yield sent
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)


class OutputFailed(Exception):
    """Standard output cannot be written; `reason` is the system's error."""

    def __init__(self, reason: OSError) -> None:
        super().__init__(str(reason))
        self.reason = reason


class _Output:
    """Standard output with errors of its own kind, to distinguish them from those of other files."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError as error:
            raise OutputFailed(error) from error

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            raise OutputFailed(error) from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def drop_output() -> None:
    """Redirect standard output to nothing, so that the interpreter does not fail on it at exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _StandardError(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        tell(f"warning: {record.getMessage()}" if record.levelno >= logging.WARNING else record.getMessage())


def _opened() -> None:
    """Open closed standard streams as null device; otherwise files opened next would take their place."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            with suppress(OSError):
                os.fstat(number)
                continue
            handle = os.open(os.devnull, os.O_RDWR)
            if handle != number:
                os.dup2(handle, number)
                os.close(handle)
            stream = open(number, "r" if number == 0 else "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
