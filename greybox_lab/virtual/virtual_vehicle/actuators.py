"""From command to road-wheel angle, and from command to force at the wheels.

`chain` contains the states of actuators: play, rate limiter and its integral, road wheel and its rate, drive force, and
oscillators. A substep has a duration of h seconds with constant commands; lags are integrated in closed form.
"""

from __future__ import annotations

from math import exp, inf, pi

from greybox_id.base.machine_code import compiled

from .layout import Car, Row
from .scale import G

PLAY, LIMITED, INTEGRAL, WHEEL, WHEEL_RATE, FORCE, SWUNG, SWUNG_RATE, SHAFT, SHAFT_RATE = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
CHAIN = 10

_SERVO, _SERVO_INTEGRAL = 200.0, 2000.0
"""Gains of the steering servo, 1/s and 1/s^2."""
_FLANK = 0.008
"""Time constant of the elastic stops of soft play, s."""
_SWING_DAMPING = 0.15
"""Damping ratio of the oscillators."""


@compiled
def steering_command(car: Car, command: float) -> float:
    """Steering command after ratio, asymmetry and offset, rad."""
    geared = car.steering_ratio * command
    if car.variable_ratio != 0.0:
        geared *= 1.0 + car.variable_ratio * min((geared / (0.35 * car.steer_max)) ** 2, 1.0)
    turn = 1.0 + car.steering_asymmetry if geared > 0.0 else 1.0 - car.steering_asymmetry
    return float(geared * turn + car.steering_offset)


@compiled
def driving_command(car: Car, command: float) -> float:
    """Force that the command requests from the drive, N."""
    force = car.force_per_unit * car.motor_gain * command
    dead = car.drive_dead_zone * car.m * G
    return force - dead if force > dead else (force + dead if force < -dead else 0.0)


@compiled
def settle(car: Car, chain: Row, steer: float, force: float) -> None:
    """Set the steady state for constant commands, with play centred."""
    chain[PLAY] = chain[LIMITED] = chain[WHEEL] = steer
    chain[INTEGRAL] = chain[WHEEL_RATE] = 0.0
    chain[SWUNG], chain[SWUNG_RATE] = steer, 0.0
    chain[FORCE] = chain[SHAFT] = force
    chain[SHAFT_RATE] = 0.0


@compiled
def jump(car: Car, chain: Row, steer: float, force: float) -> None:
    """Apply a jump of the commands to states that follow without delay."""
    if car.form_backlash == 0 or car.steering_backlash == 0.0:
        chain[PLAY] = min(max(chain[PLAY], steer - car.steering_backlash), steer + car.steering_backlash)
    if car.steering_rate_limit == inf:
        chain[LIMITED] = chain[PLAY]
    if car.steering_lag == 0.0:
        chain[WHEEL] = chain[LIMITED]
    if car.motor_lag == 0.0:
        chain[FORCE] = force


@compiled
def move(car: Car, chain: Row, steer: float, force: float, h: float) -> None:
    """Advance the states by h seconds at constant commands."""
    before = chain[LIMITED]
    if car.form_backlash == 1 and car.steering_backlash > 0.0:
        flank = min(max(chain[PLAY], steer - car.steering_backlash), steer + car.steering_backlash)
        chain[PLAY] += (flank - chain[PLAY]) * (1.0 - exp(-h / _FLANK))
    limit = car.steering_rate_limit
    off = chain[PLAY] - before
    if limit == inf:
        chain[LIMITED] = chain[PLAY]
    elif car.form_rate_limit == 0:
        chain[LIMITED] = before + min(max(off, -limit * h), limit * h)
    else:
        target = _SERVO * off + chain[INTEGRAL]
        if abs(target) < limit:
            chain[INTEGRAL] += _SERVO_INTEGRAL * off * h
        else:
            chain[INTEGRAL] *= exp(-20.0 * h)
        chain[LIMITED] = before + min(max(target, -limit), limit) * h

    T = car.steering_lag
    if T == 0.0:
        chain[WHEEL] = chain[LIMITED]
    elif car.form_steering_lag == 0:
        ramp = (chain[LIMITED] - before) / h
        chain[WHEEL] = chain[LIMITED] - T * ramp + (chain[WHEEL] - before + T * ramp) * exp(-h / T)
    else:  # critically damped, towards the mean of the input; same delay as the first-order lag
        w, aim = 2.0 / T, 0.5 * (before + chain[LIMITED])
        e, v, fades = chain[WHEEL] - aim, chain[WHEEL_RATE], exp(-2.0 * h / T)
        chain[WHEEL] = aim + (e + (v + w * e) * h) * fades
        chain[WHEEL_RATE] = (v - w * (v + w * e) * h) * fades
    if car.motor_lag == 0.0:
        chain[FORCE] = force
    else:
        chain[FORCE] = force + (chain[FORCE] - force) * exp(-h / car.motor_lag)
    if car.steering_resonance > 0.0:
        swing(chain, SWUNG, chain[WHEEL], 2.0 * pi * 2.5 / car.time, h)
    if car.driveline_oscillation > 0.0:
        swing(chain, SHAFT, chain[FORCE], 2.0 * pi * 2.0 / car.time, h)


@compiled
def swing(chain: Row, at: int, aim: float, w: float, h: float) -> None:
    """Advance an oscillator around an aim, at indices at and at + 1 of the chain, by h seconds."""
    chain[at + 1] += h * (w * w * (aim - chain[at]) - 2.0 * _SWING_DAMPING * w * chain[at + 1])
    chain[at] += h * chain[at + 1]


@compiled
def road_wheel(car: Car, chain: Row, v_x: float) -> float:
    """Angle of the road wheels, rad."""
    k = car.steering_resonance
    angle = chain[WHEEL] + k * (chain[SWUNG] - chain[WHEEL]) if k > 0.0 else chain[WHEEL]
    return float(angle + car.ply_steer * (v_x / car.top_speed) ** 2)


@compiled
def wheel_force(car: Car, chain: Row, v_x: float) -> float:
    """Force at the wheels, N."""
    k = car.driveline_oscillation
    return available(car, chain[FORCE] + k * (chain[SHAFT] - chain[FORCE]) if k > 0.0 else chain[FORCE], v_x)


@compiled
def available(car: Car, force: float, v_x: float) -> float:
    """Force of the drive, N, limited by its motor; brakes are not limited."""
    if force <= 0.0 or car.motor_saturation == inf:
        return force
    ratio = abs(v_x) / car.motor_saturation_v_b
    if car.form_saturation == 0:
        most = car.m * car.motor_saturation * min(1.0, 1.0 / max(ratio, 1e-9))
        return float(min(force, most))
    most = car.m * car.motor_saturation * (1.0 + ratio**6) ** (-1.0 / 6.0)
    return force if force < most else most
