"""Worker process of a candidate, which diagnoses one case after the other and is replaced if it is lost.

It receives the folder of a case and returns the outcome; importing and compiling happen once. Within the examination it
may open nothing but the case that it received.
"""

from __future__ import annotations

import os
import resource
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from threading import Event
from time import perf_counter
from typing import Any

from threadpoolctl import threadpool_limits

from greybox_id.base.contained.inside import located
from greybox_id.base.contained.process import TIME, Broken, Contained, Failed, Lost
from greybox_id.base.errors import BadInput, GreyboxError

LOOKS = ("open", "os.listdir", "os.scandir", "os.chdir", "os.rename", "os.link", "os.symlink", "shutil.copyfile")
"""Audit events whose arguments are paths that are read, or may be read afterwards."""


class Peeked(BaseException):
    """A withheld file of the examination was opened; not an `Exception`, so that no ordinary handler catches it."""


class Confinement:
    """Restricts what a process may open of an examination; it cannot be removed.

    Parameters
    ----------
    exam : folder of the examination.

    Attributes
    ----------
    peeked : message on the first refused access; "" if there was none.
    """

    def __init__(self, exam: Path) -> None:
        self.peeked = ""
        self._inside = os.path.realpath(exam)
        self._case = ""
        sys.addaudithook(self._hook)

    def hand_out(self, case: Path) -> None:
        """Allow one case instead of the previous one."""
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
            self.peeked = self.peeked or f"The diagnosis tried to open {path}, which was not given to it."
            raise Peeked(self.peeked)


def _within(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder + os.sep)


DONE, FAILED, PEEKED = "done", "failed", "peeked"
"""Outcome of a case: (DONE, diagnosis); (FAILED or PEEKED, message)."""

Diagnose = Callable[[Path], dict[str, Any]]
"""Folder of a case -> diagnosis as plain data; may write closed.toml to the folder."""


class ExamCandidate:
    """The examined diagnosis, in a process of its own.

    Parameters
    ----------
    diagnoser : "module:function" of type `Diagnose`.
    exam : folder of the examination, of which only the current case may be opened.
    """

    def __init__(self, diagnoser: str, exam: str) -> None:
        os.chdir("/")  # the working directory may be in the examination
        threadpool_limits(1)  # one core per candidate
        self._confinement = Confinement(Path(exam))
        self._diagnose: Diagnose = located(diagnoser)

    def ready(self) -> bool:
        """Return once the candidate is ready for a case."""
        return True

    def diagnose(self, case: str) -> tuple[str, Any]:
        """Outcome of a case."""
        self._confinement.hand_out(Path(case))
        result = _diagnosed(self._diagnose, Path(case))
        return (PEEKED, self._confinement.peeked) if self._confinement.peeked else result


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
    """CPU time of this process and of finished child processes, such as a compiler, s."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(item.ru_utime + item.ru_stime for item in spent)


STARTING = 300.0
"""Longest time for a worker to import, s."""


class Desk:
    """Runs one candidate at a time.

    Parameters
    ----------
    diagnoser : "module:function" of type `Diagnose`.
    exam : folder of the examination.
    stop : set before `leave` is called to end the run.
    """

    def __init__(self, diagnoser: str, exam: Path, stop: Event) -> None:
        self._diagnoser, self._exam, self._stop = diagnoser, exam, stop
        self._candidate: Contained | None = None

    def diagnose(self, case: Path, timeout: float) -> tuple[str, Any]:
        """The candidate's outcome for a case; a message if it is lost or takes too long.

        Raises
        ------
        BadInput : if no candidate starts.
        """
        candidate = self._seated()
        try:
            kind, body = candidate.ask("diagnose", str(case), patience=timeout)[0]
        except Failed as error:
            return FAILED, _lost(f"The diagnosis is no plain data: {error}.", None)
        except Lost as error:
            self.leave()
            if error.how == TIME:
                return FAILED, _lost(f"Stopped after {timeout:g} s.", timeout)
            return FAILED, _lost(f"The process ended with {error.how}.", None)
        return kind, body

    def leave(self) -> None:
        """End the candidate's process; may be called from any thread."""
        candidate, self._candidate = self._candidate, None
        if candidate is not None:
            candidate.close()

    def _seated(self) -> Contained:
        """A candidate that is ready for a case."""
        if self._candidate is not None:
            return self._candidate
        try:
            self._candidate = candidate = Contained(
                "greybox_lab.exam.desk:ExamCandidate", self._diagnoser, str(self._exam), heard=True
            )
            if self._stop.is_set():  # during its start
                self.leave()
            candidate.ask("ready", patience=STARTING)
        except (Broken, Failed, Lost) as error:
            self.leave()
            raise BadInput(f"A process for {self._diagnoser} does not start: {error}.") from error
        return candidate


def _lost(sentence: str, spent: float | None) -> dict[str, Any]:
    """Replaces a diagnosis; a candidate that was stopped has used all its time."""
    return {"error": sentence, "cost": {"cpu_s": spent, "wall_s": spent}}
