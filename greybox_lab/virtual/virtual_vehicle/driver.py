"""The driver, who follows a road or a plan of steering, keeps a speed, and countersteers when the vehicle slides.

The driver uses the true motion, not sensor readings, once per row, and knows the vehicle's stated parameters.
Steering along a line: curvature ahead, and lateral and heading error combined at a preview point (Kritayakirana &
Gerdes, Vehicle System Dynamics 50, 2012).
"""

from __future__ import annotations

from math import atan2, cos, isnan, nan, sin, sqrt
from typing import Any, TypeAlias

import numpy as np

from greybox_id.base.machine_code import compiled

from .car import VirtualCar
from .layout import (  # fmt: skip
    FOLLOW,
    OPEN_DRIVE,
    ROAD_CURVATURE,
    ROAD_SPEED,
    ROAD_X,
    ROAD_Y,
    ROAD_YAW,
    SPEED,
    TURN,
    V_X,
    V_Y,
    YAW,
    YAW_RATE,
    Grid,
    Row,
    X,
    Y,
)

Driver: TypeAlias = Any
"""A numpy record of the vehicle's parameters that the driver knows."""

_KNOWN = (
    *("m", "l_f", "l_r", "c_0", "c_1", "c_2", "force_per_unit"),
    *("length", "time", "understeer", "peak_slip", "steer_max", "grip", "drive", "brake", "least_speed"),
)
_RECORD = np.dtype([(name, np.float64) for name in _KNOWN])

NEAREST, INTEGRAL, HANDS, FOOT, FOLLOWING, ORIGIN_X, ORIGIN_Y, ORIGIN_YAW, DEVIATION = 0, 1, 2, 3, 4, 5, 6, 7, 8
MIND = 9
"""Memory of the driver: nearest point of the road, integral of the speed error, last steering and force, whether the
driver follows the road and where that begins in the world, and the vehicle's distance from the line."""


def driver(car: VirtualCar) -> Driver:
    """A driver who knows a vehicle's stated parameters."""
    record = np.zeros(1, _RECORD)[0]
    known = {**car.parameters, **vars(car.size)}
    for name in _KNOWN:
        record[name] = known[name]
    return record


@compiled
def awaken(mind: Row, v_x: float) -> None:
    """Initialise the driver's memory."""
    mind[:] = 0.0
    mind[DEVIATION] = nan
    mind[FOOT] = nan if v_x > 0.0 else 0.0


@compiled
def re_anchor(mind: Row, s: Row) -> None:
    """Move the origin of the world to the vehicle; the road keeps its position relative to the vehicle."""
    dx, dy, c, d = mind[ORIGIN_X] - s[X], mind[ORIGIN_Y] - s[Y], cos(s[YAW]), sin(s[YAW])
    mind[ORIGIN_X], mind[ORIGIN_Y] = c * dx + d * dy, c * dy - d * dx
    mind[ORIGIN_YAW] -= s[YAW]


@compiled
def decide(
    knows: Driver, road: Grid, spacing: float, plan: Grid, row: int, s: Row, mind: Row, period: float
) -> tuple[float, float]:
    """Steering, rad, and drive, in the unit of its channel, that the driver commands at a row of the plan."""
    requested = plan[row]
    if requested[FOLLOW] < 0.0 and isnan(requested[SPEED]):
        return requested[TURN], requested[OPEN_DRIVE]
    if requested[FOLLOW] < 0.0:
        return requested[TURN], on_the_pedals(
            knows, road, spacing, plan, row, s, mind, period, 0.0
        ) / knows.force_per_unit
    v = max(s[V_X], 0.3)
    drift = atan2(s[V_Y], v)
    lost = 0.0
    steer = requested[TURN] * (knows.length / max(v, knows.least_speed) ** 2 + max(knows.understeer, 0.0))
    if requested[FOLLOW] > 0.0:
        if mind[FOLLOWING] == 0.0:
            mind[ORIGIN_X], mind[ORIGIN_Y], mind[ORIGIN_YAW] = s[X], s[Y], s[YAW]
            mind[NEAREST] = 0.0
        steer += along_the_road(knows, road, spacing, s, mind, v, drift, period)
        lost = max(abs(mind[DEVIATION]) - 0.3 * knows.length, 0.0) / knows.length
    else:
        mind[DEVIATION] = nan
    mind[FOLLOWING] = requested[FOLLOW]

    # countersteer when the rear slides, limited by the peak slip of the front tyres
    sliding = abs(drift) - 0.12
    if sliding > 0.0:
        steer += 0.9 * sliding if drift > 0.0 else -0.9 * sliding
    straight = atan2(s[V_Y] + knows.l_f * s[YAW_RATE], v)
    steer = min(max(steer, straight - knows.peak_slip), straight + knows.peak_slip)
    if requested[FOLLOW] > 0.0:
        turn = 1.2 / knows.time * period
        steer = min(max(steer, mind[HANDS] - turn), mind[HANDS] + turn)
    steer = min(max(steer, -knows.steer_max), knows.steer_max)
    mind[HANDS] = steer

    if isnan(requested[SPEED]) and requested[FOLLOW] == 0.0:
        mind[FOOT] = requested[OPEN_DRIVE] * knows.force_per_unit
        mind[INTEGRAL] = 0.0
        return steer, requested[OPEN_DRIVE]
    return steer, on_the_pedals(knows, road, spacing, plan, row, s, mind, period, lost) / knows.force_per_unit


@compiled
def along_the_road(
    knows: Driver, road: Grid, spacing: float, s: Row, mind: Row, v: float, drift: float, period: float
) -> float:
    """Steering angle that follows the road, rad."""
    n = len(road)
    c, d = cos(mind[ORIGIN_YAW]), sin(mind[ORIGIN_YAW])
    dx, dy = s[X] - mind[ORIGIN_X], s[Y] - mind[ORIGIN_Y]
    x, y, yaw = c * dx + d * dy, c * dy - d * dx, s[YAW] - mind[ORIGIN_YAW]
    best, nearest = np.inf, 0
    for k in range(int(mind[NEAREST]) - 3, int(mind[NEAREST]) + 6 + int(3.0 * v * period / spacing)):
        apart = (x - road[k % n, ROAD_X]) ** 2 + (y - road[k % n, ROAD_Y]) ** 2
        if apart < best:
            best, nearest = apart, k % n
    mind[NEAREST] = nearest
    here = road[nearest]
    off = (y - here[ROAD_Y]) * cos(here[ROAD_YAW]) - (x - here[ROAD_X]) * sin(here[ROAD_YAW])
    mind[DEVIATION] = off
    course = yaw - here[ROAD_YAW] + 0.6 * drift
    ahead = road[(nearest + int(0.05 * knows.time * v / spacing)) % n, ROAD_CURVATURE]
    preview = max(2.0 * knows.length, 0.8 * knows.time * v)
    bend = ahead - 2.0 * (off + preview * sin(course)) / preview**2
    return float((knows.length + max(knows.understeer, 0.0) * v * v) * bend)


@compiled
def on_the_pedals(
    knows: Driver, road: Grid, spacing: float, plan: Grid, row: int, s: Row, mind: Row, period: float, lost: float
) -> float:
    """Driving force, N, that keeps the speed of the road or of the plan."""
    v, n = s[V_X], len(road)
    if isnan(plan[row, SPEED]):
        k = int(mind[NEAREST]) + int(max(v, 0.0) * 0.08 * knows.time / spacing)
        target = road[k % n, ROAD_SPEED]
        rises = (road[(k + 3) % n, ROAD_SPEED] ** 2 - road[(k - 3) % n, ROAD_SPEED] ** 2) / (12.0 * spacing)
        target *= 1.0 - min(0.4 * lost, 0.5)
    else:
        target = plan[row, SPEED]
        after = plan[min(row + 1, len(plan) - 1), SPEED]
        rises = 0.0 if isnan(after) else (after - target) / period
    error = target - v
    a = rises + 1.5 / knows.time * error + mind[INTEGRAL]
    used = min(abs(v * s[YAW_RATE]) / knows.grip, 0.95)
    room = sqrt(1.0 - used * used)
    low, high = -knows.brake * room, knows.drive * room
    if low < a < high:
        mind[INTEGRAL] = min(max(mind[INTEGRAL] + 0.3 / knows.time**2 * error * period, -1.5), 1.5)
    resistance = knows.c_0 + knows.c_1 * v + knows.c_2 * v * v
    wanted_force = knows.m * min(max(a, low), high) + resistance
    if isnan(mind[FOOT]):
        mind[FOOT] = wanted_force
    stroke = knows.m * 18.0 * period  # limits the rate of the pedals
    mind[FOOT] = min(max(wanted_force, mind[FOOT] - stroke), mind[FOOT] + stroke)
    return float(mind[FOOT])
