"""CommonRoad's multi-body car: 29 states, suspension, compliant joints, four wheels that rotate, PAC2002 tyres.

Source: Althoff & Würsching, CommonRoad: Vehicle Models, 2020; the package commonroad-vehicle-models. Its right-hand
side is theirs, compiled; steering follows a command through its own input, the velocity of the steering. What it has no
parameter for acts as an acceleration on the body.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Mapping
from functools import cache
from math import inf
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.machine_code import compiled
from greybox_lab.exam.foreign.double_track import arriving
from greybox_lab.exam.foreign.vehicles import Stepwise
from greybox_lab.virtual.virtual_vehicle.layout import Grid, Row
from greybox_lab.virtual.virtual_vehicle.loop import STEP
from greybox_lab.virtual.virtual_vehicle.scale import G

FASTEST_SERVO = 2e-3
"""Time constant, s, below which its steps are too coarse."""
_PLACES = (3, 10, 5, 0, 1, 4)
"""Of v_x, v_y, yaw_rate, x, y, yaw in its state."""


def _package() -> Any:
    try:
        import vehiclemodels.init_mb
        import vehiclemodels.vehicle_parameters
    except ImportError as error:
        raise BadInput(
            "CommonRoad's multi-body car needs the package commonroad-vehicle-models; install it with "
            "pip install 'greybox-id[exam]'."
        ) from error
    return vehiclemodels


def parameters(number: int) -> Any:
    """The parameters of one of its vehicles: 1 (a Ford Escort), 2 (a BMW 320i), 3 (a VW Vanagon)."""
    return _package().vehicle_parameters.setup_vehicle_parameters(vehicle_id=number)


def _plain(name: str, own: Any) -> Any:
    """Nested parameters as named tuples, which compiled code reads."""
    fields = {key: value for key, value in vars(own).items() if value is not None and key != "trailer"}
    values: list[Any] = [
        _plain(key, value) if hasattr(value, "__dict__") else float(value) for key, value in fields.items()
    ]
    made: Any = namedtuple(name, list(fields))  # type: ignore[misc]  # fields are theirs
    return made(*values)


def _again(function: FunctionType, **others: Any) -> Any:
    """A function of theirs in machine code, some of the names that it uses replaced."""
    return compiled(FunctionType(function.__code__, {**function.__globals__, **others}, function.__name__))


@cache
def _rates() -> Any:
    """Their right-hand side, compiled."""
    package = _package()
    from vehiclemodels.utils import acceleration_constraints, steering_constraints, tire_model, vehicle_dynamics_ks_cog
    from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

    assert package
    steering = _again(steering_constraints.steering_constraints)
    acceleration = _again(acceleration_constraints.acceleration_constraints)
    slow = _again(
        vehicle_dynamics_ks_cog.vehicle_dynamics_ks_cog,
        steering_constraints=steering,
        acceleration_constraints=acceleration,
    )
    tyre = ModuleType("tyre")
    sign = _again(tire_model.sign)
    for name in ("formula_longitudinal", "formula_lateral", "formula_longitudinal_comb", "formula_lateral_comb"):
        setattr(tyre, name, _again(getattr(tire_model, name), sign=sign))
    return _again(
        vehicle_dynamics_mb,
        steering_constraints=steering,
        acceleration_constraints=acceleration,
        vehicle_dynamics_ks_cog=slow,
        tireModel=tyre,
    )


@cache
def _stepper() -> Any:
    rates = _rates()

    @compiled
    def evaluate(x: Row, u: Row, p: Any, outer: Row, into: Row) -> None:
        found = rates(x, u, p)
        for k in range(29):
            into[k] = found[k]
        into[3] += outer[0]
        for k in (10, 15, 20):
            into[k] += outer[1]

    @compiled
    def row(x: Row, p: Any, now: Row, c: Row, commands: Grid, at: int, steps: int, period: float, out: Any) -> None:
        """c: delay, play, ratio, offset, servo, drive / m, lag, c_0/m, c_1/m, c_2/m, along, across, wind, towards."""
        k1, k2, k3, k4, u, outer = np.zeros(29), np.zeros(29), np.zeros(29), np.zeros(29), np.zeros(2), np.zeros(2)
        for step in range(steps):
            within = (step + 0.5) * STEP
            wanted = arriving(commands, 0, at, within, period, c[0], True)
            now[0] = min(max(now[0], wanted - c[1]), wanted + c[1])
            asked = arriving(commands, 1, at, within, period, 0.0, True) * c[5]
            now[1] = asked + (now[1] - asked) * (np.exp(-STEP / c[6]) if c[6] > 0.0 else 0.0)
            u[0], u[1] = (now[0] * c[2] + c[3] - x[2]) / c[4], now[1]
            air_x = x[3] - c[12] * np.cos(c[13] - x[4])
            air_y = (x[10] if c[12] != 0.0 else 0.0) - c[12] * np.sin(c[13] - x[4])
            speed = np.sqrt(air_x * air_x + air_y * air_y)
            resistance = -c[7] * np.tanh(x[3] / 0.1) - c[8] * x[3] - c[9] * speed * air_x
            push = -c[9] * speed * air_y
            outer[0], outer[1] = resistance - c[10], push - c[11]
            evaluate(x, u, p, outer, k1)
            a_x, a_y = k1[3] - x[5] * x[10] + c[10], k1[10] + x[5] * x[3] + c[11]
            out[step, 0, 0], out[step, 0, 1], out[step, 0, 2], out[step, 0, 3] = x[3], x[10], x[5], a_x
            out[step, 0, 4], out[step, 0, 5] = a_y, k1[5]
            if step > 0:
                out[step - 1, 1] = out[step, 0]
            evaluate(x + 0.5 * STEP * k1, u, p, outer, k2)
            evaluate(x + 0.5 * STEP * k2, u, p, outer, k3)
            evaluate(x + STEP * k3, u, p, outer, k4)
            for k in range(29):
                x[k] += STEP / 6.0 * (k1[k] + 2.0 * k2[k] + 2.0 * k3[k] + k4[k])
        out[steps - 1, 1] = out[steps - 1, 0]
        out[steps - 1, 1, 0], out[steps - 1, 1, 1], out[steps - 1, 1, 2] = x[3], x[10], x[5]

    return row


class MultiBody(Stepwise):
    """The simulator with a vehicle in it; see `vehicles.Reality`.

    Parameters
    ----------
    numbers : as of `double_track.FIELDS`; `car` is the number of the vehicle, whose own parameters hold where numbers
        are not given. `grip` is a factor on its tyres.
    """

    def __init__(self, numbers: Mapping[str, float]) -> None:
        n, p = numbers, parameters(int(numbers["car"]))
        heavier = n.get("m", p.m) / p.m
        p.m_s, p.m_uf, p.m_ur, p.m = p.m_s * heavier, p.m_uf * heavier, p.m_ur * heavier, p.m * heavier
        p.I_z, p.a, p.b = n.get("I_z", p.I_z), n.get("l_f", p.a), n.get("l_r", p.b)
        grip = n.get("grip", 1.0)
        p.tire.p_dy1, p.tire.p_ky1, p.tire.p_dx1 = p.tire.p_dy1 * grip, p.tire.p_ky1 * grip, p.tire.p_dx1 * grip
        p.T_sb = min(max(n.get("brake_split_front", p.T_sb) + n.get("brake_bias", 0.0), 0.0), 1.0)
        p.T_se = n.get("drive_split_front", p.T_se)
        p.steering.v_max = min(n.get("steer_rate", p.steering.v_max), 1e3)
        p.steering.v_min = -p.steering.v_max
        if n.get("drive_most", inf) < inf:
            p.longitudinal.a_max, p.longitudinal.v_switch = n["drive_most"], n["drive_corner"]
        else:
            p.longitudinal.a_max, p.longitudinal.v_switch = 50.0, 1e3
        self._p, self._own = _plain("Vehicle", p), p
        m = p.m
        servo = max(n.get("steer_time", 0.0) + n.get("steer_lag", 0.0), FASTEST_SERVO)
        drive = n.get("force_per_unit", m) * n.get("drive_gain", 1.0) / m
        along, across = G * np.sin(n.get("slope", 0.0)), G * np.sin(n.get("bank", 0.0))
        self._c = np.array([
            n.get("steer_delay", 0.0), n.get("steer_backlash", 0.0), n.get("steer_ratio", 1.0),
            n.get("steer_offset", 0.0), servo, drive, n.get("drive_time", 0.0) + n.get("drive_lag", 0.0),
            n.get("c_0", 0.0) / m, n.get("c_1", 0.0) / m, n.get("c_2", 0.0) / m, along, across,
            n.get("wind", 0.0), n.get("wind_direction", 0.0),
        ])  # fmt: skip

    def begin(self, start: tuple[float, ...], steer: float, drive: float) -> None:
        """Start in motion, the commands long in force."""
        v_x, v_y, yaw_rate = start
        angle = steer * self._c[2] + self._c[3]
        core = [0.0, 0.0, angle, float(np.hypot(v_x, v_y)), 0.0, yaw_rate, float(np.arctan2(v_y, v_x))]
        self._x = np.array(_package().init_mb.init_mb(core, self._own), float)
        self._now = np.array([steer, drive * self._c[5]])
        self.state = self._x[list(_PLACES)]

    def advance(self, commands: Grid, row: int, steps: int, period: float, out: Any) -> None:
        """Carry out a row of commands."""
        _stepper()(self._x, self._p, self._now, self._c, commands, row, steps, period, out)
        self.state = self._x[list(_PLACES)]
