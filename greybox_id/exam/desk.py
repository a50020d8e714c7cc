"""Where a candidate sits: a process that is handed one case after the other, and replaced when it is lost."""

from __future__ import annotations

from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Event
from typing import Any

from ..errors import BadInput
from .worker import FAILED, READY, serve

STARTING = 300.0
"""Longest that a worker may take to import, s."""
_LOOK = 0.2
"""How often a wait looks whether it is still wanted, s."""


class Desk:
    """One worker process at a time.

    Parameters
    ----------
    diagnoser : "module:function"; see `worker.Diagnose`.
    exam : folder of the examination.
    stop : set when nothing more is wanted.
    """

    def __init__(self, diagnoser: str, exam: Path, stop: Event) -> None:
        self._diagnoser, self._exam, self._stop = diagnoser, exam, stop
        self._process: BaseProcess | None = None
        self._ear: Connection

    def diagnose(self, case: Path, timeout: float) -> tuple[str, Any]:
        """What the worker says of a case; a sentence where it is lost or takes too long.

        Raises
        ------
        BadInput : no worker can be had.
        """
        process = self._seated()
        try:
            self._ear.send(str(case))
            said = self._heard(timeout)
        except (EOFError, OSError):  # it is gone
            process.join(STARTING)
            self.leave()
            return FAILED, _lost(f"The process ended with code {process.exitcode}.", None)
        if said is None:
            self.leave()
            return FAILED, _lost(f"Stopped after {timeout:g} s.", timeout)
        return said

    def leave(self) -> None:
        """End the worker."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._ear.close()
            self._process = None

    def _seated(self) -> BaseProcess:
        """A worker that waits for a case."""
        if self._process is not None:
            return self._process
        context = get_context("spawn")
        self._ear, theirs = context.Pipe()
        self._process = process = context.Process(target=serve, args=(theirs, self._diagnoser, str(self._exam)))
        process.start()
        theirs.close()
        try:
            said = self._heard(STARTING)
        except (EOFError, OSError):
            said = None
        if not self._stop.is_set() and (said is None or said[0] != READY):
            self.leave()
            raise BadInput(f"A process for {self._diagnoser} does not start; what it said stands above.")
        return process

    def _heard(self, patience: float) -> tuple[str, Any] | None:
        """What is said next; None where nothing is within so many seconds."""
        waited = 0.0
        while not self._ear.poll(min(_LOOK, patience - waited)):
            waited += _LOOK
            if waited >= patience or self._stop.is_set():
                return None
        said: tuple[str, Any] = self._ear.recv()
        return said


def _lost(sentence: str, spent: float | None) -> dict[str, Any]:
    """What stands in place of a diagnosis; a worker that had to be stopped has spent all its time."""
    return {"error": sentence, "cost": {"cpu_s": spent, "wall_s": spent}}
