"""Recordings that people hand over, read or named by files; apart from models, which take longer to load than files."""

from __future__ import annotations

from collections.abc import Sequence
from glob import glob, has_magic
from pathlib import Path
from typing import TypeAlias

from ..base.errors import BadInput
from ..datasets.column_map import ColumnMap
from ..datasets.read import read as read_file
from ..datasets.recording import Recording

Columns: TypeAlias = str | Path | ColumnMap
"""A column map: the name of a shipped one, the path of a TOML file, or the map itself."""
Recordings: TypeAlias = Recording | str | Path | Sequence[Recording | str | Path]
"""One recording or several, read or named by their files; a name may be a pattern such as "lap*.csv"."""


def recordings(given: Recordings, columns: Columns = "canonical", argument: str = "recordings") -> list[Recording]:
    """All that is meant, read where files are named."""
    several = [given] if isinstance(given, Recording | str | Path) else given
    if not isinstance(several, Sequence) or hasattr(several, "columns"):
        raise BadInput(
            f"{argument}: a Recording, a path or a list of them is needed, not {of_type(given)}.{_frame(given)}"
        )
    result: list[Recording] = []
    for item in several:
        if isinstance(item, Recording):
            result.append(item)
        elif isinstance(item, str | Path):
            result += [read_file(path, columns) for path in files(item, argument)]
        else:
            raise BadInput(f"{argument}: a Recording or a path is needed, not {of_type(item)}.{_frame(item)}")
    if not result:
        raise BadInput(f"{argument}: there is no recording; hand one over, or name a file.")
    return result


def recording(given: Recording | str | Path, columns: Columns = "canonical", argument: str = "recording") -> Recording:
    """The one that is meant."""
    result = recordings(given, columns, argument)
    if len(result) > 1:
        raise BadInput(f"{argument}: one recording is needed, and {len(result)} are given; take them one by one.")
    return result[0]


def files(pattern: str | Path, argument: str) -> list[Path]:
    """The files of a path or a pattern, in the order of their names."""
    text = str(pattern)
    if Path(text).exists() or not has_magic(text):
        return [Path(text)]
    result = sorted(glob(text, recursive=True))
    if not result:
        raise BadInput(f"{argument}: no file is called like {text!r}, seen from {Path.cwd()}.")
    return [Path(path) for path in result]


def of_type(given: object) -> str:
    """What somebody handed over, in words."""
    return f"the {type(given).__name__} {given!r:.40}" if not hasattr(given, "columns") else f"a {type(given).__name__}"


def _frame(given: object) -> str:
    return " Make one of it: gb.Recording.from_pandas(table)." if hasattr(given, "columns") else ""
