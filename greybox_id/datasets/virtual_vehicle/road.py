"""Closed roads that turn both ways, and how fast they can be driven."""

from __future__ import annotations

from math import pi

import numpy as np

from .compiled import Grid, Row
from .layout import ROAD
from .scale import Scale

_POINTS = 4096


def closed_road(size: Scale, usage: float, rng: np.random.Generator) -> tuple[Grid, float]:
    """A random closed road and the speeds at which a vehicle uses a share of its grip on it.

    Parameters
    ----------
    size : of the vehicle: curves are as narrow as it can take a little above its least speed.
    usage : share of the grip that the fastest driving uses.
    rng : draws the road.

    Returns
    -------
    road : (n, ROAD) x, y, yaw, curvature, speed, from (0, 0, 0) on.
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
    speeds = top_speeds(curvature, step, size, usage)
    for k, column in enumerate((x, y, yaw, curvature, speeds)):
        road[:, k] = column
    return road, step


def _drawn(swing: Row, phase: Row, length: float) -> tuple[Row, Row, Row, Row, float]:
    """A closed curve whose distance from its centre swings, scaled to a length, in equal steps from the origin."""
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


def top_speeds(curvature: Row, step: float, size: Scale, usage: float) -> Row:
    """Largest speeds, m/s, along a closed road within a share of the grip, of the drive and of the brakes, (n,)."""
    bend = np.abs(curvature)
    most = usage * size.grip
    v = np.minimum(size.top_speed, np.sqrt(most / np.maximum(bend, 1e-9)))
    n = len(v)
    for direction, a_x in ((1, usage * size.drive), (-1, usage * size.brake)):
        for k in range(2 * n):  # two laps, that it holds across the start
            here, there = direction * k % n, direction * (k + 1) % n
            room = max(0.0, 1.0 - (v[here] ** 2 * bend[here] / most) ** 2) ** 0.5
            v[there] = min(v[there], (v[here] ** 2 + 2.0 * step * a_x * room) ** 0.5)
    return np.asarray(v, float)
