"""A process that diagnoses one case after the other and sees nothing of an examination but the case at hand.

It hears the folder of a case and says what came of it; importing and compiling are done once.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter
from typing import Any

from threadpoolctl import threadpool_limits

from ..errors import GreyboxError
from .confinement import Confinement, Peeked

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
