"""A period of driving: the model's states and the place on the path, many vehicles side by side."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.engine.kernel import Kernel
from greybox_id.engine.motion.schedule import STABLE
from greybox_id.export.equations import Equations
from greybox_id.models.model import Symbol
from greybox_id.models.motion_model import MotionModel

BEND = ("curvature", "bends", "s_0")
"""What a stage is told of its path: curvature [1/m] at s_0 [m], and its change along s [1/m^2]."""
PLANE = ("v_x", "v_y", "yaw_rate")
"""States of motion in the plane, without which nothing moves along a path."""
SLIPS = np.linspace(0.0, 0.6, 31)
"""Slip angles, rad, over which both axles' grip is looked for: tyres of cars and racers peak at 0.05 to 0.4."""
SLOW = 0.2
"""Share of the usual speed down to which steps are stable: slower vehicles have come to a halt."""


class Period:
    """One period, with constant commands as they act.

    Parameters
    ----------
    model : at the values that are believed; its states hold those of `PLANE`, its inputs `steer` and a drive.
    period : s.
    moving : names of the parameters that differ from lane to lane.

    Attributes
    ----------
    states : names of what x holds; z is x, then s, e_y and e_psi.
    size, motion : how many numbers x holds, and how many of these are the model's own states; they come first.
    memory : steps of the past that x holds behind them.
    drive : name of the input that drives.
    equations : the model's functions; p are the moving parameters.
    usual_speed : m/s, at which the grip is looked for: that of a bend of nine wheelbases' radius at 1 g.

    Raises
    ------
    BadInput : the model moves along no path, or knows no drive.
    """

    def __init__(self, model: MotionModel, period: float, moving: Collection[str] = ()) -> None:
        self.equations, self.period = Equations(model, moving), period
        self.states = [state.name for state in self.equations.states]
        self.inputs = [one.name for one in self.equations.inputs]
        others = [name for name in self.inputs if name != "steer"]
        if not set(PLANE) <= set(self.states) or "steer" not in self.inputs or len(others) != 1:
            raise BadInput(
                f"Model {model.name} cannot drive along a track: states {', '.join(PLANE)} and inputs steer and "
                "drive are "
                "needed. Name single_track."
            )
        self.drive = others[0]
        self.size = self.motion = len(self.states)
        self.memory = 0
        wheelbase = float(model["l_f"].array + model["l_r"].array)
        self.usual_speed = 3.0 * float(np.sqrt(9.81 * wheelbase))
        self._plane = [self.states.index(name) for name in PLANE]
        self.steps = max(1, int(np.ceil(period / self._stable(SLOW * self.usual_speed))))
        self._kernel = self._made()
        self._ready = self._begun()

    def advance(self, z: Array, acting: Array, bend: Array, p: Array) -> Array:
        """z a period later, of every lane.

        Parameters
        ----------
        z : (L, n + 3).
        acting : (L, inputs) commands in the inputs' units, as they act.
        bend : (L, 3), see `BEND`.
        p : (L, parameters) of the lanes.
        """
        numbers = np.concatenate([acting, bend], axis=1)[:, None, :]
        return self._kernel.simulate(z, numbers, p, [False])[0][:, 1]

    def begun(self, v_x: float, p: Array) -> tuple[Array, Array, float]:
        """A vehicle that has driven straight ahead at a speed for long, with commands of zero.

        Returns
        -------
        x : (n,) its states.
        delays : (inputs,) how late commands act, s.
        grip : the largest lateral acceleration that both axles give together at the usual speed, m/s^2.
        """
        x, delays, grip = self._ready(v_x, p)
        return np.array(x).ravel(), np.array(delays).ravel(), float(grip)

    def latencies(self, p: Array) -> Array:
        """(3,) by how many seconds v_x, v_y and yaw rate are read late."""
        by_name = dict(zip(self.equations.late, np.array(self.equations.latencies(p)).ravel().tolist(), strict=True))
        return np.array([by_name.get(name, 0.0) for name in PLANE])

    def per_drive(self, p: Array) -> tuple[float, float]:
        """Acceleration per unit of drive and per unit of braking, at half the usual speed, m/s^2 per unit."""
        x = self.begun(0.5 * self.usual_speed, p)[0][: self.motion]
        at = [float(self.equations.ode(x, self._driven(units), p)[self._plane[0]]) for units in (-1.0, 0.0, 1.0)]
        if not at[0] < at[1] < at[2]:
            raise BadInput(
                f"Model {self.equations.model.name} is not accelerated by {self.drive}: check its parameters."
            )
        return at[2] - at[1], at[1] - at[0]

    def _driven(self, units: float) -> list[float]:
        return [units if name == self.drive else 0.0 for name in self.inputs]

    def _made(self) -> Kernel:
        """The kernel of a period: (z, commands and path, p) -> z a period later."""
        z, s = cs.SX.sym("z", self.motion + 3), cs.SX.sym("s", len(self.inputs) + len(BEND))
        return Kernel(self._function(z, s), cs.Function("read", [z, s, self.equations.p], [z[0]]))

    def _function(self, z: Symbol, s: Symbol) -> cs.Function:
        n, dt = self.motion, self.period / self.steps
        acting, bend = s[: len(self.inputs)], s[len(self.inputs) :]
        x, path = z[:n], z[n:]
        for _ in range(self.steps):
            after = self.equations.step(x, acting, self.equations.p, dt)
            path = moved_along(path, [x[k] for k in self._plane], [after[k] for k in self._plane], bend, dt)
            x = after
        return cs.Function("stage", [z, s, self.equations.p], [cs.vertcat(x, path)])

    def _begun(self) -> cs.Function:
        """(v_x, p) -> x straight ahead, delays of the inputs, and the largest lateral acceleration over sideslip."""
        equations, p, nothing, v_x = self.equations, self.equations.p, np.zeros(len(self.inputs)), cs.SX.sym("v_x")
        at = cs.SX.zeros(self.motion)
        at[self._plane[0]] = v_x
        delays = equations.delays(p)
        late = [delays[equations.delayed.index(name)] if name in equations.delayed else 0.0 for name in self.inputs]
        lateral = []
        for slip in SLIPS:
            x = np.zeros(self.motion)
            x[self._plane[0]], x[self._plane[1]] = self.usual_speed, -self.usual_speed * np.tan(slip)
            lateral.append(equations.ode(equations.settled(x, nothing, p), nothing, p)[self._plane[1]])
        result = [equations.settled(at, nothing, p), cs.vertcat(*late), cs.mmax(cs.vertcat(*lateral))]
        return cs.Function("begun", [v_x, p], result, {"cse": True})

    def _stable(self, speed: float) -> float:
        """The longest step, s, at which the Runge-Kutta method is stable straight ahead."""
        jacobian = self.equations.ode.factory("by_x", ["x", "u", "p"], ["jac:x_dot:x"])
        p = self.equations.values
        straight = np.zeros(self.motion)
        straight[self._plane[0]] = speed
        straight = np.array(self.equations.settled(straight, self._driven(0.0), p)).ravel()
        A = np.array(jacobian(straight, self._driven(0.0), p))
        size = len(self.equations.model.states)
        return float(STABLE / max(np.max(np.abs(np.linalg.eigvals(A[:size, :size]))), 1e-9))


@dataclass(frozen=True, kw_only=True, repr=False)
class SteppedModel(MotionModel, ABC):
    """A model of motion that acts from period to period, so that it has a stage of its own."""

    @abstractmethod
    def stage(self, period: float, moving: Collection[str] = ()) -> Period:
        """Its stage; arguments and what is raised as for `Period`."""


def stage(model: MotionModel, period: float, moving: Collection[str] = ()) -> Period:
    """The stage of a model; arguments and what is raised as for `Period`."""
    return model.stage(period, moving) if isinstance(model, SteppedModel) else Period(model, period, moving)


def moved_along(path: Symbol, before: Sequence[Symbol], after: Sequence[Symbol], bend: Symbol, T: float) -> Symbol:
    """s, e_y and e_psi after T seconds in which the motion changes evenly: one step of the Runge-Kutta method.

    Parameters
    ----------
    path : s [m], e_y [m] and e_psi [rad] before.
    before, after : v_x, v_y [m/s] and yaw rate [rad/s] at both ends.
    bend : see `BEND`.
    """

    def rates(now: Symbol, share: float) -> Symbol:
        v_x, v_y, yaw_rate = ((1 - share) * a + share * b for a, b in zip(before, after, strict=True))
        s, e_y, e_psi = cs.vertsplit(now)
        curvature = bend[0] + bend[1] * (s - bend[2])
        s_rate = (v_x * cs.cos(e_psi) - v_y * cs.sin(e_psi)) / (1 - curvature * e_y)
        return cs.vertcat(s_rate, v_x * cs.sin(e_psi) + v_y * cs.cos(e_psi), yaw_rate - curvature * s_rate)

    k1 = rates(path, 0.0)
    k2 = rates(path + T / 2 * k1, 0.5)
    k3 = rates(path + T / 2 * k2, 0.5)
    k4 = rates(path + T * k3, 1.0)
    return path + T / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
