"""Road-wheel or hand-wheel angle: what a steering column holds, judged by the vehicle's yaw rate.

At small lateral acceleration steer = ratio · (L + K v_x²) · yaw_rate / v_x: a regression on yaw_rate / v_x and
yaw_rate · v_x separates ratio · L from understeer. Source: Rajamani, Vehicle Dynamics and Control, 2nd ed., eq. 3.7.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.numbers import number
from ..recording import Recording
from .evidence import FAST, RATIOS, MapEntry, sizes_of

LENGTHS = (0.5, 2.0)
"""Range of ratio · L over wheelbase for road-wheel angles: tyre nonlinearity and scale errors are allowed for."""
CARS = (2.0, 3.8)
"""Wheelbases of cars, m, for fast vehicles whose wheelbase is not stated."""
LONGEST = 15.0
"""m: longest possible wheelbase, including tyre nonlinearity."""
GENTLE = 4.0
"""Lateral acceleration, m/s², up to which tyres are taken as linear."""
LEAST_ROWS = 100
FACTORS = {"rad": 1.0, "deg": float(np.pi / 180)}


@dataclass(frozen=True)
class Reading:
    """One interpretation of a steering column.

    Attributes
    ----------
    unit : of the column.
    ratio : hand-wheel over road-wheel angle; 1 for road-wheel angles.
    """

    unit: str
    ratio: float


def with_steering(
    entry: MapEntry, known: Recording, hand_wheel: bool, wheelbase: float | None, stated: bool = False
) -> MapEntry:
    """The entry of `steer` decided by the vehicle's yaw rate; a question unless it is plainly the road-wheel angle.

    Parameters
    ----------
    entry : the proposal, with its unit if decided or stated.
    known : all signals in SI units, steer as in the entry.
    hand_wheel : whether the column's name means the hand wheel.
    wheelbase : m, if known.
    stated : whether the file states the entry's unit.
    """
    length = turning_length(known)
    if length is None:
        return _unknown(entry) if hand_wheel else _either(entry) if entry.unit == "deg" else entry
    in_radians = length / entry.factor  # if the column were in radians
    units = {entry.unit: entry.factor} if stated and entry.unit in FACTORS else FACTORS
    fast = sizes_of(known).get("v_x", 0.0) > FAST
    shortest, longest = (wheelbase, wheelbase) if wheelbase else CARS
    road = [Reading(u, 1.0) for u, f in units.items() if LENGTHS[0] * shortest < in_radians * f < LENGTHS[1] * longest]
    if not wheelbase and not fast and entry.unit in FACTORS and length > LONGEST:
        return _unknown(entry, length)
    if not wheelbase and not fast:
        return _unknown(entry, in_radians * units[entry.unit or "rad"]) if hand_wheel else entry
    if road and not hand_wheel:
        return entry if any(item.unit == (entry.unit or "rad") for item in road) else _asked(entry, road, length)
    middle = wheelbase or float(np.sqrt(shortest * longest))
    wheel = [
        Reading(unit, float(f"{in_radians * factor / middle:.3g}"))
        for unit, factor in units.items()
        if RATIOS[0] * shortest / middle < in_radians * factor / middle < RATIOS[1] * longest / middle
    ]
    if wheel:
        return _asked(entry, wheel, in_radians)
    return _unknown(entry) if hand_wheel else _no_angle(entry, in_radians * units.get(entry.unit, 1.0))


def turning_length(known: Recording) -> float | None:
    """Steering ratio times wheelbase, m, from steering in rad, speed and yaw rate; None if they do not determine it.

    If no yaw rate is recorded, v_x · curvature replaces it, else a_y / v_x, which equals it in a steady turn.
    """
    if not known.has("v_x", "steer"):
        return None
    v, steer = known["v_x"], known["steer"]
    if "yaw_rate" in known:
        turn = known["yaw_rate"]
    elif "curvature" in known:
        turn = v * known["curvature"]
    elif "a_y" in known:
        turn = np.divide(known["a_y"], v, out=np.full(len(v), np.nan), where=v != 0)
    else:
        return None
    rows = np.isfinite(v) & np.isfinite(steer) & np.isfinite(turn) & (np.abs(v) > 0.1 * np.nanmax(np.abs(v)))
    rows &= np.abs(v * turn) < GENTLE
    if np.count_nonzero(rows) < LEAST_ROWS:
        return None
    v, steer, turn = v[rows], steer[rows], turn[rows]
    design = np.column_stack([turn / v, turn * v, np.ones(len(v))])
    best, _, rank, _ = np.linalg.lstsq(design, steer, rcond=None)
    left = steer - design @ best
    return float(abs(best[0])) if rank == 3 and np.var(left) < 0.5 * np.var(steer) and best[0] else None


def _asked(entry: MapEntry, readings: list[Reading], in_radians: float) -> MapEntry:
    """The entry as a question, with its most plausible answer."""
    best = readings[0]
    if best.ratio == 1.0:
        why = f"this explains the turns if its unit is {best.unit}"
    else:
        others = f" (or {readings[1].ratio:g} in {readings[1].unit})" if len(readings) > 1 else ""
        why = (
            f"this is the hand wheel's angle with a steering ratio of about {best.ratio:g}{others}: set divide_by to "
            "the "
            "true ratio"
        )
    length = number(in_radians * FACTORS[best.unit], 2)
    known = f"in {best.unit}, steering ratio times wheelbase is {length} m: {why}"
    return replace(
        entry, unit=best.unit, units=(), divide_by=best.ratio, decided=False, reasons=(*entry.reasons, known)
    )


def _no_angle(entry: MapEntry, length: float) -> MapEntry:
    """A column that steers the vehicle but is an angle of neither wheel: a command in other units."""
    why = (
        f"in {entry.unit or 'rad'}, steering ratio times wheelbase is {number(length, 2)} m, which fits neither road "
        f"wheels nor a hand wheel. If it is a share of full lock, or counts, set divide_by: how many make one unit"
    )
    return replace(entry, decided=False, reasons=(*entry.reasons, why))


def _unknown(entry: MapEntry, length: float | None = None) -> MapEntry:
    """A hand-wheel angle of unknown ratio, or one estimated with a car's usual wheelbase as a starting value."""
    why, ratio = "this is the hand wheel's angle, so set divide_by to the steering ratio", entry.divide_by
    if length:
        why += f"; judging by yaw rate and speed, this ratio times the wheelbase is about {number(length, 3)} m"
    if length and length > LONGEST:
        ratio = float(f"{length / np.sqrt(CARS[0] * CARS[1]):.3g}")
        why += f", a ratio of {ratio:g} for a car of usual length"
    # a wheelbase computed for road-wheel angles would contradict this reason
    reasons = [item for item in entry.reasons if "gives a wheelbase" not in item]
    return replace(entry, divide_by=ratio, decided=False, reasons=(*reasons, why))


def _either(entry: MapEntry) -> MapEntry:
    """Degrees of either wheel, if nothing decides which."""
    why = (
        "nothing in the file shows whether this is the angle of the road wheels or of the hand wheel; if it is the "
        "hand "
        "wheel's, set divide_by to the steering ratio"
    )
    return replace(entry, decided=False, reasons=(*entry.reasons, why))
