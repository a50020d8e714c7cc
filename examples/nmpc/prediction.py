"""What the controller predicts: any model of motion, on its way along a path, with commands that may be late.

A stage's state z holds the model's state x, the place on the path (s, e_y, e_psi) and, for every input, the commands
that have been given and may be on their way, the newest first. Its control holds the rates of the commands: a command
lasts for a period and is the one before it, moved on at that rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from greybox_id.export.equations import Equations
from greybox_id.models.motion_model import MotionModel
from greybox_lab.driving.racing.stage import BEND, moved_along

Row = NDArray[np.float64]
Symbol = Any


@dataclass(frozen=True)
class Arrival:
    """How late an input's command arrives: whole periods, and a share of one."""

    periods: int
    share: float


class Prediction:
    """A model and its commands, a period at a time.

    Parameters
    ----------
    model : at the values that are believed.
    period : s, for which a command is held.
    units : of the commands, in those of the model's inputs: z and rates hold commands in these.
    pushed : states to which a stage adds what it is told behind the bend: what a network says that the model is off by.

    Attributes
    ----------
    size, inputs : how many numbers z and a control have.
    own : how many of z, the first ones, are not what is remembered for a network.
    stage : (z, rates, bend and pushes) -> z a period later.
    motion : names of the model's own states; what is measured of x is called by them.
    path : where s, e_y and e_psi stand in z.
    slips : (z) -> slip angles of the front and rear axle, rad, as far as geometry tells.
    newest : where the newest command of every input stands in z.
    """

    def __init__(self, model: MotionModel, period: float, units: Row, pushed: Sequence[str] = ()) -> None:
        equations = Equations(model, moving=())
        self.period, self.inputs = period, len(equations.inputs)
        self.motion = [entry.name for entry in equations.states]
        late = equations.shifts()
        self.arrivals = [_arrival(late.get(f"delay of {entry.name}", 0.0), period) for entry in equations.inputs]
        n = len(self.motion)
        self.path = np.arange(n, n + 3)
        lengths = [arrival.periods + 1 for arrival in self.arrivals]
        self.newest = n + 3 + np.concatenate(([0], np.cumsum(lengths)[:-1]))
        self.size = self.own = n + 3 + sum(lengths)
        self.stage = self._stage(equations, lengths, units, pushed)
        self.slips = self._slips(model, units)

    @property
    def pattern(self) -> Row:
        """(size, size + inputs) ones where a stage's z depends on z and rates before."""
        return np.ones((self.size, self.size + self.inputs))

    def started(self, v_x: float, s: float) -> Row:
        """z of a vehicle that has gone straight ahead on the path for long, with commands of zero."""
        z = np.zeros(self.size)
        z[self.motion.index("v_x")], z[self.path[0]] = v_x, s
        return z

    def _stage(self, equations: Equations, lengths: list[int], units: Row, pushed: Sequence[str]) -> cs.Function:
        n, T = len(self.motion), self.period
        z, rates, told = (
            cs.SX.sym("z", self.size),
            cs.SX.sym("rates", self.inputs),
            cs.SX.sym("told", len(BEND) + len(pushed)),
        )
        x, path = z[:n], z[n : n + 3]
        queues = cs.vertsplit(z[n + 3 :], np.concatenate(([0], np.cumsum(lengths))).tolist())
        acting, moved = [], []
        for queue, rate, arrival in zip(queues, cs.vertsplit(rates), self.arrivals, strict=True):
            given = cs.vertcat(queue[0] + T * rate, queue)
            early, later = given[arrival.periods + 1], given[arrival.periods]
            acting.append(arrival.share * early + (1.0 - arrival.share) * later)
            moved.append(given[:-1])
        after = equations.step(x, cs.vertcat(*acting) * units, equations.values, T)
        for k, name in enumerate(pushed, len(BEND)):
            after[self.motion.index(name)] += told[k]
        named = [self.motion.index(name) for name in ("v_x", "v_y", "yaw_rate")]
        along = moved_along(path, [x[k] for k in named], [after[k] for k in named], told[: len(BEND)], T)
        return cs.Function("stage", [z, rates, told], [cs.vertcat(after, along, *moved)])

    def _slips(self, model: MotionModel, units: Row) -> cs.Function:
        z, steer = cs.SX.sym("z", self.size), model.inputs.index("steer")
        v_x, v_y, yaw_rate = (z[self.motion.index(name)] for name in ("v_x", "v_y", "yaw_rate"))
        front, rear = (float(model[name].array) for name in ("l_f", "l_r"))
        arriving = z[int(self.newest[steer]) + self.arrivals[steer].periods] * units[steer]
        slips = arriving - (v_y + front * yaw_rate) / v_x, -(v_y - rear * yaw_rate) / v_x
        return cs.Function("slips", [z], [cs.vertcat(*slips)])


def _arrival(late: float, period: float) -> Arrival:
    periods = int(late / period + 1e-9)
    return Arrival(periods, max(late / period - periods, 0.0))
