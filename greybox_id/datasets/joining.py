"""Files of one drive, one topic each, joined on one clock: by their stamps, or by a signal that two of them carry.

A signal that the column map finds in two files tells by how much their clocks differ: by the delay at which the one is
best explained by the other (`checks.lag`), which carries a jackknife's uncertainty. What cannot be told so is taken at
its stamps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..base.signals import ANGLES_AROUND, COMMANDS
from .checks.lag import estimate_lag
from .column_map import Column, ColumnMap, column_map
from .read import Part, as_parts, one_signal, read_together
from .recording import Recording

LONGEST = 2.0
"""Clocks that differ by more, s, are not compared: stamps a whole stretch apart are another fault."""
SHARE = 0.1
"""Of the time in common, beyond which an offset is not looked for."""
SURE = 2.0
"""Standard deviations from which on an offset is taken off; a smaller one may be none."""


@dataclass(frozen=True)
class Offset:
    """By how much a file's clock is ahead of another's.

    Attributes
    ----------
    file, against : names of the files.
    signal : what both carry; empty where nothing tells the offset.
    seconds, sd : the offset and its standard deviation, s; NaN where nothing tells it.
    taken_off : whether the file's times were corrected by it.
    """

    file: str
    against: str
    signal: str = ""
    seconds: float = float("nan")
    sd: float = float("nan")
    taken_off: bool = False

    @property
    def sentence(self) -> str:
        """What was done, for people."""
        if not self.signal:
            return f"{self.file}: taken at its stamps; it has no signal in common with {self.against}."
        found = f"{1e3 * self.seconds:.1f} +- {1e3 * self.sd:.1f} ms late against {self.against} by {self.signal}"
        return f"{self.file}: {found}; {'taken off' if self.taken_off else 'no more than chance, left'}."


def join_files(
    paths: Sequence[str | Path], columns: str | Path | ColumnMap = "canonical"
) -> tuple[Recording, list[Offset]]:
    """Several files of one drive as one recording, and how their clocks were aligned.

    Parameters
    ----------
    paths : two files or more; offsets are those against the first.
    columns : the column map, as `datasets.read.read_together` takes it. A signal whose `column` lists several names, or
        one name that several files have, is taken from the first file and compared with the others.

    Raises
    ------
    BadInput
        A file or the map cannot be read, a column is missing, or files have no time in common.
    """
    if len(paths) < 2:
        raise BadInput("There is nothing to join; name two files or more.")
    mapping = column_map(columns)
    first, *others = as_parts([Path(path) for path in paths], mapping).values()
    offsets = [_offset(first, other, mapping) for other in others]
    late = {offset.file: offset.seconds for offset in offsets if offset.taken_off}
    recording = read_together(paths, columns, late)
    return replace(recording, notes=(*recording.notes, *(offset.sentence for offset in offsets))), offsets


def _offset(first: Part, other: Part, mapping: ColumnMap) -> Offset:
    best = Offset(other.name, first.name)
    for name, column in mapping.signals.items():
        places = [_in(part, column) for part in (first, other)]
        if name in COMMANDS or None in places:
            continue
        series = [
            one_signal(part, replace(column, column=place or ""), mapping)
            for part, place in zip((first, other), places, strict=True)
        ]
        found = _lag(*series[0], *series[1], around=name in ANGLES_AROUND)
        if found is not None and not found[1] >= best.sd:
            best = Offset(other.name, first.name, name, *found, taken_off=abs(found[0]) > SURE * found[1])
    return best


def _in(part: Part, column: Column) -> str | None:
    """The name under which a file has a column."""
    return next(filter(None, (part.full(name) for name in (column.column, *column.otherwise))), None)


def _lag(t: Array, v: Array, t_other: Array, v_other: Array, around: bool) -> tuple[float, float] | None:
    """By how much the second of two series of one quantity is late, and its standard deviation, s."""
    step = max(float(np.median(np.diff(t))), float(np.median(np.diff(t_other))))
    start, stop = max(t[0], t_other[0]), min(t[-1], t_other[-1])
    if not step > 0 or stop - start < 100 * step:
        return None
    grid = np.arange(start, stop, step)
    values = [np.interp(grid, *((s, np.unwrap(w)) if around else (s, w))) for s, w in ((t_other, v_other), (t, v))]
    lag = estimate_lag(values[0], values[1], step, longest=min(LONGEST, SHARE * (stop - start)))
    return None if lag is None else (lag.samples * step, lag.error * step)
