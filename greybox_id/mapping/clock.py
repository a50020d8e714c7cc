"""Which column is time, and in which unit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..datasets.formats import Group
from ..datasets.formats.contents import TIME
from ..recording import Array
from .entry import MapEntry
from .names import Guess

EPOCHS = (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8))
"""Counts since 1970, by unit: today's are larger than this."""
SLOWEST, FASTEST = 1.0, 2e4
"""Sample rates of vehicle recordings in Hz lie between these."""


def time_of(group: Group, guesses: Mapping[str, Guess], numbers: Mapping[str, Array]) -> MapEntry | None:
    """The time of a table, from its name or as the only column that runs on in even steps; None if there is none."""
    named = sorted((g.rank, name) for name, g in guesses.items() if g.signal == TIME and name in numbers)
    if group.clock and group.clock_unit:
        return MapEntry(TIME, group.clock, group.clock_unit, reasons=("the file's own clock",))
    if named:
        name = named[0][1]
        return _in_unit(name, guesses[name].unit or group.units.get(name, ""), numbers[name], "its name")
    even = [name for name, values in numbers.items() if _runs_on(values)]
    return (
        _in_unit(even[0], "", numbers[even[0]], "the only column that runs on in even steps")
        if len(even) == 1
        else None
    )


def _in_unit(name: str, stated: str, values: Array, why: str) -> MapEntry:
    if stated:
        return MapEntry(TIME, name, stated, reasons=(why, "unit: as the file states it"))
    steps = np.diff(values[np.isfinite(values)])
    step = float(np.median(steps[steps > 0])) if np.any(steps > 0) else float("nan")
    first = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    for unit, size in EPOCHS:
        if first > size:
            return MapEntry(TIME, name, unit, reasons=(why, f"unit: {first:.3g} counts {unit} since 1970"))
    units = [
        u for u, second in (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)) if SLOWEST <= second / step <= FASTEST
    ]
    whole = bool(np.all(values[np.isfinite(values)] % 1 == 0))
    if not whole and "s" in units:
        units = ["s"]  # fractions of a millisecond are rarely written down
    if step == 1 and whole:
        reason = "counts rows; write the unit of one step, and divide_by if it is not one of its own"
        return MapEntry(TIME, name, "", decided=False, units=("s", "ms"), reasons=(why, reason))
    if units:
        likely = units[0] if len(units) == 1 or not whole else units[-1] if step >= 1e4 else units[0]
        return MapEntry(
            TIME, name, likely, reasons=(why, f"unit: its usual step of {step:.3g} is a sample time in {likely}")
        )
    return MapEntry(
        TIME, name, "", decided=False, units=("s", "ms"), reasons=(why, f"a step of {step:.3g} is no sample time")
    )


def _runs_on(values: Array) -> bool:
    """Whether a column goes up in nearly even steps, but for a few joins."""
    if len(values) < 10 or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    usual = float(np.median(steps))
    return usual > 0 and float(np.mean(np.abs(steps - usual) < 0.2 * usual)) > 0.95
