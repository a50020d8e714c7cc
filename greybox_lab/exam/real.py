"""Cases of real recordings: after a change that only the file's name tells, or with all from before beside them."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.files import write_atomically
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import Say
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import build
from greybox_id.models.vehicle import ChosenModel
from greybox_id.models.vehicle_file import vehicle, write_vehicle

from .answers import Answer, write_answer
from .folder import AFTER, BEFORE, CASES, COLUMNS, SEALED
from .make import Exam, finish, prepare, write_recording

CHANGED = {"tire_set_1.csv": "other tyres", "single_mass.csv": "a mass added"}
"""Recording -> what its name says; more is not known."""
TRAINED = "train.csv"
ROBORACER = "roboracer"
"""Column map, and vehicle, of these recordings."""


def make_real(folder: Path, data: Path, say: Say) -> Exam:
    """Cases of the RoboRacer recordings; what was fitted before the change is the model.

    Parameters
    ----------
    folder : to be made, or empty.
    data : folder with the recordings, or that holds a folder roboracer with them.
    say : told of progress.

    Raises
    ------
    BadInput : a recording is missing, or the folder is not empty.
    """
    source = data / ROBORACER if (data / ROBORACER).is_dir() else data
    if lacking := [name for name in (TRAINED, *CHANGED) if not (source / name).is_file()]:
        raise BadInput(f"{source} holds no {', '.join(lacking)}; name the folder of the RoboRacer recordings.")
    prepare(folder)
    before = fit(build("single_track", vehicle=vehicle(ROBORACER)), [read(source / TRAINED, ROBORACER)], say=say)
    answers = []
    for number, (name, about) in enumerate(CHANGED.items()):
        case = f"case_{number:03d}"
        before.save(folder / CASES / case / "fit.json")
        write_atomically(folder / CASES / case / COLUMNS, _columns(ROBORACER))
        shutil.copyfile(source / name, folder / CASES / case / "recording.csv")
        answer = Answer(case, "real", "real", {}, about={"file": name, "says": about})
        write_answer(answer, folder / SEALED / case / "answer.json")
        answers.append(answer)
    return finish(folder, "real", 0, answers)


@dataclass(frozen=True)
class ChangedCase:
    """What changed between recordings of a real vehicle, as a case.

    Attributes
    ----------
    vehicle, model : shipped vehicle, and model in place of its own; "" for its own.
    before : recordings in which nothing had changed.
    after : the recording that is diagnosed, and a second one that decides; or none.
    answer : kept back.
    """

    vehicle: str
    model: str
    before: Sequence[Recording]
    after: Sequence[Recording]
    answer: Answer

    def written(self, folder: Path) -> Answer:
        """Write it into an examination."""
        given, (first, *more) = folder / CASES / self.answer.case, self.after
        own = vehicle(self.vehicle)
        write_vehicle(replace(own, model=ChosenModel(self.model)) if self.model else own, given / "vehicle.toml")
        write_atomically(given / COLUMNS, _columns("canonical").replace('hold = "zero"', f'hold = "{first.hold}"'))
        write_recording(first, given / "recording.csv")
        for one in more:
            write_recording(one, given / AFTER)
        for k, one in enumerate(self.before, 1):
            write_recording(one, given / BEFORE.replace("*", str(k)))
        write_answer(self.answer, folder / SEALED / self.answer.case / "answer.json")
        return self.answer


def _columns(name: str) -> str:
    """A shipped column map."""
    return resources.files("greybox_id.datasets").joinpath("columns", f"{name}.toml").read_text("utf-8")


def shuffled(count: int, seed: int) -> list[str]:
    """Names of cases that tell nothing of the order in which they are planned."""
    digits = max(3, len(str(count)))
    return [f"case_{place:0{digits}d}" for place in np.random.default_rng((seed, 61031)).permutation(count)]


def lacking(data: Path, files: Sequence[str]) -> list[str]:
    """Those of the files that are not there."""
    return [name for name in dict.fromkeys(files) if not (data / name).is_file()]
