"""Cases of a real vehicle: recordings after a change that only the file's name tells."""

from __future__ import annotations

import shutil
from importlib import resources
from pathlib import Path

from ..datasets.read import read
from ..datasets.vehicle_file import vehicle
from ..errors import BadInput
from ..files import write_atomically
from ..fitting import Say, fit
from ..models.registry import build
from .answers import Answer, write_answer
from .folder import CASES, SEALED
from .make import Exam, finish, prepare

CHANGED = {"tire_set_1.csv": "other tyres", "single_mass.csv": "a mass added"}
"""Recording -> what its name says; more is not known."""
BEFORE = "train.csv"
COLUMNS = "roboracer"
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
    source = data / COLUMNS if (data / COLUMNS).is_dir() else data
    if lacking := [name for name in (BEFORE, *CHANGED) if not (source / name).is_file()]:
        raise BadInput(f"{source} holds no {', '.join(lacking)}; name the folder of the RoboRacer recordings.")
    prepare(folder)
    before = fit(build("single_track", vehicle=vehicle(COLUMNS)), [read(source / BEFORE, COLUMNS)], say=say)
    columns = resources.files("greybox_id.datasets").joinpath("columns", f"{COLUMNS}.toml").read_text("utf-8")
    answers = []
    for number, (name, about) in enumerate(CHANGED.items()):
        case = f"case_{number:03d}"
        before.save(folder / CASES / case / "fit.json")
        write_atomically(folder / CASES / case / "columns.toml", columns)
        shutil.copyfile(source / name, folder / CASES / case / "recording.csv")
        answer = Answer(case, "real", "real", {}, about={"file": name, "says": about})
        write_answer(answer, folder / SEALED / case / "answer.json")
        answers.append(answer)
    return finish(folder, "real", 0, answers)
