"""Layout of an examination's folder.

DIR/cases/<id>/recording.csv, vehicle.toml, ...  given to the candidate, and nothing else
               diagnosis.json, closed.toml       its answer
DIR/sealed/exam.json, seal.json, <id>/answer.json, held_out.csv
DIR/score.json                                   written when the answers are opened
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Literal

from greybox_id.base.errors import BadInput
from greybox_id.base.files import write_atomically
from greybox_id.base.json_data import read_json
from greybox_id.datasets.column_map import column_map
from greybox_id.datasets.repair import map_text

CASES, SEALED = "cases", "sealed"
COLUMNS = "columns.toml"
AFTER, BEFORE = "after.csv", "before_*.csv"
GIVEN = ("recording.csv", "vehicle.toml", COLUMNS, AFTER, BEFORE)
"""Files of a case that are handed out; the last three only if needed: the column map and, for cases of what changed, a
second recording from after and all from before."""
UNFINISHED = "unfinished.json"
"""The request, stored with the answers until all cases are made; not sealed."""
TAKEN = "taken"
"""Folder of locks, one per case that a run is diagnosing."""
DIAGNOSIS, CLOSED = "diagnosis.json", "closed.toml"


def columns_text(hold: Literal["zero", "linear"]) -> str:
    """The column map "canonical", as the text of a file, with how commands run between rows: "zero" or "linear"."""
    return map_text(replace(column_map("canonical"), hold=hold, hold_stated=True))


def exam_of(cases: Path) -> Path:
    """Absolute path of the examination to which a folder of cases, or the folder itself, belongs."""
    folder = cases.resolve()
    folder = folder if (folder / CASES).is_dir() else folder.parent
    if not (folder / CASES).is_dir():
        raise BadInput(f"{cases} holds no cases. Name the folder that greybox exam make wrote, or cases in it.")
    return folder


def case_folders(exam: Path) -> list[Path]:
    """Folders of all cases, in order."""
    result = sorted(folder for folder in (exam / CASES).iterdir() if (folder / GIVEN[0]).is_file())
    if not result:
        raise BadInput(f"{exam / CASES} holds no cases. Make them with greybox exam make.")
    return result


SEAL = "seal.json"


def seal(exam: Path) -> str:
    """Write the seal of an examination and return its checksum, 64 hexadecimal digits, to be kept elsewhere."""
    hashes = _hashes(exam)
    body = {"sum": _sum(hashes), "files": hashes}
    write_atomically(exam / SEALED / SEAL, json.dumps(body, indent=1) + "\n")
    return str(body["sum"])


def unbroken(exam: Path, noted: str = "") -> str:
    """Check that nothing has changed since the examination was made; return the seal's checksum.

    Parameters
    ----------
    exam : folder of the examination.
    noted : the checksum as noted when it was made, which alone shows whether the seal itself was replaced.

    Raises
    ------
    BadInput : if there is no seal, or a file was changed, added or removed, which is then named.
    """
    file = exam / SEALED / SEAL
    if not file.is_file():
        raise BadInput(f"{exam} has no seal: it was never finished. Make the examination again.")
    body = read_json(file)
    known = body.get("files", {}) if isinstance(body, dict) else {}
    result = _hashes(exam)
    for name in sorted(known.keys() | result.keys()):
        if name not in result:
            raise BadInput(f"The seal is broken: {exam / name} is missing. This examination cannot be scored.")
        if known.get(name) != result[name]:
            how = "was changed" if name in known else "was added"
            raise BadInput(f"The seal is broken: {exam / name} {how}. This examination cannot be scored.")
    if body.get("sum") != _sum(result) or (noted and noted != body["sum"]):
        raise BadInput(f"The seal is broken: {file} was replaced. This examination cannot be scored.")
    return _sum(result)


def _hashes(exam: Path) -> dict[str, str]:
    """Relative path -> hash, of withheld files and files that were handed out."""
    aside = (exam / SEALED / SEAL, exam / SEALED / UNFINISHED)
    kept = [path for path in (exam / SEALED).rglob("*") if path.is_file() and path not in aside]
    given = [path for name in GIVEN for path in (exam / CASES).glob(f"*/{name}")]
    return {
        path.relative_to(exam).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((*kept, *given))
    }


def _sum(hashes: dict[str, str]) -> str:
    lines = "".join(f"{item}  {name}\n" for name, item in sorted(hashes.items()))
    return hashlib.sha256(lines.encode()).hexdigest()
