"""Numeric columns prepared before they are interpreted: order of rows, placeholder numbers, units.

Also units of accelerations decided by gravity, applied after the other evidence.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...base.numbers import exact, number
from ...base.shorthands import Array
from ...base.units import known_unit
from ..checks.values import placeholders
from ..formats import Contents
from ..instants import newest_first
from .evidence import AXES, MapEntry
from .names import TIME, Guess, fits

_IN_BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$")
FEWEST_CODES = 2
"""Fewest rows of one number, far from all others, to count as a placeholder for missing readings."""
STANDING = 0.15
"""Relative distance from gravity within which an accelerometer's vertical axis reads gravity."""


def readings(
    result: Contents, guesses: Mapping[str, Guess], numbers: Mapping[str, Array]
) -> tuple[dict[str, Array], dict[str, tuple[float, ...]]]:
    """Numeric columns with the oldest row first and NaN for placeholder numbers; and the placeholders by column."""
    read, codes = dict(numbers), dict[str, tuple[float, ...]]()
    for group in result.groups:
        clocks = [numbers[n] for n, g in guesses.items() if g.signal == TIME and n in group.names and n in numbers]
        turned = any(map(newest_first, clocks))
        for name in group.names:
            if name not in numbers:
                continue
            read[name] = numbers[name][::-1] if turned else numbers[name]
            levels = tuple(level for level, _ in placeholders(numbers[name], FEWEST_CODES))
            if levels and not (name in guesses and guesses[name].signal == TIME):
                read[name], codes[name] = np.where(np.isin(read[name], levels), np.nan, read[name]), levels
    return read, codes


def with_codes(entry: MapEntry, codes: Mapping[str, tuple[float, ...]]) -> MapEntry:
    """An entry with the placeholder numbers of its column."""
    levels = codes.get(entry.column, ())
    if not levels or entry.missing:
        return entry
    why = f"missing: {' and '.join(exact(code, 6) for code in levels)} is far from all other values"
    return replace(entry, missing=levels, reasons=(*entry.reasons, why))


def in_no_unit(entry: MapEntry) -> MapEntry:
    """An entry whose column name ends in a unit that does not fit the signal: the user must state the scale."""
    bracket = _IN_BRACKETS.search(entry.column)
    stated = known_unit(bracket[1]) if bracket else ""
    if not stated or not entry.signal or fits(stated, entry.signal):
        return entry
    why = f"the file says {stated}, which is no unit of {entry.signal}: set divide_by to how many make one SI unit"
    return replace(entry, unit="", units=(), decided=False, reasons=(*entry.reasons, why))


def by_gravity(entries: Sequence[MapEntry], numbers: Mapping[str, Array]) -> list[MapEntry]:
    """Open units of accelerations, decided by the vertical axis of the same sensor, which reads gravity."""
    result = []
    for entry in entries:
        before, axis, after = entry.column.rpartition(AXES.get(entry.signal, " "))
        upright = numbers.get(f"{before}z{after}") if axis else None
        if entry.units and entry.signal in ("a_x", "a_y") and upright is not None and np.isfinite(upright).any():
            reads = abs(float(np.nanmedian(upright)))
            for unit, gravity in (("g", 1.0), ("m/s^2", 9.81)):
                if abs(reads / gravity - 1) < STANDING:
                    why = f"unit: {before}z{after} reads {number(reads, 3)}, which is gravity in {unit}"
                    entry = replace(entry, unit=unit, units=(), decided=True, reasons=(*entry.reasons[:-1], why))
        result.append(entry)
    return result
