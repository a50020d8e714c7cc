"""Files of one drive, one topic each, joined on one clock: by their time stamps, or by a signal that two files share.

If the column map finds a signal in two files, comparing them estimates the offset and relative rate of their clocks
with a jackknife uncertainty (`alignment`). Otherwise the time stamps are kept.
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
"""s: offsets up to this are searched first, because repeating signals, as of laps, also match at other offsets."""
SHARE, APART = 0.1, 0.5
"""Largest offset searched, as a share of the shorter file: relative to the stamps, and relative to a common start of
both files if the stamps do not match at all, as of clocks that were never set."""
SURE = 2.0
"""Standard deviations from which an offset is significant and removed."""


@dataclass(frozen=True)
class Offset:
    """Offset of a file's clock from that of another file.

    Attributes
    ----------
    file, against : names of the files.
    signal : the shared signal that the estimate uses; empty without an estimate.
    alignment : offset and rate; None if they cannot be estimated.
    shared : all signals in both files.
    taken_off : whether the file's times were corrected by the offset.
    """

    file: str
    against: str
    signal: str = ""
    alignment: ClockAlignment | None = None
    shared: tuple[str, ...] = ()
    taken_off: bool = False

    @property
    def seconds(self) -> float:
        """The offset at the first file's beginning, s; NaN without an estimate."""
        return self.alignment.seconds if self.alignment else float("nan")

    @property
    def sd(self) -> float:
        """Its standard deviation, s."""
        return self.alignment.sd if self.alignment else float("nan")

    @property
    def sentence(self) -> str:
        """The offset and what was done about it, as printed."""
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
    """Several files of one drive as one recording, and the alignment of their clocks.

    Parameters
    ----------
    paths : two files or more; offsets are relative to the first.
    columns : the column map, as in `datasets.read.read_together`. A signal whose `column` lists several names, or whose
        name several files have, is read from the first of these files and compared with the others.

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
    """A column under its name in a file; None if the file does not have it."""
    name = next(filter(part.full, (column.column, *column.otherwise)), None)
    return replace(column.named(name), column=part.full(name) or "") if name else None
