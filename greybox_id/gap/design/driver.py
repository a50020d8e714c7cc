"""The driver of a plan: steers as planned, keeps the planned speed, and brings the vehicle gently back to its path.

An open loop drifts: after twenty seconds a yaw rate that is off by a hundredth of a radian per second has turned the
vehicle by eleven degrees. What the driver adds is recorded as part of the commands, and so biases no estimate. The same
few lines are evaluated as CasADi expressions, when plans are made, and with numbers, when they are driven.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import sqrt
from types import MappingProxyType, SimpleNamespace
from typing import Any

import casadi as cs
import numpy as np

from ...base.errors import BadInput
from ...models.model import Symbol
from ...models.motion_model import MotionModel, Quantities, State
from ...models.parameter import Parameter
from ...models.single_track import G
from .limits import CAR, DriveLimits, number
from .primitives import Handling

SPEED_GAIN = 1.5
"""Of a full-size car's driver, 1/s: m/s^2 per m/s of speed error; those of smaller cars are quicker (Froude)."""
PREVIEW = 1.2
"""Time ahead, s, of a full-size car, at which the driver brings the path back (Kritayakirana & Gerdes, 2012)."""
CORRECTION = 0.15
"""Largest lateral acceleration that corrections of the path use, as a share of the grip."""
PLANNED = ("v_x_planned", "x_planned", "y_planned", "yaw_planned")
PATH = "driver_follows_path"
"""Parameter of a driven model: 1 where the driver brings the vehicle back to the planned path, 0 where not."""
OUTPUTS = (
    *("v_x", "v_y", "yaw_rate", "x", "y", "yaw"),
    *("a_y", "F_yf", "F_yr", "F_xf", "F_xr", "peak_f", "peak_r", "drive_force"),
)
"""Outputs of a driven model, in this order."""


@dataclass(frozen=True)
class PlanDriver:
    """Numbers of a driver.

    Attributes
    ----------
    speed_gain : 1/s, acceleration per speed error.
    preview : s.
    most : m/s^2, largest lateral acceleration of corrections.
    length, understeer : of the vehicle, m and rad s^2/m.
    mass : kg.
    force : N per unit of the drive signal.
    drive_max, brake_max : m/s^2, largest planned accelerations.
    """

    speed_gain: float
    preview: float
    most: float
    length: float
    understeer: float
    mass: float
    force: float
    drive_max: float
    brake_max: float

    def commands(self, plan: Mapping[str, float], motion: Mapping[str, float]) -> tuple[float, float]:
        """Steering, rad, and drive, in the unit of its signal, at a row of a plan.

        Parameters
        ----------
        plan : `steer`, `drive`, and the motion expected there: `x`, `y`, `yaw`, `v_x`.
        motion : of the vehicle, relative to where it began: `x`, `y`, `yaw`, `v_x`.
        """
        steer = plan["steer"] + self._back(
            plan["x"], plan["y"], plan["yaw"], plan["v_x"], motion["x"], motion["y"], motion["yaw"], np
        )
        return float(steer), float(self._drive(plan["drive"], plan["v_x"], motion["v_x"], np))

    def _back(self, x0: Any, y0: Any, yaw0: Any, v: Any, x: Any, y: Any, yaw: Any, of: Any) -> Any:
        """Steering back to the path, rad."""
        off = -of.sin(yaw0) * (x - x0) + of.cos(yaw0) * (y - y0)
        ahead = of.fmax(self.preview * v, 2.0 * self.length)
        bend = -2.0 * (off + ahead * of.sin(yaw - yaw0)) / ahead**2
        most = self.most / v**2
        return (self.length + self.understeer * v**2) * of.fmin(of.fmax(bend, -most), most)

    def _drive(self, planned: Any, target: Any, v_x: Any, of: Any) -> Any:
        per_unit = self.mass / self.force
        requested = planned + self.speed_gain * (target - v_x) * per_unit
        return of.fmin(of.fmax(requested, -1.2 * self.brake_max * per_unit), 1.5 * self.drive_max * per_unit)


def driver_of(model: MotionModel, limits: DriveLimits) -> PlanDriver:
    """The driver of a model's vehicle."""
    handling = vehicle_of(model)
    pace = sqrt(handling.length / CAR)
    return PlanDriver(
        SPEED_GAIN / pace, PREVIEW * pace, CORRECTION * handling.grip, handling.length, max(handling.understeer, 0.0),
        number(model, "m", 1450.0), max(number(model, "force_per_unit", 1450.0), 1e-9), limits.drive_max,
        limits.brake_max,
    )  # fmt: skip


def vehicle_of(model: MotionModel) -> Handling:
    """Wheelbase, understeer gradient and grip of a model of equations of motion.

    Raises `BadInput` where its speed is no state, or its tyres have no peak: it cannot predict manoeuvres.
    """
    states = {state.name for state in model.states}
    lacking = sorted({"v_x", "v_y", "yaw_rate"} - states)
    if lacking or not {"peak_f", "F_xf", "drive_force"} <= set(model.quantities) or "drive" not in model.inputs:
        raise BadInput(
            "A manoeuvre is designed with equations of v_x, v_y and yaw_rate from steering and drive; "
            f"{model.name} has {'no state ' + ', '.join(lacking) if lacking else 'no driving force'}. Fit single_track."
        )
    L = number(model, "l_f", 1.3) + number(model, "l_r", 1.46)
    share = (number(model, "l_r", 1.46) / L, number(model, "l_f", 1.3) / L)
    of = {c.name: c for c in model.combinations}
    values = SimpleNamespace(**{p.name: float(p.array) for p in model.parameters if p.shape == ()})
    slopes = [float(cs.DM(of[name].of(values))) if name in of else 0.0 for name in ("C_alpha_f", "C_alpha_r")]
    weight = number(model, "m", 1450.0) * G
    bend = 0.0
    if min(slopes) > 0:
        bend = (share[0] * weight / slopes[0] - share[1] * weight / slopes[1]) / G
    friction = min(number(model, "D_f", number(model, "mu_f", 0.9)), number(model, "D_r", number(model, "mu_r", 0.9)))
    return Handling(L, bend, friction * G)


def driven(model: MotionModel, driver: PlanDriver) -> MotionModel:
    """The model with its driver and position, and the outputs that limits need; without sensors.

    Its inputs are the planned steering and drive, and the planned speed and path. The driver's numbers are its last
    parameters, so that the equations, and their compiled kernel, are the same for all drivers.
    """
    numbers = {one.name: f"driver_{one.name}" for one in fields(PlanDriver)}

    def of(q: Quantities) -> PlanDriver:
        return PlanDriver(**{name: getattr(q.p, parameter) for name, parameter in numbers.items()})

    def places(q: Quantities) -> Mapping[str, Symbol]:
        c, s = cs.cos(q.x.yaw), cs.sin(q.x.yaw)
        return {"x": c * q.x.v_x - s * q.x.v_y, "y": s * q.x.v_x + c * q.x.v_y, "yaw": q.x.yaw_rate}

    def drive(value: Symbol, q: Quantities) -> Symbol:
        return of(q)._drive(value, q.u.v_x_planned, q.x.v_x, cs)

    def steer(value: Symbol, q: Quantities) -> Symbol:
        u, x = q.u, q.x
        back = of(q)._back(u.x_planned, u.y_planned, u.yaw_planned, u.v_x_planned, x.x, x.y, x.yaw, cs)
        return value + getattr(q.p, PATH) * back

    follows = Parameter(PATH, "1", 0.0, (0.0, 1.0), fixed=True, about="whether the driver follows the planned path")
    driver_numbers = [
        Parameter(parameter, "1", getattr(driver, name), fixed=True, about=f"{name} of the driver")
        for name, parameter in numbers.items()
    ]
    position = (State("x", "m"), State("y", "m"), State("yaw", "rad"))
    added = model.with_states(places, *position).with_parameters(follows, *driver_numbers)
    return replace(
        added,
        inputs=(*added.inputs, *PLANNED),
        aliases=MappingProxyType({**added.aliases, **{name: (name,) for name in PLANNED}}),
        alterations=(("steer", steer), ("drive", drive), *added.alterations),
        outputs=OUTPUTS,
        sensors=(),
        latencies=(),
    )
