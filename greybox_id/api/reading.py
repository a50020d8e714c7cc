"""Reading of recordings from files, and data checks.

Arguments are recordings or names of files. This module does not import models, which takes longer than reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from glob import glob, has_magic
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ..base.declared import understood
from ..base.errors import BadInput
from ..datasets.column_map import ColumnMap
from ..datasets.read import read as read_file
from ..datasets.recording import Recording

if TYPE_CHECKING:
    from ..datasets.checks import Finding

Columns: TypeAlias = str | Path | ColumnMap
"""A column map: the name of a shipped one, the path of a TOML file, or the map itself."""
Recordings: TypeAlias = Recording | str | Path | Sequence[Recording | str | Path]
"""One recording or several, as recordings or files; a name may be a pattern such as "lap*.csv"."""


def recordings(given: Recordings, columns: Columns = "canonical", argument: str = "recordings") -> list[Recording]:
    """All given recordings, read from files if necessary."""
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
        raise BadInput(f"{argument}: there is no recording; pass a recording or the path of a file.")
    return result


def one_recording(
    given: Recording | str | Path, columns: Columns = "canonical", argument: str = "recording"
) -> Recording:
    """The given recording."""
    result = recordings(given, columns, argument)
    if len(result) > 1:
        raise BadInput(f"{argument}: one recording is needed, and {len(result)} were given; pass them one by one.")
    return result[0]


def files(pattern: str | Path, argument: str) -> list[Path]:
    """The files of a path or pattern, in the order of their names."""
    text = str(pattern)
    if Path(text).exists() or not has_magic(text):
        return [Path(text)]
    result = sorted(glob(text, recursive=True))
    if not result:
        raise BadInput(f"{argument}: no file matches {text!r} in the folder {Path.cwd()}.")
    return [Path(path) for path in result]


def of_type(given: object) -> str:
    """Type and value of an argument, in words."""
    return f"the {type(given).__name__} {given!r:.40}" if not hasattr(given, "columns") else f"a {type(given).__name__}"


def _frame(given: object) -> str:
    return " Make a recording of it: gb.Recording.from_pandas(table)." if hasattr(given, "columns") else ""


@understood
def read(path: str | Path | Sequence[str | Path], columns: Columns = "canonical") -> Recording | list[Recording]:
    """Read a recording and convert it to SI units and ISO 8855 signs.

    Parameters
    ----------
    path : a CSV, Parquet, MAT, HDF5, MDF, ROS or MCAP file, or the folder of a ROS 2 bag. A pattern such as "lap*.csv",
        or a list, reads several.
    columns : a column map: the name of a shipped one, the path of a TOML file, or the map itself. The default expects
        columns named like the signals, in SI units.

    Returns
    -------
    Recording, or a list of them for a pattern or a list
        Signals (n,) for n rows; NaN for empty cells. A run ends where time does not continue with its usual step.

    Raises
    ------
    BadInput : if a file or the map cannot be read, or a column is missing or contains text; the message names it.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
    >>> lap.unit("yaw_rate")
    'rad/s'
    """
    if isinstance(path, str | Path):
        paths = files(path, "path")
        if paths == [Path(path)]:
            return read_file(path, columns)
        return [read_file(item, columns) for item in paths]
    if not isinstance(path, Sequence):
        raise BadInput(f"path: a path, a pattern or a list of paths is needed, not {path!r:.60}.")
    return [read_file(file, columns) for each in path for file in files(each, "path")]


@understood
def check(
    recording: Recording | str | Path, wheelbase: float | None = None, columns: Columns = "canonical"
) -> list[Finding]:
    """Check whether a recording can be trusted: clock, values, units, signs, delays between channels, offsets at
    rest.

    Parameters
    ----------
    recording : the recording.
    wheelbase : m, if known: the steering's unit can then be checked more precisely.
    columns : column map for a file.

    Returns
    -------
    list of Finding
        Most severe first, empty if nothing is noteworthy: `severity` (note, warning or distrust), `sentence`, `where`.

    Raises
    ------
    BadInput : if the recording cannot be read, or the wheelbase is not a length.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
    >>> [finding.sentence for finding in gb.check(lap) if finding.severity.value == "distrust"]
    []
    """
    from ..datasets.checks import check as check_recording  # not needed for reading

    if wheelbase is not None and not (isinstance(wheelbase, int | float) and 0 < wheelbase < 100):
        raise BadInput(f"wheelbase: metres are needed, such as 0.32, not {wheelbase!r:.40}.")
    return check_recording(one_recording(recording, columns), wheelbase)
