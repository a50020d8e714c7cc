"""A recording: time and named signals in SI units, split into unbroken runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .errors import BadInput
from .signals import SIGNALS, unit_of

Array = NDArray[np.float64]

JITTER_TOLERANCE = 0.5
"""A step in time counts as a join when it differs from the usual step by more than this share of it."""


@dataclass(frozen=True)
class Source:
    """Where a recording came from.

    Attributes
    ----------
    path : the file as the user named it; empty for a recording made in memory.
    sha256 : hash of the file's bytes, hexadecimal; of a folder, hash of its files' names and hashes.
    columns : the column map it was read through, as the user named it: a shipped one or the path of a file.
    """

    path: str = ""
    sha256: str = ""
    columns: str = ""


@dataclass(frozen=True)
class Resampled:
    """How a signal came onto a clock that is not its own.

    Attributes
    ----------
    method : "linear" between readings, or "held" from one reading to the next, as commands are.
    clock : whose clock the signal had: a topic, a channel group.
    rate : its own readings a second, Hz.
    error : root mean square of what resampling is estimated to add, in the signal's SI unit.
    largest : the largest such estimate, in the signal's SI unit.
    """

    method: Literal["linear", "held"]
    clock: str
    rate: float
    error: float
    largest: float


@dataclass(frozen=True)
class Recording:
    """Time and named signals in SI units, split into unbroken runs.

    Attributes
    ----------
    name : short name for tables and figures.
    time : (n,) s, increasing within each run; it may restart at a join.
    signals : name -> (n,) values in the SI unit of `greybox_id.signals.SIGNALS`; NaN where missing.
    runs : row ranges [start, stop) without a join inside; they cover all rows, in order.
    source : provenance.
    extra_units : units of signals that are not in `SIGNALS` (a file's own further channels).
    hold : what commands do between rows: "zero", they keep their value until the next row; "linear", they run
        straight to the next one.
    resampled : signals that had a clock of their own and were brought onto `time`, and what that costs.
    notes : what else reading did to the file that a person should know, as sentences.
    """

    name: str
    time: Array
    signals: Mapping[str, Array]
    runs: tuple[tuple[int, int], ...] = ()
    source: Source = Source()
    extra_units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    hold: Literal["zero", "linear"] = "zero"
    resampled: Mapping[str, Resampled] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        time = _frozen(self.time)
        if time.ndim != 1:
            raise BadInput(f"{self.name}: time must be one column, it has shape {time.shape}.")
        signals = {name: _frozen(values) for name, values in self.signals.items()}
        for name, values in signals.items():
            if values.shape != time.shape:
                raise BadInput(f"{self.name}: signal {name} has shape {values.shape}, but time has {time.shape}.")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "signals", MappingProxyType(signals))
        object.__setattr__(self, "extra_units", MappingProxyType(dict(self.extra_units)))
        object.__setattr__(self, "resampled", MappingProxyType(dict(self.resampled)))
        object.__setattr__(self, "runs", tuple(self.runs) or split_runs(time))

    def __len__(self) -> int:
        return len(self.time)

    def __contains__(self, name: object) -> bool:
        return name in self.signals

    def __getitem__(self, name: str) -> Array:
        if name not in self.signals:
            raise BadInput(
                f"{self.name} has no signal {name!r}; it has {', '.join(self.signals) or 'none'}. "
                f"Map a column of the file to {name} in the column map."
            )
        return self.signals[name]

    def unit(self, name: str) -> str:
        """SI unit of a signal of this recording."""
        return unit_of(name, self.extra_units.get(name, "1"))

    @cached_property
    def sample_time(self) -> float:
        """Usual time step within runs, s (median over all steps that do not cross a join)."""
        steps = [np.diff(self.time[start:stop]) for start, stop in self.runs]
        joined = np.concatenate(steps) if steps else np.empty(0)
        return float(np.median(joined)) if joined.size else float("nan")

    @property
    def duration(self) -> float:
        """Recorded time, s: the sum over runs, gaps at joins not counted."""
        return float(sum(self.time[stop - 1] - self.time[start] for start, stop in self.runs))

    def require(self, names: Iterable[str], purpose: str) -> None:
        """Raise `BadInput` naming every signal of `names` that this recording lacks."""
        lacking = [name for name in names if name not in self.signals]
        if lacking:
            raise BadInput(
                f"{self.name} lacks {', '.join(lacking)}, which {purpose} needs; it has {', '.join(self.signals)}. "
                "Map the columns that hold them in the column map (--columns)."
            )

    def each_run(self) -> Iterator[Recording]:
        """Each unbroken run as a recording of its own."""
        for number, (start, stop) in enumerate(self.runs, 1):
            yield replace(self.rows(start, stop), name=f"{self.name}, run {number}")

    def rows(self, start: int, stop: int) -> Recording:
        """The rows [start, stop), joins kept."""
        inside = [(max(a, start) - start, min(b, stop) - start) for a, b in self.runs]
        return replace(
            self,
            time=self.time[start:stop],
            signals={name: values[start:stop] for name, values in self.signals.items()},
            runs=tuple((a, b) for a, b in inside if b > a),
        )

    def with_signals(self, **signals: Array) -> Recording:
        """The same recording with signals added or replaced (SI units)."""
        return replace(self, signals={**self.signals, **signals})

    def mirrored(self) -> Recording:
        """The same drive with left and right swapped."""
        flipped = {n: -v if n in SIGNALS and SIGNALS[n].mirrors else v for n, v in self.signals.items()}
        return replace(self, name=f"{self.name}, mirrored", signals=flipped)


def join(recordings: Iterable[Recording], name: str) -> Recording:
    """Several recordings one after the other, with a join between each; only common signals are kept."""
    parts = list(recordings)
    if not parts:
        raise BadInput("There is no recording to work on; name at least one file.")
    common = [n for n in parts[0].signals if all(n in part for part in parts)]
    offsets = np.concatenate(([0], np.cumsum([len(part) for part in parts])))
    return Recording(
        name=name,
        time=np.concatenate([part.time for part in parts]),
        signals={n: np.concatenate([part[n] for part in parts]) for n in common},
        runs=tuple((a + int(o), b + int(o)) for part, o in zip(parts, offsets, strict=False) for a, b in part.runs),
        source=parts[0].source if len(parts) == 1 else Source(),
        extra_units={n: u for part in parts for n, u in part.extra_units.items() if n in common},
        hold=parts[0].hold,
    )


def split_runs(time: Array) -> tuple[tuple[int, int], ...]:
    """Row ranges [start, stop) in which time runs on in its usual step.

    Time that stands still, steps back or jumps by more than `JITTER_TOLERANCE` of the usual step begins a new run.
    """
    if len(time) == 0:
        return ()
    steps = np.diff(time)
    forward = steps[steps > 0]
    if forward.size == 0:
        return tuple((k, k + 1) for k in range(len(time)))
    usual = float(np.median(forward))
    joins = np.flatnonzero(~(np.abs(steps - usual) <= JITTER_TOLERANCE * usual)) + 1
    edges = [0, *joins.tolist(), len(time)]
    return tuple((a, b) for a, b in zip(edges[:-1], edges[1:], strict=True))


def _frozen(values: object) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
