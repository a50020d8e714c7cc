"""Making of an examination: cases to hand out and sealed answers."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from greybox_id.base.errors import BadInput
from greybox_id.base.files import ensure_writable, replacing, write_atomically
from greybox_id.base.json_data import read_json
from greybox_id.base.processes import side_by_side
from greybox_id.base.signals import SIGNALS
from greybox_id.base.version import __version__
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import Say

from ..virtual.virtual_vehicle import EFFECTS, OUTSIDE
from .answers import Answer, Tier, read_answer, write_answer
from .folder import CASES, COLUMNS, SEALED, UNFINISHED, seal
from .plan import Counts, Planned, plan
from .world import made


@dataclass(frozen=True)
class Exam:
    """An examination that was made.

    Attributes
    ----------
    folder : of the examination.
    tier : see `answers.Tier`.
    counts : kind of case -> number.
    seal : its checksum, which shows later whether answers were replaced.
    hidden : number of cases with an effect that is hardly detectable.
    """

    folder: Path
    tier: Tier
    counts: dict[str, int]
    seal: str
    hidden: int


def make(folder: Path, seed: int, tier: Tier, cases: int, nulls: int | None, jobs: int, say: Say) -> Exam:
    """Make an examination in a new folder, or continue an interrupted one.

    Parameters
    ----------
    folder : new, empty, or unfinished from the same request.
    seed : of the examination.
    tier : "clean" or "workshop".
    cases, nulls : number of cases with and without effects; by default, nulls are a sixth of the others.
    jobs : number of parallel processes.
    say : called for every case.

    Raises
    ------
    BadInput : if the folder contains something else, or cannot be written.
    """
    nulls = cases // 6 if nulls is None else nulls
    planned = plan(cases, nulls, tier, seed, tuple(EFFECTS), tuple(OUTSIDE))
    return make_cases(
        folder, {"tier": tier, "seed": seed, "cases": cases, "nulls": nulls}, _written(planned, folder), jobs, say
    )


def make_foreign(
    folder: Path, seed: int, tier: Tier, counts: Counts, target: Sequence[str], jobs: int, say: Say
) -> Exam:
    """Make an examination with vehicles of foreign simulators; parameters and errors as in `make`.

    Parameters
    ----------
    tier : "foreign", "many" or "rough".
    counts : number of cases of each kind.
    target : families, or sets of them; by default those of the set "examination".
    """
    from .foreign.families import dealt_out

    planned = dealt_out(counts, tier, seed, target)
    requested = {"tier": tier, "seed": seed, **vars(counts), "families": list(target)}
    return make_cases(folder, requested, _written(planned, folder), jobs, say)


def make_cases(
    folder: Path, requested: Mapping[str, Any], cases: Mapping[str, Callable[[], Answer]], jobs: int, say: Say
) -> Exam:
    """Make the cases that are not made yet, and seal them.

    Parameters
    ----------
    folder : new, empty, or unfinished from the same request.
    requested : tier, seed and all else that identifies the examination.
    cases : name of a case's folder -> function that writes it, with the answer last, and returns the answer.
    jobs : number of parallel processes.
    say : called for every case.

    Raises
    ------
    BadInput : if the folder contains something else, or cannot be written.
    """
    _begin(folder, {**requested, "version": __version__})
    files = {name: folder / SEALED / name / "answer.json" for name in cases}
    answers = [read_answer(file) for file in files.values() if file.is_file()]
    todo = [cases[name] for name, file in files.items() if not file.is_file()]
    if answers:
        say(f"{len(answers)}/{len(cases)} were made before")

    def told(_: int, answer: Answer) -> bool:
        answers.append(answer)
        say(f"{len(answers)}/{len(cases)} made", passing=len(answers) % 20 > 0)
        return True

    if side_by_side(lambda number: todo[number](), len(todo), jobs, told).interrupted:
        raise KeyboardInterrupt
    exam = finish(folder, requested["tier"], requested["seed"], sorted(answers, key=lambda item: item.case))
    (folder / SEALED / UNFINISHED).unlink()
    return exam


def _begin(folder: Path, requested: dict[str, Any]) -> None:
    """Store the request in a new folder; do nothing if it is already stored."""
    file = folder / SEALED / UNFINISHED
    begun = read_json(file) if file.is_file() else None
    if begun == requested:
        ensure_writable(folder)
        return
    if isinstance(begun, dict):
        known = ", ".join(f"{name} {value}" for name, value in begun.items())
        raise BadInput(
            f"{folder} holds an unfinished examination ({known}), made with other options. Repeat those options to "
            "continue it, or name a new folder with ‹out›."
        )
    prepare(folder)
    write_atomically(file, json.dumps(requested, indent=1) + "\n")


def prepare(folder: Path) -> None:
    """Ensure that a folder is new or empty, and can be written."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(f"{folder} is not empty. Name a new folder with ‹out›; an examination is never overwritten.")
    ensure_writable(folder)


def finish(folder: Path, tier: Tier, seed: int, answers: list[Answer]) -> Exam:
    """Write the description of the examination, and seal it."""
    counts = dict(Counter(answer.kind for answer in answers))
    body = {"tier": tier, "seed": seed, "version": __version__, "counts": counts}
    write_atomically(folder / SEALED / "exam.json", json.dumps(body, indent=1) + "\n")
    hidden = sum(bool(answer.effects) and bool(answer.left) and not answer.sizable for answer in answers)
    return Exam(folder, tier, {str(kind): count for kind, count in counts.items()}, seal(folder), hidden)


def _written(planned: Sequence[Planned], folder: Path) -> dict[str, Callable[[], Answer]]:
    """Functions that write the cases of simulated vehicles."""
    return {item.case: partial(_write, item, folder) for item in planned}


def _write(planned: Planned, folder: Path) -> Answer:
    given, kept = folder / CASES / planned.case, folder / SEALED / planned.case
    if planned.family:
        from .foreign.case import made as made_foreign

        case = made_foreign(planned)
        write_atomically(given / COLUMNS, case.columns)
    else:
        case = made(planned)
    write_recording(case.recording, given / "recording.csv")
    write_atomically(given / "vehicle.toml", case.vehicle_file)
    write_recording(case.held_out, kept / "held_out.csv")
    write_answer(case.answer, kept / "answer.json")
    return case.answer


def write_recording(recording: Recording, file: Path) -> None:
    """Write a recording as CSV that the column map "canonical" reads."""
    table = pd.DataFrame({name: item for name, item in sorted(recording.signals.items()) if name in SIGNALS})
    table.insert(0, "time", recording.time.round(9))
    if len(recording.runs) > 1:
        table["run"] = np.repeat(np.arange(len(recording.runs)), [b - a for a, b in recording.runs])
    with replacing(file) as beside:
        table.to_csv(beside, index=False, float_format="%.9g")
