"""Recordings from files, and whether they can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..base.declared import understood
from ..base.errors import BadInput
from ..datasets.read import read as read_file
from ..datasets.recording import Recording
from . import given_recordings as given
from .given_recordings import Columns

if TYPE_CHECKING:
    from ..datasets.checks import Finding


@understood
def read(path: str | Path | Sequence[str | Path], columns: Columns = "canonical") -> Recording | list[Recording]:
    """Read a recording and turn it into SI units and ISO 8855 signs.

    Parameters
    ----------
    path : a CSV, Parquet, MAT, HDF5, MDF, ROS or MCAP file, or the folder of a ROS 2 bag. A pattern such as "lap*.csv",
        or a list, reads several.
    columns : a column map: the name of a shipped one, the path of a TOML file, or the map itself. The default expects
        columns that are called like the signals, in SI units.

    Returns
    -------
    Recording, or a list of them for a pattern or a list
        Signals (n,) for n rows; NaN where a cell is empty. Runs end where time stops running on in its usual step.

    Raises
    ------
    BadInput : a file or the map cannot be read, a column is missing or holds text: the sentence says where.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
    >>> lap.unit("yaw_rate")
    'rad/s'
    """
    if isinstance(path, str | Path):
        files = given.files(path, "path")
        if files == [Path(path)]:
            return read_file(path, columns)
        return [read_file(item, columns) for item in files]
    if not isinstance(path, Sequence):
        raise BadInput(f"path: a path, a pattern or a list of paths is needed, not {path!r:.60}.")
    return [read_file(file, columns) for each in path for file in given.files(each, "path")]


@understood
def check(
    recording: Recording | str | Path, wheelbase: float | None = None, columns: Columns = "canonical"
) -> list[Finding]:
    """Say whether a recording can be trusted: its clock, values, units, signs, delays between channels, offsets at
    rest.

    Parameters
    ----------
    recording : what is checked.
    wheelbase : m, where it is known: the steering's unit can then be checked more sharply.
    columns : column map, where a file is named.

    Returns
    -------
    list of Finding
        Gravest first, empty where nothing is noteworthy: `severity` (note, warning or distrust), `sentence`, `where`.

    Raises
    ------
    BadInput : the recording cannot be read, or the wheelbase is no length.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
    >>> [finding.sentence for finding in gb.check(lap) if finding.severity.value == "distrust"]
    []
    """
    from ..datasets.checks import check as check_recording  # reading alone needs none of them

    if wheelbase is not None and not (isinstance(wheelbase, int | float) and 0 < wheelbase < 100):
        raise BadInput(f"wheelbase: metres are needed, such as 0.32, not {wheelbase!r:.40}.")
    return check_recording(given.recording(recording, columns), wheelbase)
