"""What folders hold: what was asked for and is done, so that a kill costs little, and what was sent, for a moment."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from greybox_id.base.errors import BadInput
from greybox_id.base.files import ensure_writable, scratch_name, write_atomically
from greybox_id.base.json_data import plain, read_json, without_nan

Found = TypeVar("Found")


@dataclass(frozen=True)
class LoopOutcome:
    """What came of a run, as plain data (docs/json.md) and in lines."""

    body: Mapping[str, Any]
    lines: Sequence[str]

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return dict(self.body)

    def summary(self) -> str:
        """For people."""
        return "\n".join(self.lines)


def begun(file: Path, kind: str, requested: Mapping[str, Any], fresh: Mapping[str, Any]) -> dict[str, Any]:
    """The state in a file of a folder: what was begun there, or a fresh one.

    Parameters
    ----------
    file : of the state, in a folder that is empty, absent, or holds what was begun.
    kind : what is done, "demo"; the format is greybox-loop-demo.
    requested : what is asked for; only the same is carried on.
    fresh : the state to begin with.

    Raises
    ------
    BadInput : the folder holds something else, or the same with other wishes.
    """
    folder, format_ = file.parent, f"greybox-loop-{kind}"
    held = read_json(file) if file.is_file() else None
    if isinstance(held, dict) and held.get("format") == format_:
        if held.get("asked") == plain(dict(requested)):
            ensure_writable(folder)
            return held
        options = ", ".join(f"{name} {value}" for name, value in dict(held.get("asked", {})).items())
        raise BadInput(f"{folder} holds another {kind} ({options}); name a new folder with ‹out›.")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(f"{folder} holds something else; name a new folder with ‹out›.")
    ensure_writable(folder)
    state = {"format": format_, "format_version": 1, "asked": plain(dict(requested)), **fresh}
    write_atomically(file, json.dumps(state) + "\n")
    return state


def of_bytes(body: bytes, folder: Path, suffix: str, what: str, use: Callable[[Path], Found]) -> Found:
    """What bytes that were sent hold, read from a file of a folder that is gone afterwards.

    Raises
    ------
    BadInput : they cannot be used; the sentence names `what` in place of the file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    beside = scratch_name(folder, suffix)
    try:
        beside.write_bytes(body)
        return use(beside)
    except BadInput as error:
        raise BadInput(str(error).replace(str(beside), what).replace(beside.stem, what)) from error
    finally:
        beside.unlink(missing_ok=True)


def keep(file: Path, state: Mapping[str, Any]) -> None:
    """Write a state down."""
    write_atomically(file, json.dumps(without_nan(plain(dict(state))), allow_nan=False) + "\n", continued=True)
