"""What happens to vehicles and is not in the vocabulary of the diagnosis; magnitudes as in `effects.OUTSIDE`."""

from __future__ import annotations

from math import atan2, cos, pi, sin, tanh

from .compiled import Car, Grid, Row, compiled
from .layout import GUST, LOAD, STEER, V_X, V_Y, YAW_RATE
from .scale import G


@compiled
def rear_angle(car: Car, v_x: float, steer: float) -> float:
    """Angle of rear wheels that steer, rad: with the front ones when fast, against them when slow."""
    if car.rear_steer == 0.0:
        return 0.0
    return float(car.rear_steer * steer * tanh((v_x / car.top_speed - 0.3) / 0.15))


@compiled
def asymmetry(car: Car, share: float) -> float:
    """Lateral force over that of a tyre that is alike on both sides."""
    if car.tyre_asymmetry == 0.0:
        return 1.0
    return float(1.0 + car.tyre_asymmetry * tanh(8.0 * share))


@compiled
def grip_of_road(car: Car, x: float, y: float) -> float:
    """Friction of the road over that of a dry one: patches, three tenths of it, some wheelbases wide."""
    if car.slippery_patches == 0.0:
        return 1.0
    k = 2.0 * pi / (16.0 * car.L)
    height = sin(k * x + 0.4) * cos(0.8 * k * y) + 0.5 * sin(1.7 * k * y + 1.0)
    return float(1.0 - car.slippery_patches * 0.5 * (1.0 + tanh(6.0 * (height - 0.35))))


@compiled
def asked_for(car: Car, v_x: float, steer: float) -> float:
    """Yaw rate that the steering asks for, rad/s, as far as there is grip."""
    most = 0.8 * G * min(car.D_f, car.D_r) / max(v_x, 1.0)
    return float(min(max(v_x * steer / (car.L + car.understeer * v_x * v_x), -most), most))


@compiled
def moments(
    car: Car, s: Row, given: Row, seen: Row, wheels: Grid, F_xf: float, F_xr: float
) -> tuple[float, float, float]:
    """Forces along and across, N, and moment about the vertical, N m, that come on top.

    Parameters are those of `chassis.motion`, and the longitudinal forces of the axles, N.
    """
    v_x, r = s[V_X], s[YAW_RATE]
    half_f, half_r = 0.5 * car.track_f, 0.5 * car.track_r
    weight = car.m * G
    rolls = tanh(v_x / 0.1)

    F_x = F_y = M_z = 0.0
    # one wheel drags
    brake, flat = car.dragging_brake * weight * rolls, 0.05 * car.puncture * wheels[1, LOAD] * rolls
    F_x -= brake + flat
    M_z += half_f * (brake - flat)
    # the faster wheel of a driven axle hands force to the slower one
    if car.limited_slip != 0.0:
        M_z -= car.limited_slip * half_f * max(F_xf, 0.0) * tanh(20.0 * r * car.track_f / max(v_x, 0.5))
        M_z -= car.limited_slip * half_r * max(F_xr, 0.0) * tanh(20.0 * r * car.track_r / max(v_x, 0.5))
    if car.torque_vectoring != 0.0:
        M_z += car.torque_vectoring * car.I_z * (asked_for(car, v_x, given[STEER]) - r) / (0.3 * car.L / 2.76)
    if car.stability_control != 0.0:
        off = r - asked_for(car, v_x, given[STEER])
        tolerated = 0.04 * G / max(v_x, 1.0)
        beyond = max(abs(off) - tolerated, 0.0) / tolerated
        F = min(0.04 * car.stability_control * beyond, 0.25) * weight * rolls
        F_x -= F
        M_z -= F * half_f * (1.0 if off > 0.0 else -1.0)
    if car.aero_yaw != 0.0:
        M_z += car.aero_yaw * weight * car.L * (v_x / car.top_speed) ** 2 * atan2(s[V_Y], max(v_x, 1.0))
    if given[GUST] != 0.0:
        push = 2.2 * car.c_2 * max(v_x, 0.0) * given[GUST]
        F_y += push
        M_z += 0.15 * car.L * push
    return F_x, F_y, M_z
