"""Where things lie in an examination.

DIR/cases/<id>/recording.csv, vehicle.toml       what the candidate is given; nothing else is shown to it
               diagnosis.json, closed.toml       what it answers
DIR/sealed/exam.json, seal.json, <id>/answer.json, held_out.csv
DIR/score.json                                   once the answers have been opened
"""

from __future__ import annotations

from pathlib import Path

from ..errors import BadInput

CASES, SEALED = "cases", "sealed"
COLUMNS = "columns.toml"
BEFORE = "before.csv"
GIVEN = ("recording.csv", "vehicle.toml", "fit.json", COLUMNS, BEFORE)
"""Files of a case that are handed out; the last three only where they are needed: a fit in place of the vehicle file,
how the recording is to be read, and what the same vehicle did before."""
UNFINISHED = "unfinished.json"
"""What was asked for, beside the answers until all cases are made; not under the seal."""
DIAGNOSIS, CLOSED = "diagnosis.json", "closed.toml"


def exam_of(cases: Path) -> Path:
    """The examination that a folder of cases, or the examination's own folder, belongs to; as an absolute path."""
    folder = cases.resolve()
    folder = folder if (folder / CASES).is_dir() else folder.parent
    if not (folder / CASES).is_dir():
        raise BadInput(f"{cases} holds no cases. Name the folder that greybox exam make wrote, or cases in it.")
    return folder


def case_folders(exam: Path) -> list[Path]:
    """Folders of all cases, in order."""
    found = sorted(folder for folder in (exam / CASES).iterdir() if (folder / GIVEN[0]).is_file())
    if not found:
        raise BadInput(f"{exam / CASES} holds no cases. Make them with greybox exam make.")
    return found
