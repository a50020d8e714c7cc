"""Primitives of which a plan is a chain, each with five numbers: amplitude, frequency, speed, duration, mean circle.

Laterally they are shares of the grip, which become steering at the speed of the row as the nominal vehicle needs it in
steady state: a plan then has the same meaning at every speed and for every size of vehicle. Shapes are those of ISO
7401 (step, sine, sweep), ISO 4138 (spiral), ISO 3888 (lane change), ISO 7975 (brake in turn) and NHTSA's sine with
dwell (FMVSS 126).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.shorthands import Array, Index
from .limits import DriveLimits

Shape = Callable[[Array, float], Array]
"""(share of the phase's time, cycles in it) -> share of the amplitude."""


def _through(shares: Sequence[float], values: Sequence[float]) -> Shape:
    """Linear interpolation between points."""
    return lambda s, cycles: np.asarray(np.interp(s, shares, values))


def _sine(s: Array, cycles: float) -> Array:
    return np.asarray(np.sin(2.0 * np.pi * max(round(cycles), 1) * s))


def _steps(s: Array, cycles: float) -> Array:
    return np.sign(_sine(s, cycles))


def _sweep(s: Array, cycles: float) -> Array:
    """A sine whose frequency grows fourfold; the mean frequency is that of `cycles`."""
    return _sine((4.0**s - 1.0) / 3.0, cycles)


_DWELL = _through([0, 0.08, 0.16, 0.24, 0.36, 0.45, 0.5], [0, 1, 0, -1, -1, 0, 0])
"""A sine held at its second peak for as long as a quarter of it."""


def _both_sides(one: Shape) -> Shape:
    """A shape to one side in the first half, to the other in the second."""
    return lambda s, cycles: np.where(s < 0.5, 1.0, -1.0) * one(s % 0.5, cycles)


SHAPES: Mapping[str, Shape] = {
    "turn": _through([0.0, 0.12, 0.85, 1.0], [0.0, 1.0, 1.0, 0.0]),
    "spiral": _through([0.0, 0.9, 1.0], [0.0, 1.0, 0.0]),
    "steps": _steps,
    "sine": _sine,
    "sweep": _sweep,
    "sine with dwell": _both_sides(_DWELL),
    "lane change": _both_sides(lambda s, cycles: _sine(s, 2.0)),
    "straight": _through([0.0, 1.0], [0.0, 0.0]),
}
"""Name of a primitive -> its steering over time. All of them may change speed on the way."""


@dataclass(frozen=True)
class Phase:
    """One primitive.

    Attributes
    ----------
    shape : one of `SHAPES`.
    amplitude : lateral acceleration as a share of the grip, positive to the left.
    frequency : Hz.
    speed : m/s, reached at three quarters of the phase.
    duration : s.
    lean : constant lateral acceleration in addition, as a share of the grip: the circle on which the shape is driven.
    """

    shape: str
    amplitude: float
    frequency: float
    speed: float
    duration: float
    lean: float = 0.0


@dataclass(frozen=True)
class Handling:
    """Properties of a vehicle that convert shares of the grip into steering.

    Attributes
    ----------
    length : wheelbase, m.
    understeer : rad s^2/m.
    grip : largest steady lateral acceleration, m/s^2.
    """

    length: float
    understeer: float
    grip: float


@dataclass(frozen=True)
class PlannedDrive:
    """Planned steering and speed of a chain of phases, row by row.

    Attributes
    ----------
    time : (n,) s.
    steer : (n,) rad at the road wheels.
    speed : (n,) m/s.
    phase : (n,) index of the phase a row belongs to; the last one is the stop.
    """

    time: Array
    steer: Array
    speed: Array
    phase: Index


def chained(
    phases: Sequence[Phase], vehicle: Handling, limits: DriveLimits, duration: float, rate: float
) -> PlannedDrive:
    """Chain phases; the end is straight and slow.

    Parameters
    ----------
    phases : at least one; their durations are scaled so that the chain lasts `duration`.
    vehicle, limits : by which steering and speed are computed.
    duration, rate : s, rows a second.
    """
    rows = max(int(round(duration * rate)), 10)
    last = limits.speed_min
    stop = min(0.5 * duration, max(phases[-1].speed - last, 0.0) / (0.8 * limits.brake_max) + 0.06 * duration)
    share = np.array([phase.duration for phase in phases])
    edges = np.round(np.concatenate(([0.0], np.cumsum(share) / np.sum(share))) * (rows - stop * rate)).astype(int)
    turn, speed, number = np.zeros(rows), np.full(rows, last), np.full(rows, len(phases), dtype=np.intp)
    before, leant = phases[0].speed, 0.0
    for k, (phase, a, b) in enumerate(zip(phases, edges[:-1], edges[1:], strict=True)):
        s = (np.arange(b - a) + 0.5) / max(b - a, 1)
        lean = leant + (phase.lean - leant) * np.interp(s, [0.0, 0.15], [0.0, 1.0])
        turn[a:b] = lean + phase.amplitude * SHAPES[phase.shape](s, phase.frequency * (b - a) / rate)
        speed[a:b] = before + (phase.speed - before) * np.interp(s, [0.15, 0.75], [0.0, 1.0])
        number[a:b], before, leant = k, phase.speed, phase.lean
    if edges[-1] < rows:
        stretch = np.linspace(0.0, 1.0, rows - edges[-1])
        turn[edges[-1] :] = leant * np.interp(stretch, [0.0, 0.25], [1.0, 0.0])
        speed[edges[-1] :] = before + (last - before) * np.interp(stretch, [0.1, 0.9], [0.0, 1.0])
    speed = _reachable(np.clip(speed, limits.speed_min, limits.speed_max), limits, rate)
    steer = turn * vehicle.grip * (vehicle.length / speed**2 + max(vehicle.understeer, 0.0))
    steer = np.clip(steer, -limits.steer_max, limits.steer_max)
    return PlannedDrive(np.arange(rows) / rate, _no_faster(steer, limits.steer_rate / rate), speed, number)


def _reachable(speed: Array, limits: DriveLimits, rate: float) -> Array:
    """Speeds that accelerations within the limits can follow, no faster than planned."""
    result, up, down = speed.copy(), 0.9 * limits.drive_max / rate, 0.9 * limits.brake_max / rate
    for k in range(1, len(result)):
        result[k] = min(result[k], result[k - 1] + up)
    for k in range(len(result) - 2, -1, -1):
        result[k] = min(result[k], result[k + 1] + down)
    return result


def _no_faster(steer: Array, most: float) -> Array:
    """Steering that changes by at most `most` per row, from straight ahead on."""
    result, now = np.empty_like(steer), 0.0
    for k, target in enumerate(steer):
        now += min(max(target - now, -most), most)
        result[k] = now
    return result
