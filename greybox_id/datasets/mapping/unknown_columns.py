"""Columns with meaningless or ambiguous names: signals that their values are compatible with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...base.numbers import exact, number, signed
from ...base.shorthands import Array
from ...base.signals import SIGNALS
from ...base.units import to_si
from ..recording import Recording
from .evidence import MARGIN, USUAL, MapEntry, Met, met, misfit, sizes_of
from .names import Guess

LEANS = ("roll", "pitch")
FARTHEST = 1.0
"""rad: roll or pitch angle at which a vehicle has turned over."""
AGREES = 0.7
"""Correlation of an angle's rate with the yaw rate from which the angle is the heading."""
UNITS = {"rad": 1.0, "deg": float(np.pi / 180)}


def headings(
    chosen: Sequence[MapEntry], guesses: Mapping[str, Guess], raw: Recording
) -> tuple[list[MapEntry], Recording]:
    """The entries with ambiguous angles taken as yaw if their rate follows the yaw rate, and the raw signals.

    Parameters
    ----------
    chosen : one entry per signal.
    guesses : by column.
    raw : signals in the file's units.
    """
    taken = {entry.signal for entry in chosen}
    result = []
    for entry in chosen:
        if entry.signal in LEANS and guesses[entry.column].else_ and "yaw" not in taken and entry.signal in raw:
            yaw = _as_yaw(raw, entry)
            if yaw:
                taken.add("yaw")
                raw = raw.with_signals(yaw=raw[entry.signal])
                entry = replace(entry, signal="yaw", unit=yaw[0], reasons=(yaw[1],))
        result.append(entry)
    return result, raw


def ambiguous(entry: MapEntry, guess: Guess, raw: Recording) -> MapEntry:
    """An entry with an ambiguous name as a question that states the other meaning."""
    if not guess.else_:
        return entry
    if entry.signal == "yaw":
        return replace(entry, decided=False)  # taken as yaw by its rate, although its name often means something else
    if entry.signal in LEANS:
        size = sizes_of(raw)[entry.signal] * (entry.factor if entry.units == () else 1.0)
        if "yaw" in raw and size < FARTHEST:
            return entry
        why = f'"{entry.column}" is also a usual name of {guess.else_}'
        return replace(
            entry, decided=False, reasons=(*entry.reasons, f"{why}: if it is that, write yaw instead of {entry.signal}")
        )
    why = f'"{entry.column}" is also a usual name of {guess.else_}'
    return replace(entry, decided=False, reasons=(*entry.reasons, why))


def _as_yaw(raw: Recording, entry: MapEntry) -> tuple[str, str] | None:
    """The unit in which an angle's rate follows the yaw rate or the course, with the reason in words."""
    best: tuple[float, str, str] | None = None
    for unit, factor in UNITS.items() if not entry.unit else ((entry.unit, entry.factor),):
        for item in met(raw.with_signals(yaw=raw[entry.signal] * factor)):
            if "yaw" in item.pair.nodes and abs(item.agreed.correlation) > AGREES:
                words = f'"{entry.column}" may be roll or heading; {item.pair.left} follows its rate (correlation '
                candidate = (abs(item.agreed.correlation), unit, f"{words}{number(item.agreed.correlation, 2)})")
                best = max(best, candidate) if best else candidate
    return (entry.unit, best[2]) if best else None


SOUGHT = ("v_x", "yaw_rate", "steer", "a_x", "a_y")
"""Signals that other signals determine, and that most models use as inputs or outputs."""
ALIKE = 0.85
"""Correlation from which a column may be the signal it is compared with."""


def strangers(
    known: Recording, unknown: Sequence[MapEntry], numbers: Mapping[str, Array], settled: set[str]
) -> list[MapEntry]:
    """The unknown columns, each as the signal it agrees best with; without agreement, only columns with a known name.

    Parameters
    ----------
    known : the known signals, in SI units.
    unknown : columns with a doubtful name, or (signal "") a meaningless one.
    numbers : (n,) values of each.
    settled : decided signals: columns with a meaningless name are not compared with them.
    """
    speed = sizes_of(known).get("v_x", 0.0)
    result: dict[str, MapEntry] = {}
    for _ in range(2):  # a speed proposed in the first round helps to recognise the steering in the second
        for entry in unknown:
            values = numbers[entry.column]
            if entry.column in result or len(values) != len(known):
                continue
            sought = (entry.signal,) if entry.signal else tuple(s for s in SOUGHT if s not in settled)
            matches = [(s, m) for s in sought for m in _matches(known, s, values)]
            if matches:
                signal, best = max(matches, key=lambda item: abs(item[1].agreed.correlation))
                result[entry.column] = _described(entry, signal, best, speed)
            elif "steer" in sought and (counts := _counts(entry, known, values)):
                result[entry.column] = counts
        further = {one.signal: numbers[one.column] for one in result.values() if one.signal not in known}
        if "v_x" not in further:
            break
        known = known.with_signals(v_x=further["v_x"])
    return [result.get(entry.column, entry) for entry in unknown if entry.column in result or entry.signal]


def _counts(entry: MapEntry, known: Recording, values: Array) -> MapEntry | None:
    """A column as servo counts about their centre, if these follow the vehicle's yaw rate."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    centre = float(np.median(finite))
    matches = _matches(known, "steer", values - centre)
    if not matches:
        return None
    best = max(matches, key=lambda item: abs(item.agreed.correlation))
    other = best.pair.right if best.pair.nodes[0] == "steer" else best.pair.left
    why = (
        f"its distance from {exact(centre, 4)} agrees with {other} (correlation "
        f"{signed(best.agreed.correlation, 2)}): counts of a servo? In lookup, write the angles of the road wheels "
        "below the counts at which you measured them"
    )
    ends = (float(finite.min()), centre, float(finite.max()))
    return replace(entry, signal="steer", reasons=(*entry.reasons, why), units=("rad",), ends=ends)


def _matches(known: Recording, signal: str, values: Array) -> list[Met]:
    if signal not in SOUGHT or not np.isfinite(values).any():
        return []
    agreed = met(known.with_signals(**{signal: values}))
    return [m for m in agreed if signal in m.pair.nodes and abs(m.agreed.correlation) >= ALIKE]


def _described(entry: MapEntry, signal: str, best: Met, speed: float) -> MapEntry:
    first = best.pair.nodes[0] == signal
    why = (
        f"agrees with {best.pair.right if first else best.pair.left} (correlation {signed(best.agreed.correlation, 2)})"
    )
    units = tuple(
        unit
        for unit in USUAL.get(SIGNALS[signal].unit, ())
        if misfit(_in_unit(best, signal, unit), speed=speed) < MARGIN
    ) or (SIGNALS[signal].unit,)
    sign = 1 if best.agreed.correlation > 0 else -1
    name = () if entry.reasons else ("its name says nothing",)
    return replace(entry, signal=signal, sign=sign, units=entry.units or units, reasons=(*name, *entry.reasons, why))


def _in_unit(best: Met, signal: str, unit: str) -> Met:
    """The agreement if the column had this unit."""
    factor = to_si(unit, SIGNALS[signal].unit).factor
    gain = best.agreed.gain * (factor if best.pair.nodes[0] == signal else 1 / factor)
    return replace(best, agreed=replace(best.agreed, gain=gain))
