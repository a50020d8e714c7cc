"""A recording: time and named signals in SI units, split into contiguous runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..base.condition import holds
from ..base.declared import understood
from ..base.errors import BadInput, near_or_all
from ..base.numbers import listed, pretty_unit
from ..base.shorthands import Array
from ..base.signals import SIGNALS, unit_of
from ..base.units import to_si

if TYPE_CHECKING:
    import pandas as pd


BY_TURNS = 0.01
"""Relative difference of mean and median step above which the mean is used: stamps alternate between two steps."""
JITTER_TOLERANCE = 0.5
"""A time step ends a run if it differs from the usual step by more than this share of it."""
MOST_SHOWN = 12
"""Largest number of signals in a recording's `repr`."""


@dataclass(frozen=True)
class Source:
    """Where a recording came from.

    Attributes
    ----------
    path : the file as the user named it; empty for a recording made in memory.
    sha256 : hash of the file's bytes, hexadecimal; of a folder, hash of its files' names and hashes.
    columns : the column map, as the user named it: a shipped one or the path of a file.
    between, where : the selected part of the file, as given to `Recording.between` and `Recording.where`.
    column_map : text of that map if it is a user's own; results made from the recording store it.
    first_row : row number of the file's first values, counted from 1; 0 for a table in memory.
    """

    path: str = ""
    sha256: str = ""
    columns: str = ""
    between: str = ""
    where: str = ""
    column_map: str = ""
    first_row: int = 0


@dataclass(frozen=True)
class Resampled:
    """How a signal was resampled to the recording's clock.

    Attributes
    ----------
    method : "linear" between readings, or "held" from one reading to the next, as commands are.
    clock : the clock of the signal's readings: a topic, a channel group.
    rate : readings per second, Hz.
    error : root mean square of the estimated resampling error, in the signal's SI unit.
    largest : largest estimated resampling error, in the signal's SI unit.
    """

    method: Literal["linear", "held"]
    clock: str
    rate: float
    error: float
    largest: float


@dataclass(frozen=True, repr=False)
class Recording:
    """Time and named signals in SI units, split into contiguous runs.

    Attributes
    ----------
    name : short name for tables and figures.
    time : (n,) s, increasing within each run; it may restart in the next run.
    signals : name -> (n,) values in the SI unit of `greybox_id.base.signals.SIGNALS`; NaN where missing.
    runs : row ranges [start, stop) of contiguous samples; they cover all rows, in order.
    source : provenance.
    extra_units : units of signals that are not in `SIGNALS` (further channels of the file).
    hold : commands between rows: "zero", they are constant until the next row; "linear", they change linearly to the
        next one.
    hold_stated : whether `hold` was stated; if not, fits and diagnoses compare both.
    resampled : signals that were resampled from another clock onto `time`, with the estimated error.
    notes : other changes made when reading the file, as sentences.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.Recording("lap", time=[0.0, 0.1, 0.2], signals={"v_x": [3.0, 3.1, 3.2], "steer": [0.0, 0.1, 0.1]})
    >>> lap
    Recording lap: 3 rows in 1 run, 0.2 s at 10 Hz
      v_x [m/s], steer [rad]
    >>> float(lap["v_x"].mean().round(2))
    3.1
    """

    name: str
    time: Array
    signals: Mapping[str, Array]
    runs: tuple[tuple[int, int], ...] = ()
    source: Source = Source()
    extra_units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    hold: Literal["zero", "linear"] = "zero"
    hold_stated: bool = True
    resampled: Mapping[str, Resampled] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        time = _frozen(self.time, f"{self.name}: time")
        if time.ndim != 1:
            raise BadInput(f"{self.name}: time must be one column, it has shape {time.shape}.")
        signals = {name: _frozen(values, f"{self.name}: signal {name}") for name, values in self.signals.items()}
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

    def __repr__(self) -> str:
        shown = [f"{name} [{pretty_unit(self.unit(name))}]" for name in list(self.signals)[:MOST_SHOWN]]
        more = len(self.signals) - len(shown)
        rate = f" at {1 / self.sample_time:.4g} Hz" if self.sample_time > 0 else ""
        runs = "1 run" if len(self.runs) == 1 else f"{len(self.runs)} runs"
        return (
            f"Recording {self.name}: {len(self)} rows in {runs}, {self.duration:.4g} s{rate}\n"
            f"  {', '.join(shown)}{f' and {more} more' if more > 0 else ''}"
        )

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def __contains__(self, name: object) -> bool:
        return name in self.signals

    def __getitem__(self, name: str) -> Array:
        if name not in self.signals:
            raise BadInput(
                f"{self.name} has no signal {name!r}. Its signals are {', '.join(self.signals) or 'none'}. "
                f"Map a column of the file to {name} in the column map."
            )
        return self.signals[name]

    @classmethod
    @understood
    def from_pandas(
        cls,
        table: pd.DataFrame,
        units: Mapping[str, str] | None = None,
        *,
        time: str = "time",
        name: str = "table",
        hold: Literal["zero", "linear"] = "zero",
    ) -> Recording:
        """A recording from a table in memory.

        Parameters
        ----------
        table : (n, columns) one row per sample; columns are named after their signals (`v_x`, `yaw_rate`, `steer` ...).
            Non-numeric columns are omitted, unless `units` names them.
        units : column -> unit of its values, such as "deg/s" or "km/h"; the SI unit if missing. For a column that is
            not a known signal, its unit.
        time : column with the time; in "s" unless `units` states another unit. Without such a column, the table's
            index.
        name : short name for tables and figures.
        hold : commands between rows: "zero" or "linear".

        Returns
        -------
        Recording
            Signals (n,) in SI units. A run ends where the step of time differs from the usual one.

        Raises
        ------
        BadInput
            A unit does not fit the quantity of its column, `units` names a missing column, or there is no time.

        Examples
        --------
        >>> import pandas as pd
        >>> import greybox_id as gb
        >>> table = pd.DataFrame({"time": [0.0, 0.1, 0.2], "yaw_rate": [0.0, 90.0, 180.0]})
        >>> gb.Recording.from_pandas(table, units={"yaw_rate": "deg/s"})["yaw_rate"].round(3)
        array([0.   , 1.571, 3.142])
        """
        if not hasattr(table, "columns") or not hasattr(table, "index"):
            raise BadInput(f"table: a pandas DataFrame is needed, not {type(table).__name__}.")
        stated = dict(units or {})
        columns = {str(column): table[column] for column in table.columns}
        for item in stated:
            if item not in columns and item != time:
                raise BadInput(f"units: {name} has no column {item!r}.{near_or_all(item, columns)}")
        clock = columns.pop(time, None)
        if clock is None and time != "time":
            raise BadInput(f"time: {name} has no column {time!r}.{near_or_all(time, columns)}")
        instants = _numbers(table.index if clock is None else clock, f"{name}: column {time!r}")
        factor = to_si(stated.get(time, "s"), "s").factor
        signals, extra = {}, {}
        for item, values in columns.items():
            if item not in stated and getattr(values.dtype, "kind", "O") not in "iufb":
                continue
            target = SIGNALS[item].unit if item in SIGNALS else None
            try:
                result = to_si(stated.get(item, target or "1"), target)
            except BadInput as error:
                raise BadInput(f"units[{item!r}]: {error}.") from error
            signals[item] = result.factor * _numbers(values, f"{name}: column {item!r}") + result.offset
            if item not in SIGNALS:
                extra[item] = result.unit
        return cls(name=name, time=factor * instants, signals=signals, extra_units=extra, hold=hold)

    def to_pandas(self) -> pd.DataFrame:
        """One row per sample: time, run (from 1), and every signal in its SI unit.

        Returns
        -------
        pandas.DataFrame
            (n, 2 + signals); units are in its `attrs["units"]`, by column.

        Examples
        --------
        >>> import greybox_id as gb
        >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")
        >>> lap.to_pandas()[["time", "run", "v_x"]].shape == (len(lap), 3)
        True
        """
        import pandas as pd

        run = np.zeros(len(self), dtype=int)
        for number, (start, stop) in enumerate(self.runs, 1):
            run[start:stop] = number
        table = pd.DataFrame({"time": self.time, "run": run, **self.signals})
        table.attrs["units"] = {"time": "s", **{signal: self.unit(signal) for signal in self.signals}}
        return table

    def unit(self, name: str) -> str:
        """SI unit of a signal of this recording."""
        return unit_of(name, self.extra_units.get(name, "1"))

    @cached_property
    def sample_time(self) -> float:
        """Usual time step within runs, s: the median of all steps within runs, or their mean.

        If stamps alternate between steps of 32 and 48 ms, the median is one of the two; the mean, 40 ms, is used then.
        """
        steps = [np.diff(self.time[start:stop]) for start, stop in self.runs]
        joined = np.concatenate(steps) if steps else np.empty(0)
        if not joined.size:
            return float("nan")
        median, mean = float(np.median(joined)), float(np.mean(joined))
        return mean if abs(mean - median) > BY_TURNS * abs(median) else median

    @property
    def duration(self) -> float:
        """Recorded time, s: the sum over runs, without gaps between them."""
        return float(sum(self.time[stop - 1] - self.time[start] for start, stop in self.runs))

    def has(self, *names: str) -> bool:
        """Whether the recording has all of these signals, each with at least one reading."""
        return all(name in self and bool(np.isfinite(self[name]).any()) for name in names)

    def require(self, names: Iterable[str], purpose: str) -> None:
        """Raise `BadInput` naming every signal of `names` that this recording lacks."""
        lacking = [name for name in names if name not in self.signals]
        if lacking:
            raise BadInput(
                f"{self.name} lacks {', '.join(lacking)}, which {purpose} needs. Its signals are "
                f"{', '.join(self.signals)}. "
                f"Name the column of {listed(lacking)} in the column map (‹columns›)."
            )

    def must_run(self) -> None:
        """Raise `BadInput` if time never advances from one row to the next: such a recording cannot be simulated."""
        if not self.sample_time > 0:
            rows = "a single row" if len(self) == 1 else f"{len(self)} rows, and in none of them does time advance"
            raise BadInput(
                f"{self.name} has {rows}. Its time may be reversed or constant: check it with greybox data check, and "
                "name the column of time in the column map (‹columns›)."
            )

    def each_run(self) -> Iterator[Recording]:
        """Each run as a separate recording."""
        for number, (start, stop) in enumerate(self.runs, 1):
            yield replace(self.rows(start, stop), name=f"{self.name}, run {number}")

    @understood
    def rows(self, start: int, stop: int) -> Recording:
        """The rows [start, stop), with the boundaries of runs kept."""
        inside = [(max(a, start) - start, min(b, stop) - start) for a, b in self.runs]
        return self.taken(slice(start, stop), ((a, b) for a, b in inside if b > a))

    def every(self, step: int) -> Recording:
        """Every `step`-th row of each run."""
        kept = [np.arange(start, stop, step) for start, stop in self.runs]
        ends = np.cumsum([0, *map(len, kept)]).tolist()
        return self.taken(np.concatenate(kept), zip(ends[:-1], ends[1:], strict=True))

    def taken(self, rows: slice | NDArray[np.intp] | NDArray[np.bool_], runs: Iterable[tuple[int, int]]) -> Recording:
        """Selected rows, by index or mask, with new runs."""
        signals = {name: values[rows] for name, values in self.signals.items()}
        return replace(self, time=self.time[rows], signals=signals, runs=tuple(runs))

    @understood
    def between(self, start: float | None = None, stop: float | None = None) -> Recording:
        """The rows from one time to another, s, both included; None for an open end.

        Raises
        ------
        BadInput
            No row lies in this interval.
        """
        low, high = (-np.inf if start is None else start), (np.inf if stop is None else stop)
        interval = f"{'' if start is None else f'{start:g}'}:{'' if stop is None else f'{stop:g}'}"
        kept = self.keep((self.time >= low) & (self.time <= high), f"between {interval} s")
        return replace(kept, source=replace(kept.source, between=interval))

    @understood
    def where(self, condition: str) -> Recording:
        """The rows in which a condition on signals and `time` is true, in the syntax of `condition.holds`.

        Rows in which a signal of the condition is missing are left out. A run ends where rows are left out.

        Raises
        ------
        BadInput
            The condition cannot be parsed, or is true in no row.
        """
        kept = self.keep(holds(condition, {**self.signals, "time": self.time}), f"where {condition}")
        return replace(kept, source=replace(kept.source, where=condition))

    def keep(self, rows: NDArray[np.bool_], words: str) -> Recording:
        """The rows of a mask (n,), described by `words`, such as "in motion". A run ends where rows are left out.

        Raises
        ------
        BadInput
            No row is kept.
        """
        if not np.any(rows):
            span = f"; time runs from {np.nanmin(self.time):g} to {np.nanmax(self.time):g} s" if len(self) else ""
            raise BadInput(f"{self.name} has no row {words}{span}. Select another part.")
        runs, count = [], np.concatenate(([0], np.cumsum(rows)))
        for start, stop in self.runs:
            edges = np.flatnonzero(np.diff(np.concatenate(([False], rows[start:stop], [False])).astype(int))) + start
            runs += [(int(count[a]), int(count[b])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
        note = f"{np.count_nonzero(rows)} of {len(self)} rows were selected: those {words}."
        return replace(self.taken(rows, runs), notes=(*self.notes, note))

    def with_signals(self, **signals: Array) -> Recording:
        """The same recording with signals added or replaced (SI units)."""
        return replace(self, signals={**self.signals, **signals})

    def mirrored(self) -> Recording:
        """The same drive with left and right swapped."""
        flipped = {n: -v if n in SIGNALS and SIGNALS[n].mirrors else v for n, v in self.signals.items()}
        return replace(self, name=f"{self.name}, mirrored", signals=flipped)


def join(recordings: Iterable[Recording], name: str) -> Recording:
    """Several recordings one after the other, in separate runs; only common signals are kept."""
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


def held_twice(recordings: Sequence[Recording], others: Sequence[Recording]) -> tuple[str, str] | None:
    """The first of others that holds the same data as one of these recordings: where both came from; None for none."""
    known = {one.source.sha256: one for one in recordings if one.source.sha256}
    for other in others:
        same = known.get(other.source.sha256)
        if any(other is one for one in recordings) or (
            same is not None and same.runs == other.runs and np.array_equal(same.time, other.time)
        ):
            first, second = (one.source.path or one.name for one in (other, same or other))
            return first, second
    return None


def split_runs(time: Array) -> tuple[tuple[int, int], ...]:
    """Row ranges [start, stop) in which time advances by its usual step.

    A new run begins where a step is zero, negative or differs from the usual one by more than `JITTER_TOLERANCE` of it.
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


def _frozen(values: object, where: str) -> Array:
    array = _numbers(values, where)
    if array is values and type(array) is np.ndarray and array.flags.owndata and not array.flags.writeable:
        return array  # shared with another recording: a copy of all columns of hours would be large
    array = np.array(array)
    array.setflags(write=False)
    return array


def _numbers(values: object, where: str) -> Array:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise BadInput(f"{where} holds something that is not a number ({error}).") from error
