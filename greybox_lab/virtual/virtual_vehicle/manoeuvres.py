"""Plans of manoeuvres for a driver: laps, sweeps, steps, braking, and all of them one after the other.

A plan has one row per row of the recording, see `layout.PLAN`. Lateral requests are accelerations within a share of the
grip, which the driver converts to steering angles at the present speed with the stated vehicle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import nan, pi

import numpy as np

from greybox_id.base.errors import BadInput

from ..speed_profile import speed_profile
from .layout import FOLLOW, OPEN_DRIVE, PLAN, ROAD, SPEED, TURN, Grid, Row
from .scale import Scale

_Piece = Callable[[Scale, int, float, np.random.Generator], Grid]

_LIVELY = 3.0
"""Highest frequency of steering, Hz."""


def _plan(rows: int) -> Grid:
    return np.zeros((rows, PLAN))


def _noise(rows: int, rate: float, slow: float, fast: float, rng: np.random.Generator) -> Row:
    """A smooth signal with rms one and frequencies from slow to fast, Hz."""
    time = np.arange(rows) / rate
    frequencies = np.exp(rng.uniform(np.log(slow), np.log(fast), 12))
    waves = [np.sin(2.0 * np.pi * (f * time + rng.random())) for f in frequencies]
    return np.asarray(np.sum(waves, axis=0) / np.sqrt(6.0), float)


def _speeds(size: Scale, rows: int, rate: float, mean: float, swing: float, rng: np.random.Generator) -> Row:
    """Speed, m/s, that varies slowly around a share of the top speed."""
    share = mean + swing * _noise(rows, rate, 0.06, 0.25, rng)
    return np.clip(share * size.top_speed, 1.1 * size.least_speed, size.top_speed)


def lap(size: Scale, rows: int, rate: float, rng: np.random.Generator) -> Grid:
    """Along the road, with slightly livelier steering than necessary."""
    plan = _plan(rows)
    plan[:, FOLLOW], plan[:, SPEED] = 1.0, nan
    plan[:, TURN] = 0.07 * size.grip * _noise(rows, rate, 0.5, _LIVELY, rng)
    return plan


def sweep(size: Scale, rows: int, rate: float, rng: np.random.Generator) -> Grid:
    """Slalom of increasing frequency."""
    plan, share = _plan(rows), np.linspace(0.0, 1.0, rows)
    frequency = 0.25 * (_LIVELY / 0.25) ** share
    phase = 2.0 * np.pi * np.cumsum(frequency) / rate
    plan[:, TURN] = rng.uniform(0.45, 0.62) * size.grip * np.sin(phase) * (1.0 - 0.4 * share)
    plan[:, SPEED] = _speeds(size, rows, rate, rng.uniform(0.45, 0.75), 0.03, rng)
    return plan


def steps(size: Scale, rows: int, rate: float, rng: np.random.Generator) -> Grid:
    """Steps of the steering to both sides, each held for half a second to two."""
    plan, at, side = _plan(rows), 0, 1.0
    while at < rows:
        lasts = int(rate * rng.uniform(0.5, 2.0) * max(size.time, 0.6))
        size_of_step = rng.choice([0.0, rng.uniform(0.15, 0.6), rng.uniform(0.4, 0.72)], p=[0.25, 0.4, 0.35])
        plan[at : at + lasts, TURN] = side * size_of_step * size.grip
        side = -side if rng.random() < 0.8 else side
        at += lasts
    plan[:, SPEED] = _speeds(size, rows, rate, rng.uniform(0.45, 0.75), 0.1, rng)
    return plan


def weave(size: Scale, rows: int, rate: float, rng: np.random.Generator) -> Grid:
    """Random steering at varying speeds."""
    plan = _plan(rows)
    turn = 0.28 * _noise(rows, rate, 0.15, _LIVELY, rng)
    plan[:, TURN] = size.grip * np.clip(turn, -0.6, 0.6)
    plan[:, SPEED] = _speeds(size, rows, rate, rng.uniform(0.5, 0.7), 0.15, rng)
    return plan


def brake_in_turn(size: Scale, rows: int, rate: float, rng: np.random.Generator) -> Grid:
    """Turns with braking or acceleration in each."""
    plan, at, side = _plan(rows), 0, 1.0
    period = max(6.0 * size.time, 3.5)
    while at < rows:
        count = int(period * rate)
        t = np.arange(count) / rate / period
        value = slice(at, min(at + count, rows))
        n = value.stop - value.start
        turn = np.interp(t, [0.05, 0.15, 0.6, 0.7], [0.0, 1.0, 0.75, 0.0])
        fast, slow = rng.uniform(0.75, 0.95), rng.uniform(0.4, 0.6)
        ends = (fast, slow) if rng.random() < 0.75 else (slow, fast)
        plan[value, TURN] = (side * rng.uniform(0.4, 0.65) * size.grip * turn)[:n]
        plan[value, SPEED] = (
            size.top_speed * np.interp(t, [0.0, 0.25, 0.32, 0.65, 1.0], [*ends[:1] * 2, *ends[1:] * 2, fast])[:n]
        )
        side, at = -side, at + count
    return plan


def accelerate(size: Scale, rows: int, rate: float, rng: np.random.Generator) -> Grid:
    """Strong acceleration and braking, nearly straight."""
    plan, at = _plan(rows), 0
    slow = True
    while at < rows:
        lasts = int(rate * rng.uniform(1.5, 4.0) * max(size.time, 0.5))
        share = rng.uniform(0.85, 1.0) if slow else rng.uniform(0.35, 0.55)
        plan[at : at + lasts, SPEED] = share * size.top_speed
        slow, at = not slow, at + lasts
    plan[:, TURN] = 0.06 * size.grip * _noise(rows, rate, 0.3, _LIVELY, rng)
    return plan


def coast(size: Scale, rows: int, rate: float, rng: np.random.Generator) -> Grid:
    """Coasting without drive and brakes."""
    plan = _plan(rows)
    plan[:, SPEED] = nan
    plan[:, TURN] = 0.05 * size.grip * _noise(rows, rate, 0.3, _LIVELY, rng)
    return plan


def straight(size: Scale, rows: int, speed: float) -> Grid:
    """Straight driving at a speed, m/s."""
    plan = _plan(rows)
    plan[:, SPEED] = max(speed, 1.1 * size.least_speed)
    return plan


PIECES: Mapping[str, _Piece] = {
    "laps": lap,
    "slalom": sweep,
    "steps": steps,
    "weave": weave,
    "brake_in_turn": brake_in_turn,
    "acceleration": accelerate,
    "coast_down": coast,
}
_MIX = {"laps": 0.34, "slalom": 0.14, "steps": 0.15, "weave": 0.09, "brake_in_turn": 0.13, "acceleration": 0.15}
MANOEUVRES = ("mixed", *PIECES)
"""Names of manoeuvres; "mixed" is all of them one after the other, in random order."""


def planned(
    name: str, size: Scale, rows: int, run_in: int, rate: float, road_speed: float, rng: np.random.Generator
) -> Grid:
    """The plan of a manoeuvre.

    Parameters
    ----------
    name : one of `MANOEUVRES`.
    size : of the vehicle.
    rows, run_in : number of rows of the recording, and of straight driving before.
    rate : rows per second.
    road_speed : at the beginning of the road, m/s.
    rng : random generator.

    Returns
    -------
    plan : (run_in + rows, `PLAN`).

    Raises
    ------
    BadInput : if the manoeuvre is unknown.
    """
    if name not in MANOEUVRES:
        raise BadInput(f"There is no manoeuvre {name}; choose one of {', '.join(MANOEUVRES)}.")
    mixed = name == "mixed"
    body = _mixed(size, rows, rate, road_speed, rng) if mixed else [PIECES[name](size, rows, rate, rng)]
    joined = np.concatenate(body)[:rows]
    first = joined[0, SPEED]
    if np.isnan(first):
        first = 0.9 * road_speed if joined[0, FOLLOW] > 0.0 else 0.9 * size.top_speed
    return np.concatenate([straight(size, run_in, float(first)), joined])


def _mixed(size: Scale, rows: int, rate: float, road_speed: float, rng: np.random.Generator) -> list[Grid]:
    order = [str(name) for name in rng.permutation(list(_MIX))]
    between = int(rate * 1.2 * max(size.time, 0.6))
    coasting = int(rate * 3.0 * max(size.time, 0.6))
    left = rows - between * len(order) - coasting
    body: list[Grid] = []
    for name in order:
        piece = PIECES[name](size, max(int(left * _MIX[name]) + 1, 2), rate, rng)
        speed = piece[0, SPEED]
        body += [straight(size, between, 0.9 * road_speed if np.isnan(speed) else float(speed)), piece]
        if name == "acceleration":
            piece[-int(1.5 * rate) :, SPEED] = 0.95 * size.top_speed  # coasting starts from here
            body.append(coast(size, coasting, rate, rng))
    body.append(straight(size, between, 0.6 * size.top_speed))
    return body


def robot(steer: Row, drive: Row) -> Grid:
    """A plan of given commands: steering, rad, and drive, in the unit of its channel; (rows,) each."""
    plan = _plan(len(steer))
    plan[:, FOLLOW], plan[:, TURN], plan[:, OPEN_DRIVE], plan[:, SPEED] = -1.0, steer, drive, nan
    return plan


def steering_robot(steer: Row, speed: Row) -> Grid:
    """A plan of given steering, rad, at a speed that the driver keeps, m/s; (rows,) each."""
    plan = robot(steer, np.zeros(len(steer)))
    plan[:, SPEED] = speed
    return plan


_POINTS = 4096


def closed_road(size: Scale, usage: float, rng: np.random.Generator) -> tuple[Grid, float]:
    """A random closed road, and the speeds at which a vehicle uses a share of its grip on it.

    Parameters
    ----------
    size : of the vehicle: the narrowest curves can be driven slightly above its least speed.
    usage : share of the grip that is used.
    rng : random generator of the road.

    Returns
    -------
    road : (n, ROAD) x, y, yaw, curvature, speed, starting at (0, 0, 0).
    spacing : between points, m.
    """
    length = size.top_speed * size.time * rng.uniform(16.0, 26.0)
    slow = 1.15 * size.least_speed
    narrowest = max(slow**2 / (usage * size.grip), 4.0 * size.length, 1.25 * size.length / size.steer_max)
    shape = rng.normal(0.0, 1.0, 6) / np.arange(2.0, 8.0) ** 0.8, rng.uniform(0.0, 2.0 * pi, 6)
    swing = 0.45
    while True:
        x, y, yaw, curvature, step = _drawn(swing * shape[0], shape[1], length)
        if np.max(np.abs(curvature)) < 1.0 / narrowest:
            break
        swing *= 0.93
        length *= 1.01
    if rng.random() < 0.5:
        y, yaw, curvature = -y, -yaw, -curvature
    road = np.zeros((len(x), ROAD))
    most = {"grip": usage * size.grip, "drive": usage * size.drive, "brake": usage * size.brake}
    speeds = speed_profile(curvature, step, top_speed=size.top_speed, **most)
    for k, column in enumerate((x, y, yaw, curvature, speeds)):
        road[:, k] = column
    return road, step


def _drawn(swing: Row, phase: Row, length: float) -> tuple[Row, Row, Row, Row, float]:
    """A closed curve with varying distance from its centre, scaled to a length, at equal steps from the origin."""
    angle = np.arange(_POINTS) * (2.0 * pi / _POINTS)
    radius = 1.0 + sum(a * np.cos(k * angle + p) for k, a, p in zip(range(2, 8), swing, phase, strict=True))
    radius = np.maximum(radius, 0.15)
    curve = radius * np.exp(1j * angle)
    steps = np.abs(np.roll(curve, -1) - curve)
    along = np.concatenate(([0.0], np.cumsum(steps)))
    n = 1200
    at = np.linspace(0.0, along[-1], n, endpoint=False)
    ring = np.append(curve, curve[0])
    line = (np.interp(at, along, ring.real) + 1j * np.interp(at, along, ring.imag)) * (length / along[-1])
    smooth = np.exp(-0.5 * (np.fft.fftfreq(n, 1.0 / n) / 40.0) ** 2)
    line = np.fft.ifft(np.fft.fft(line) * smooth)
    step = length / n
    ahead = (np.roll(line, -1) - np.roll(line, 1)) / (2.0 * step)
    yaw = np.unwrap(np.angle(ahead))
    bend = (np.roll(line, -1) - 2.0 * line + np.roll(line, 1)) / step**2
    curvature = (np.conj(ahead) * bend).imag / np.abs(ahead) ** 3
    line = (line - line[0]) * np.exp(-1j * yaw[0])
    return line.real, line.imag, yaw - yaw[0], curvature, float(np.mean(np.abs(np.roll(line, -1) - line)))
