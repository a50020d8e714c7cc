"""Where a candidate sits: a process that is handed one case after the other, and replaced when it is lost.

It hears the folder of a case and says what came of it; importing and compiling are done once. It may open nothing of an
examination but the case that it was handed.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Event
from time import perf_counter
from typing import Any

from threadpoolctl import threadpool_limits

from ..errors import BadInput, GreyboxError

LOOKS = ("open", "os.listdir", "os.scandir", "os.chdir", "os.rename", "os.link", "os.symlink", "shutil.copyfile")
"""Audit events whose arguments are paths that are read or may be read afterwards."""


class Peeked(BaseException):
    """Something of the examination was opened that was not handed out; no handler of ordinary errors holds it up."""


class Confinement:
    """What a process may open of an examination; once laid on it cannot be taken off.

    Parameters
    ----------
    exam : folder of the examination.

    Attributes
    ----------
    peeked : sentence on the first thing that was refused; "" as long as nothing was.
    """

    def __init__(self, exam: Path) -> None:
        self.peeked = ""
        self._inside = os.path.realpath(exam)
        self._case = ""
        sys.addaudithook(self._hook)

    def hand_out(self, case: Path) -> None:
        """Allow one case, instead of the one before."""
        self._case = os.path.realpath(case)

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event in LOOKS:
            paths = arguments[: 2 if event not in ("open", "os.listdir", "os.scandir", "os.chdir") else 1]
        elif event == "subprocess.Popen":
            paths = tuple(word for word in arguments[1] or () if self._inside in str(word))
        else:
            return
        for path in paths:
            if isinstance(path, (str, bytes, os.PathLike)):
                self._judge(os.path.realpath(os.fsdecode(path)))

    def _judge(self, path: str) -> None:
        if _within(path, self._inside) and not (self._case and _within(path, self._case)):
            self.peeked = self.peeked or f"The candidate tried to open {path}, which was not handed out."
            raise Peeked(self.peeked)


def _within(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder + os.sep)


READY, DONE, FAILED, PEEKED = "ready", "done", "failed", "peeked"
"""What a worker says: it waits for a case; (DONE, diagnosis); (FAILED or PEEKED, sentence)."""

Diagnose = Callable[[Path], dict[str, Any]]
"""Folder of a case -> diagnosis as plain data; it may leave closed.toml in the folder."""


def serve(ear: Connection, diagnoser: str, exam: str) -> None:
    """Diagnose the cases that are named until None is.

    Parameters
    ----------
    ear : names come and results go here.
    diagnoser : "module:function" of type `Diagnose`.
    exam : folder of the examination, of which nothing but the case at hand may be opened.
    """
    os.dup2(2, 1)  # standard output is the parent's
    sys.stdout = sys.stderr
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupted run ends its workers itself
    os.chdir("/")  # the working directory may lie in the examination
    confinement = Confinement(Path(exam))
    module, _, name = diagnoser.partition(":")
    diagnose: Diagnose = getattr(import_module(module), name)
    ear.send((READY, None))
    with threadpool_limits(1):
        while (case := ear.recv()) is not None:
            confinement.hand_out(Path(case))
            result = _diagnosed(diagnose, Path(case))
            ear.send((PEEKED, confinement.peeked) if confinement.peeked else result)


def _diagnosed(diagnose: Diagnose, case: Path) -> tuple[str, Any]:
    began, cpu = perf_counter(), cpu_seconds()
    try:
        body = dict(diagnose(case))
    except Peeked as error:
        return PEEKED, str(error)
    except GreyboxError as error:
        return FAILED, _cost({"error": str(error)}, began, cpu)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        sentence = f"{type(error).__name__} in {Path(where.filename).name}, line {where.lineno}: {error}"
        return FAILED, _cost({"error": sentence}, began, cpu)
    return DONE, _cost(body, began, cpu)


def _cost(body: dict[str, Any], began: float, cpu: float) -> dict[str, Any]:
    return body | {"cost": {"cpu_s": cpu_seconds() - cpu, "wall_s": perf_counter() - began}}


def cpu_seconds() -> float:
    """CPU time of this process and of those it has waited for, such as a compiler, s."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(own.ru_utime + own.ru_stime for own in spent)


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
