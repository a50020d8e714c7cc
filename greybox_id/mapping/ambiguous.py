"""Names that mean two things: phi is a roll angle or the heading, omega the yaw rate or the speed of a wheel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..recording import Recording
from .entry import MapEntry
from .evidence import met, sizes_of
from .names import Guess

LEANS = ("roll", "pitch")
FARTHEST = 1.0
"""rad: a vehicle that rolls or pitches so far has turned over."""
AGREES = 0.7
"""Correlation of its rate with the yaw rate from which an angle is the heading."""
UNITS = {"rad": 1.0, "deg": float(np.pi / 180)}


def headings(
    chosen: Sequence[MapEntry], guesses: Mapping[str, Guess], raw: Recording
) -> tuple[list[MapEntry], Recording]:
    """The entries with ambiguous angles taken as yaw where their rate agrees with the yaw rate, and the raw signals.

    Parameters
    ----------
    chosen : one entry for each signal.
    guesses : by column.
    raw : signals as the file holds them.
    """
    taken = {entry.signal for entry in chosen}
    found = []
    for entry in chosen:
        if entry.signal in LEANS and guesses[entry.column].else_ and "yaw" not in taken and entry.signal in raw:
            told = _as_yaw(raw, entry)
            if told:
                taken.add("yaw")
                raw = raw.with_signals(yaw=raw[entry.signal])
                entry = replace(entry, signal="yaw", unit=told[0], reasons=(told[1],))
        found.append(entry)
    return found, raw


def ambiguous(entry: MapEntry, own: Guess, raw: Recording) -> MapEntry:
    """An entry whose name means two things, as a question that says what else it may be."""
    if not own.else_:
        return entry
    if entry.signal == "yaw":
        return replace(entry, decided=False)  # by its rate, and against what its name is often used for
    if entry.signal in LEANS:
        size = sizes_of(raw)[entry.signal] * (entry.factor if entry.units == () else 1.0)
        if "yaw" in raw and size < FARTHEST:
            return entry
        why = f'"{entry.column}" is also what {own.else_} is called'
        return replace(
            entry, decided=False, reasons=(*entry.reasons, f"{why}: then write yaw instead of {entry.signal}")
        )
    why = f'"{entry.column}" is also what {own.else_} is called'
    return replace(entry, decided=False, reasons=(*entry.reasons, why))


def _as_yaw(raw: Recording, entry: MapEntry) -> tuple[str, str] | None:
    """The unit in which an angle's rate agrees with the yaw rate or the course, and how well."""
    best: tuple[float, str, str] | None = None
    for unit, factor in UNITS.items() if not entry.unit else ((entry.unit, entry.factor),):
        for own in met(raw.with_signals(yaw=raw[entry.signal] * factor)):
            if "yaw" in own.pair.nodes and abs(own.agreed.correlation) > AGREES:
                words = f'"{entry.column}" may be roll or heading; {own.pair.left} follows its rate (correlation '
                told = (abs(own.agreed.correlation), unit, f"{words}{own.agreed.correlation:.2f})")
                best = max(best, told) if best else told
    return (entry.unit, best[2]) if best else None
