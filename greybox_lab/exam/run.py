"""Run of an examination by several processes with many cases each; diagnosed cases are skipped."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Lock
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.files import ensure_writable, held, write_atomically
from greybox_id.base.json_data import without_nan
from greybox_id.fitting.how import Say

from .desk import PEEKED, Desk
from .folder import DIAGNOSIS, TAKEN, case_folders, exam_of


@dataclass(frozen=True)
class Sat:
    """Result of a run.

    Attributes
    ----------
    cases, before : number of cases in the examination, and of those diagnosed by earlier runs.
    diagnosed, failed : by this run, and number of those that ended in an error.
    cpu : CPU seconds of this run's diagnoses.
    """

    cases: int
    before: int
    diagnosed: int
    failed: int
    cpu: float


def run(
    cases: Path, diagnoser: str, jobs: int, timeout: float, say: Say, sample: int | None = None, seed: int = 0
) -> Sat:
    """Diagnose every case without a diagnosis, and write the results to its folder; several runs may share the cases.

    Parameters
    ----------
    cases : folder of cases.
    diagnoser : "module:function" of type `desk.Diagnose`.
    jobs : number of parallel processes.
    timeout : time per case, s; an unfinished case counts as wrong.
    say : called for every case.
    sample, seed : largest number of cases, drawn by a seed; None for all.

    Raises
    ------
    BadInput : if there are no cases, a candidate does not start, or one tried to open a withheld file.
    """
    exam = exam_of(cases)
    folders = case_folders(exam)
    if sample is not None and sample < len(folders):
        drawn = np.random.default_rng((seed, 88007)).choice(len(folders), sample, replace=False)
        folders = [folders[k] for k in sorted(drawn)]
    todo = [folder for folder in folders if not (folder / DIAGNOSIS).is_file()]
    say(f"{len(todo)} of {len(folders)} cases to diagnose")
    stop = Event()
    room = _Room(todo, say)
    with ThreadPoolExecutor(max(1, min(jobs, len(todo)))) as pool:
        desks = [Desk(diagnoser, exam, stop) for _ in range(jobs)]
        sat = [pool.submit(room.sit, desk, timeout, stop) for desk in desks]
        try:
            wait(sat, return_when=FIRST_EXCEPTION)
        finally:  # all are done, one has failed, or the user has interrupted
            stop.set()
            for desk in desks:
                desk.leave()
    for item in sat:
        item.result()
    return Sat(
        cases=len(folders),
        before=len(folders) - len(todo),
        diagnosed=len(room.results),
        failed=sum("error" in body for body in room.results),
        cpu=sum(body["cost"]["cpu_s"] or 0.0 for body in room.results),
    )


class _Room:
    """Cases that wait, and results so far."""

    def __init__(self, todo: Sequence[Path], say: Say) -> None:
        self.results: list[dict[str, Any]] = []
        self._say, self._count = say, len(todo)
        self._one_at_a_time = Lock()
        self._waiting: SimpleQueue[Path] = SimpleQueue()
        for folder in todo:
            self._waiting.put(folder)

    def sit(self, desk: Desk, timeout: float, stop: Event) -> None:
        """Take cases to a desk until there are no more."""
        try:
            while not stop.is_set():
                try:
                    case = self._waiting.get_nowait()
                except Empty:
                    return
                lock = case.parents[1] / TAKEN / case.name
                ensure_writable(lock)
                with ExitStack() as taken:
                    try:
                        taken.enter_context(held(lock))
                    except BadInput:
                        continue  # another run has it
                    if not (case / DIAGNOSIS).is_file() and not self._diagnosed(case, desk, timeout, stop):
                        return
        finally:
            desk.leave()

    def _diagnosed(self, case: Path, desk: Desk, timeout: float, stop: Event) -> bool:
        """Diagnose a case and store the result; returns whether to continue."""
        try:
            kind, body = desk.diagnose(case, timeout)
        except BadInput:
            if stop.is_set():  # which ended its candidate
                return False
            raise
        if kind == PEEKED:
            raise BadInput(f"{body} The run has stopped; {case.name} is not diagnosed.")
        if not stop.is_set():
            self._keep(case, body)
        return True

    def _keep(self, case: Path, body: dict[str, Any]) -> None:
        write_atomically(case / DIAGNOSIS, json.dumps(without_nan(body), indent=1) + "\n")
        with self._one_at_a_time:
            self.results.append(body)
            self._say(f"{len(self.results)}/{self._count} {case.name}: {_sentence(body)}", passing="error" not in body)


def _sentence(body: dict[str, Any]) -> str:
    if "error" in body:
        return str(body["error"])
    result = body["ranking"][0]["effect"] if body.get("gap_detected") and body.get("ranking") else "no gap"
    return f"{result}, {body['cost']['cpu_s']:.1f} CPU s"
