"""A nonlinear model-predictive controller that follows a path, by real-time iterations.

Every period the problem over the horizon is linearised once, about the plan before it, and the quadratic program that
results is solved by HPIPM, which exploits its stages (Frison & Diehl, IFAC 2020). Source of the scheme: Diehl et al.,
"Real-time optimization and nonlinear model predictive control", J. Process Control 12, 2002.

    minimise   sum over stages of |r(z, rates)|^2 + slack      r: path, course, speed, and rates of the commands
    subject to z_(k+1) = stage(z_k, rates_k), z_0 as measured
               commands and their rates within bounds, |e_y| within the track but for the slack
"""

from __future__ import annotations

import time
from itertools import chain

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from prediction import Prediction
from program import Linear, Program
from wishes import Wishes

from greybox_lab.driving.racing.track import RaceTrack

Row = NDArray[np.float64]
Grid = NDArray[np.float64]


SOFT = ("e_y", "alpha_f", "alpha_r")
"""What is to stay within its bounds, unless it cannot: lateral error and slip angles."""


class Controller:
    """A controller for one vehicle on one track.

    Parameters
    ----------
    prediction : what it believes of the vehicle.
    track : to follow.
    wishes : what it is to do.
    v_x, s : m/s and m, how fast and where on the track it starts.

    Attributes
    ----------
    seconds : what each decision took, s.
    failures : decisions at which the quadratic program was not solved, and the plan before was carried on.
    """

    def __init__(self, prediction: Prediction, track: RaceTrack, wishes: Wishes, v_x: float, s: float = 0.0) -> None:
        self.prediction, self.track, self.wishes = prediction, track, wishes
        self.seconds: list[float] = []
        self.failures = 0
        self._linearised = _linearised(prediction, wishes, track.half_width).map(wishes.stages)
        self._program = Program(prediction, wishes, len(SOFT))
        self._now = prediction.started(v_x, s)
        self._plan, self._rates = self._carried_on(self._now)

    def decide(self, measured: dict[str, float], s: float, e_y: float, e_psi: float) -> Row:
        """The commands of the next period.

        Parameters
        ----------
        measured : states of the model by name, those that are measured; others are as foretold.
        s, e_y, e_psi : place on the path, m, m and rad.
        """
        begun = time.thread_time()
        z = self._now.copy()
        for k, name in enumerate(self.prediction.motion):
            z[k] = measured.get(name, z[k])
        z[self.prediction.path] = s, e_y, e_psi
        at = self._plan[:, self.prediction.path[0]]
        bends, wanted = self._along("curvature", at[:-1]), self._along("speed", at[1:])
        parts = self._linearised(self._plan[:-1].T, self._rates.T, self._plan[1:].T, bends.T, wanted.T)
        blocks = [part.full().reshape(part.shape[0], len(self._rates), -1).transpose(1, 0, 2) for part in parts]
        values, derivatives = (block[:, :, 0] for block in blocks[::2]), blocks[1::2]
        linear = Linear(*chain(*zip(values, derivatives, strict=True)))
        found = self._program.solved(z, self._plan, self._rates, linear)
        if found is None:
            self.failures += 1
            self._plan, self._rates = self._carried_on(z)
        else:
            self._plan, self._rates = found
        rates = self._rates[0].copy()
        self.seconds.append(time.thread_time() - begun)

        self._now = self._foretold(z, rates)
        self._rates = np.vstack([self._rates[1:], np.zeros(len(rates))])
        self._plan = np.vstack([self._plan[1:], self._foretold(self._plan[-1], self._rates[-1])])
        return self._now[self.prediction.newest] * self.wishes.units

    def _carried_on(self, z: Row) -> tuple[Grid, Grid]:
        """A plan that leaves the commands as they are, and its rates."""
        rates = np.zeros((self.wishes.stages, self.prediction.inputs))
        plan = [z]
        for own in rates:
            plan.append(self._foretold(plan[-1], own))
        return np.array(plan), rates

    def _foretold(self, z: Row, rates: Row) -> Row:
        bend = self._along("curvature", z[self.prediction.path[:1]])[0]
        return np.asarray(self.prediction.stage(z, rates, bend)).ravel()

    def _along(self, what: str, s: Row) -> Grid:
        """(n, 3) what the track has at places along it, its change along s, and the places."""
        value, change = self.track.line(what, s)
        return np.stack([value, change, s], axis=1)


def _linearised(prediction: Prediction, wishes: Wishes, half_width: float) -> cs.Function:
    """(z, rates, z of the next stage, bend, wanted) -> the columns of a `Linear`."""
    symbols = cs.SX if prediction.own == prediction.size else cs.MX  # networks are matrices
    z, rates = symbols.sym("z", prediction.size), symbols.sym("rates", prediction.inputs)
    end, bend, wanted = symbols.sym("end", prediction.size), symbols.sym("bend", 3), symbols.sym("wanted", 3)
    after = prediction.stage(z, rates, bend)
    v_x, v_y = (end[prediction.motion.index(name)] for name in ("v_x", "v_y"))
    s, e_y, e_psi = (end[k] for k in prediction.path.tolist())
    speed = v_x - wanted[0] - wanted[1] * (s - wanted[2])
    off = cs.vertcat(e_y / wishes.path, (e_psi + v_y / v_x) / wishes.course, speed / wishes.speed)
    slips = prediction.slips(end) / wishes.slip
    kept = cs.vertcat(e_y / half_width, slips)
    parts = (after, cs.jacobian(after, cs.vertcat(z, rates)), off, cs.jacobian(off, end), kept, cs.jacobian(kept, end))
    return cs.Function("linearised", [z, rates, end, bend, wanted], [cs.densify(part) for part in parts])
