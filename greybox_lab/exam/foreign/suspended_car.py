"""A car with suspension: a body that heaves, rolls and pitches, four wheels that hop, rotate and leave the ground.

Its equations share nothing with `models`: ride and roll after Milliken & Milliken, Race Car Vehicle Dynamics, ch. 16
to 18 (springs, anti-roll bars, roll centres, forces through links); tyres after Burckhardt, Fahrwerktechnik:
Radschlupf-Regelsysteme (1993), on one slip for both directions, with a relaxation length of their deflection (Pacejka,
Tire and Vehicle Dynamics, ch. 5), and friction that decreases with load. The effects in `NATURE` are inherent to it, as
are many that no effect of the vocabulary describes. ISO 8855 axes, SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from math import cos, exp, log, sin, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from greybox_id.base.machine_code import begun, compiled

from ...virtual.virtual_vehicle.layout import Grid, Row, source
from ...virtual.virtual_vehicle.loop import STEP
from .double_track import G, Record, arriving, at_rest, motor, record, servo
from .vehicles import Stepwise

NATURE = ("roll_dynamics", "load_sensitivity", "longitudinal_load_transfer", "combined_slip", "tyre_relaxation")
"""Effects of the vocabulary that every such car has, so that naming them is never wrong."""
FIELDS = (
    *("ride", "hop", "damping", "gradient", "roll_share", "roll_centre", "anti_dive", "fall", "past_peak"),
    *("unsprung", "deflection", "bump_steer"),
)
"""Random numbers of a car in addition to `double_track.CHASSIS`: frequencies of ride and wheel hop [Hz], damping ratio,
roll angle per lateral acceleration [rad s^2/m], front share of the roll stiffness, height of the roll centres over that
of the centre of gravity, share of the pitching moment that links carry, exponent with which friction decreases with
load, friction lost per unit of slip beyond the peak, share of unsprung mass, relaxation length [m], and toe per travel
of the front springs [rad/m]."""

_V_X, _V_Y, _R, _X, _Y, _YAW, _Z, _W, _ROLL, _ROLL_RATE, _PITCH, _PITCH_RATE = range(12)
_HOP, _HOP_RATE, _SPIN, _ACROSS, _ALONG = 12, 16, 20, 24, 28
_STATES = 32


class _Car(NamedTuple):
    """A car for compiled code; arrays are by wheel: front left, front right, rear left, rear right."""

    m: float
    sprung: float
    I_x: float
    I_y: float
    I_z: float
    height: float
    centre: float
    anti_dive: float
    L: float
    x: Row
    y: Row
    unsprung: Row
    load: Row
    spring: Row
    damper: Row
    bar: Row
    tyre: float
    radius: float
    spin: float
    friction: Row
    c_1: Row
    c_2: Row
    c_3: float
    fall: float
    deflection: float
    bump_steer: float
    c_drag: Row
    downforce: float
    slope: float
    bank: float
    drive_front: float
    brake_front: float


def _burckhardt(slope: float, c_3: float) -> tuple[float, float]:
    """c_1 and c_2 of the curve with a given initial slope and a peak of one."""
    c_1 = 1.05
    for _ in range(40):
        c_2 = (slope + c_3) / c_1
        c_1 = 1.0 + c_3 / c_2 * (1.0 + log(c_1 * c_2 / c_3))
    return c_1, (slope + c_3) / c_1


def _car(n: Mapping[str, float]) -> _Car:
    """A car from numbers named by `double_track.CHASSIS`, its effects and `FIELDS`."""
    m, L = n["m"], n["l_f"] + n["l_r"]
    unsprung = 0.25 * n["unsprung"] * m * np.ones(4)
    x = np.array([n["l_f"], n["l_f"], -n["l_r"], -n["l_r"]])
    y = 0.5 * np.array([n["track_f"], -n["track_f"], n["track_r"], -n["track_r"]])
    load = 0.5 * m * G * np.array([n["l_r"], n["l_r"], n["l_f"], n["l_f"]]) / L
    corner = load / G - unsprung
    spring = corner * (2 * np.pi * n["ride"]) ** 2
    lever = n["h_cg"] * (1.0 - n["roll_centre"])
    stiff = (m - 4 * unsprung[0]) * lever * (1.0 / n["gradient"] + G)
    lacking = max(stiff - float(np.sum(spring * y**2)), 0.0)  # contribution of anti-roll bars
    share = np.array([n["roll_share"]] * 2 + [1.0 - n["roll_share"]] * 2)
    tyre = float(np.mean(unsprung)) * (2 * np.pi * n["hop"]) ** 2
    curves = [_burckhardt(n[f"slope_{axle}"] / n[f"mu_{axle}"], n["past_peak"]) for axle in "ffrr"]
    I_x, I_y = 0.35 * m * (0.5 * n["track_f"]) ** 2 + 0.1 * m * n["h_cg"] ** 2, 0.9 * m * n["l_f"] * n["l_r"]
    return _Car(
        m, m - 4 * float(unsprung[0]), I_x, I_y,
        n["I_z"], n["h_cg"], n["roll_centre"] * n["h_cg"], n["anti_dive"], L, x, y, unsprung, load, spring,
        2.0 * n["damping"] * np.sqrt(spring * corner), share * lacking / (4.0 * y**2), tyre, n["wheel_radius"],
        0.5 * 0.6 * float(unsprung[0]) * n["wheel_radius"] ** 2, np.array([n[f"mu_{axle}"] for axle in "ffrr"]),
        np.array([curve[0] for curve in curves]), np.array([curve[1] for curve in curves]), n["past_peak"], n["fall"],
        n["deflection"] + n.get("relaxation", 0.0), n["bump_steer"], np.array([n["c_0"], n["c_1"], n["c_2"]]),
        n.get("downforce", 0.0), n.get("slope", 0.0), n.get("bank", 0.0), n["drive_split_front"],
        min(max(n["brake_split_front"] + n.get("brake_bias", 0.0), 0.0), 1.0),
    )  # fmt: skip


@compiled
def _motion(car: _Car, s: Row, steer: float, force: float, rate: Row, seen: Row) -> None:
    """Write ds/dt to `rate`, and observed quantities to `seen`, (8,), in the order of `layout.READABLE`."""
    v_x, v_y, r = s[_V_X], s[_V_Y], s[_R]
    front = car.drive_front if force >= 0.0 else car.brake_front
    F_x, F_y, M_z, up, roll_moment, pitch_moment = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    down = car.downforce * v_x * v_x
    travel = np.zeros(4)
    for k in range(4):
        travel[k] = s[_HOP + k] - (s[_Z] + car.y[k] * s[_ROLL] - car.x[k] * s[_PITCH])
    across_axle, along_wheel, contact, held = np.zeros(2), np.zeros(4), np.zeros(4), np.zeros(4)
    for k in range(4):
        mate = k + 1 if k % 2 == 0 else k - 1
        speed = s[_HOP_RATE + k] - (s[_W] + car.y[k] * s[_ROLL_RATE] - car.x[k] * s[_PITCH_RATE])
        held[k] = car.spring[k] * travel[k] + car.damper[k] * speed + car.bar[k] * (travel[k] - travel[mate])
        share = car.load[k] / (car.m * G)
        contact[k] = max(car.load[k] - car.tyre * s[_HOP + k] - 0.02 * sqrt(car.tyre * car.unsprung[k])
                         * s[_HOP_RATE + k] + share * down, 0.0)  # fmt: skip
        angle = steer + car.bump_steer * travel[k] * (1.0 if car.y[k] > 0.0 else -1.0) if k < 2 else 0.0
        c, d = cos(angle), sin(angle)
        u_x, u_y = v_x - r * car.y[k], v_y + r * car.x[k]
        along, across = u_x * c + u_y * d, -u_x * d + u_y * c
        pace = max(abs(along), 0.3)
        a, b = s[_ACROSS + k], s[_ALONG + k]
        rate[_ACROSS + k] = (-across - pace * a) / car.deflection
        rate[_ALONG + k] = (s[_SPIN + k] * car.radius - along - pace * b) / car.deflection
        slip = sqrt(a * a + b * b) + 1e-12
        friction = car.friction[k] * max(contact[k] / car.load[k], 0.05) ** -car.fall
        size = max(car.c_1[k] * (1.0 - exp(-car.c_2[k] * slip)) - car.c_3 * slip, 0.3 * min(slip * car.c_2[k], 1.0))
        tyre_y, tyre_x = friction * contact[k] * size * a / slip, friction * contact[k] * size * b / slip
        torque = force * 0.5 * (front if k < 2 else 1.0 - front) * car.radius
        rate[_SPIN + k] = (torque - tyre_x * car.radius) / car.spin
        X, Y = tyre_x * c - tyre_y * d, tyre_x * d + tyre_y * c
        F_x += X
        F_y += Y
        M_z += car.x[k] * Y - car.y[k] * X
        across_axle[k // 2] += Y
        along_wheel[k] = X
    for k in range(4):  # forces through links instead of springs
        side = 1.0 if car.y[k] > 0.0 else -1.0
        carried = -side * across_axle[k // 2] * car.centre / (2.0 * abs(car.y[k]))
        carried -= (1.0 if k < 2 else -1.0) * 0.5 * car.anti_dive * F_x * car.height / car.L
        rate[_HOP + k] = s[_HOP_RATE + k]
        share = car.load[k] / (car.m * G)
        rate[_HOP_RATE + k] = (contact[k] - car.load[k] - share * down - held[k] - carried) / car.unsprung[k]
        up += held[k]
        roll_moment += car.y[k] * held[k]
        pitch_moment -= car.x[k] * held[k]
    drag = car.c_drag[0] * np.tanh(v_x / 0.1) + car.c_drag[1] * v_x + car.c_drag[2] * v_x * abs(v_x)
    lever = car.height - car.centre
    a_x, a_y = (F_x - drag) / car.m, F_y / car.m
    roll_acceleration = (roll_moment + car.sprung * lever * (a_y + G * s[_ROLL])) / car.I_x
    rate[_V_X] = a_x + r * v_y - G * sin(car.slope)
    rate[_V_Y] = a_y - r * v_x - G * sin(car.bank)
    rate[_R] = M_z / car.I_z
    rate[_X] = v_x * cos(s[_YAW]) - v_y * sin(s[_YAW])
    rate[_Y] = v_x * sin(s[_YAW]) + v_y * cos(s[_YAW])
    rate[_YAW] = r
    rate[_Z], rate[_W] = s[_W], up / car.sprung
    rate[_ROLL], rate[_ROLL_RATE] = s[_ROLL_RATE], roll_acceleration
    rate[_PITCH] = s[_PITCH_RATE]
    rate[_PITCH_RATE] = (pitch_moment - car.sprung * car.height * (1.0 - car.anti_dive) * F_x / car.m) / car.I_y
    seen[0], seen[1], seen[2], seen[3], seen[4], seen[5] = v_x, v_y, r, a_x, a_y, rate[_R]
    seen[6], seen[7] = s[_ROLL], roll_acceleration


@cache
def _stepper() -> Any:
    """The steps of a row in machine code, which is cached: fourth-order Runge-Kutta."""
    key = source(), Path(__file__).read_bytes()

    def row(
        car: _Car, acts: Record, s: Row, now: Row, commands: Grid, at: int, steps: int, period: float, out: Any
    ) -> None:
        assert key
        k1, k2, k3, k4, seen = np.zeros(_STATES), np.zeros(_STATES), np.zeros(_STATES), np.zeros(_STATES), np.zeros(8)
        for step in range(steps):
            within = (step + 0.5) * STEP
            now[0] = s[0]
            requested = arriving(commands, 0, at, within, period, acts.steer_delay, True)
            steer = servo(acts, now, requested * acts.steer_ratio + acts.steer_offset)
            force = motor(acts, now, arriving(commands, 1, at, within, period, 0.0, True))
            _motion(car, s, steer, force, k1, seen)
            out[step, 0] = seen
            if step > 0:
                out[step - 1, 1] = seen
            _motion(car, s + 0.5 * STEP * k1, steer, force, k2, seen)
            _motion(car, s + 0.5 * STEP * k2, steer, force, k3, seen)
            _motion(car, s + STEP * k3, steer, force, k4, seen)
            for k in range(_STATES):
                s[k] += STEP / 6.0 * (k1[k] + 2.0 * k2[k] + 2.0 * k3[k] + k4[k])
            for k in range(4):
                s[_SPIN + k] = max(s[_SPIN + k], 0.0)  # a locked wheel does not turn backwards
            if step == steps - 1:
                _motion(car, s, steer, force, k4, seen)
                out[step, 1] = seen

    return begun(row)


class SuspendedCar(Stepwise):
    """The simulator with a vehicle; see `vehicles.Reality`.

    Parameters
    ----------
    numbers : of `double_track.CHASSIS` and its effects, `FIELDS` and wheel_radius.
    """

    def __init__(self, numbers: Mapping[str, float]) -> None:
        self._car, self._acts = _car(numbers), record({**numbers, "linear_hold": 1.0})
        self.state: Row = np.zeros(6)

    def begin(self, start: tuple[float, ...], steer: float, drive: float) -> None:
        """Start in motion, with constant commands before."""
        v_x, v_y, yaw_rate = start
        s, self._now = np.zeros(_STATES), at_rest(steer, drive, self._acts)
        s[_V_X], s[_V_Y], s[_R] = v_x, v_y, yaw_rate
        angle = steer * self._acts["steer_ratio"] + self._acts["steer_offset"]
        for k in range(4):
            s[_SPIN + k] = v_x / self._car.radius
            lateral = (v_y + self._car.x[k] * yaw_rate) / max(v_x, 0.3)
            s[_ACROSS + k] = (angle if k < 2 else 0.0) - lateral
        self._s, self.state = s, s[:6].copy()

    def advance(self, commands: Grid, row: int, steps: int, period: float, out: Any) -> None:
        """Simulate one row with its commands."""
        _stepper()(self._car, self._acts, self._s, self._now, commands, row, steps, period, out)
        self.state = self._s[:6].copy()
