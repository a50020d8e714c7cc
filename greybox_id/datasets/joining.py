"""Files of one drive, one topic each, joined on one clock: by their stamps, or by a signal that two of them carry.

A signal that the column map finds in two files tells by how much their clocks differ, and how much faster the one runs
(`alignment`), which carries a jackknife's uncertainty. What cannot be told so is taken at its stamps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..base.errors import BadInput
from ..base.numbers import listed, number, short_with_sd, with_sd
from ..base.signals import ANGLES_AROUND, COMMANDS
from .alignment import ClockAlignment, aligned
from .column_map import Column, ColumnMap, column_map
from .read import Part, as_parts, one_signal, read_together
from .recording import Recording

LONGEST = 2.0
"""Offsets up to this, s, are looked for first: what repeats, as laps do, is alike elsewhere, too."""
SHARE, APART = 0.1, 0.5
"""Of the shorter file, beyond which an offset is not looked for: of stamps, and between the files' beginnings where
stamps do not match at all, as of clocks that were never set."""
SURE = 2.0
"""Standard deviations from which on an offset is taken off; a smaller one may be none."""


@dataclass(frozen=True)
class Offset:
    """By how much a file's clock is ahead of another's.

    Attributes
    ----------
    file, against : names of the files.
    signal : what both carry; empty where nothing tells the offset.
    alignment : offset and rate; None where nothing tells them.
    shared : signals that both carry, whether or not they tell it.
    taken_off : whether the file's times were corrected by it.
    """

    file: str
    against: str
    signal: str = ""
    alignment: ClockAlignment | None = None
    shared: tuple[str, ...] = ()
    taken_off: bool = False

    @property
    def seconds(self) -> float:
        """The offset where the first file begins, s; NaN where nothing tells it."""
        return self.alignment.seconds if self.alignment else float("nan")

    @property
    def sd(self) -> float:
        """Its standard deviation, s."""
        return self.alignment.sd if self.alignment else float("nan")

    @property
    def sentence(self) -> str:
        """What was done, for people."""
        if self.alignment is None:
            why = f"it has no signal in common with {self.against}"
            if self.shared:
                why = f"{listed(self.shared)} differ too much from those in {self.against} to estimate a time offset"
            return f"{self.file}: time stamps are kept, since {why}."
        clock = self.alignment
        late = f"{with_sd(1e3 * clock.seconds, 1e3 * clock.sd)} ms"
        if abs(clock.seconds) > LONGEST:  # of clocks that were never set, by years
            late = f"{clock.seconds:.4f} ± {number(clock.sd, 2)} s"
        result = f"time stamps are {late} late against {self.against} (estimated from {self.signal})"
        if clock.rate:
            way = "fast" if clock.rate > 0 else "slow"
            rate = short_with_sd(100 * abs(clock.rate), 100 * clock.rate_sd)
            result += f" at its beginning, and its clock runs {rate} % {way}"
        if not self.taken_off:
            return f"{self.file}: {result}. This may be chance, so the stamps are kept."
        return f"{self.file}: {result}. This offset was removed; at most {number(1e3 * clock.left, 2)} ms of it remain."


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
    late = {offset.file: offset.alignment for offset in offsets if offset.alignment and offset.taken_off}
    recording = read_together(paths, columns, late)
    return replace(recording, notes=(*recording.notes, *(offset.sentence for offset in offsets))), offsets


def _offset(first: Part, other: Part, mapping: ColumnMap) -> Offset:
    best = Offset(other.name, first.name)
    for name, column in mapping.signals.items():
        places = [place for part in (first, other) if (place := _in(part, column))]
        if name in COMMANDS or len(places) < 2:
            continue
        best = replace(best, shared=(*best.shared, name))
        (t, v), (t_other, v_other) = (
            one_signal(part, place, mapping) for part, place in zip((first, other), places, strict=True)
        )
        if min(len(t), len(t_other)) < 2:
            continue
        if name in ANGLES_AROUND:
            v, v_other = np.unwrap(v), np.unwrap(v_other)
        span, apart = float(min(np.ptp(t), np.ptp(t_other))), float(t_other[0] - t[0])
        result = aligned(t, v, t_other, v_other, min(LONGEST, SHARE * span))
        if result is None and (far := aligned(t, v, t_other - apart, v_other, APART * span)):
            result = replace(far, seconds=far.seconds + apart)
        if result is not None and not result.left >= (best.alignment.left if best.alignment else np.inf):
            sure = abs(result.seconds) > SURE * result.sd or result.rate != 0
            best = replace(best, signal=name, alignment=result, taken_off=sure)
    return best


def _in(part: Part, column: Column) -> Column | None:
    """A column under the name that it has in a file; None where it is not there."""
    name = next(filter(part.full, (column.column, *column.otherwise)), None)
    return replace(column.named(name), column=part.full(name) or "") if name else None
