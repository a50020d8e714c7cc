"""Bounded steps of all coordinates of a joint problem, with the damping that lowers the objective most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.shorthands import Array, Mask
from .calibration import CAL
from .first_order import FirstOrder
from .noise import Whitener
from .problem import JointProblem, JointState, Linear
from .sparse import Quadratic


@dataclass(frozen=True)
class JointStep:
    """A step of all coordinates.

    Attributes
    ----------
    state : after it.
    length : in standard deviations and usual sizes, largest over coordinates.
    gained : nats by which the objective fell.
    """

    state: JointState
    length: float
    gained: float

    @property
    def last(self) -> bool:
        """Whether the search has converged: coordinates that a recording hardly informs move far and gain nothing."""
        return self.length < CAL.still or self.gained < CAL.still_gain


class DampedSteps:
    """Gauss-Newton steps of a problem's coordinates.

    Each is tried with several dampings (Levenberg, Q. Appl. Math. 2, 1944), simulated side by side: a recording does
    not inform most combinations of coordinates, and where simulations are nonlinear, steps along these raise the cost.

    Parameters
    ----------
    problem : what is explained.
    stride : how far a step goes at most, in standard deviations of parameters and in usual sizes of causes.
    """

    def __init__(self, problem: JointProblem, stride: float = CAL.strides[0]) -> None:
        self.problem, self.stride = problem, stride
        self.switched_at = np.maximum(3 * problem.zone, CAL.switched_on * problem.usual)

    @property
    def _usual(self) -> Array:
        """Standard deviations of parameters, at the present scale of model error, and usual sizes of causes."""
        return np.concatenate([self.problem.theta_sd, self.problem.usual])

    def taken(
        self, state: JointState, quadratic: Quadratic, variance: Array, whitener: Whitener, included: Mask | None = None
    ) -> JointStep:
        """The step from a state that lowers the objective most.

        Parameters
        ----------
        quadratic : normal equations about the state.
        variance : (causes,) prior variances of magnitudes.
        included : the inclusion mask, where it is given; else causes that the step makes large enough to be simulated,
            and those that still are.
        """
        problem, linear, known = self.problem, quadratic.about, included is not None
        stride = self._strides(linear)
        if included is None:
            within = np.maximum(linear.low - linear.at, -stride), np.minimum(linear.high - linear.at, stride)
            off = np.abs(quadratic.best(variance, within) - linear.mean)[linear.main]
            included = (off > self.switched_at) & (variance > 4 * problem.zone**2)
            included |= state.on & (np.abs(state.m - problem.null) > self.switched_at)
        on = included & ~problem.smooth
        back = replace(state, on=state.on & on) if np.any(state.on & ~on & ~problem.smooth) else state
        new, least, gained = back, np.inf, 0.0
        for goes in (on, back.on) if np.any(on & ~back.on) else (on,):  # all else may have to converge first
            first = FirstOrder(quadratic, quadratic.precision(variance), self.switched_at, goes & ~state.on)
            within = np.maximum(first.low, -stride), np.minimum(first.high, stride)
            ahead = [
                problem.moved(back, quadratic.best(variance, within, damping), goes)
                for damping in self._dampings(linear)
            ]
            here, *values = self._objectives([back, *ahead], first, whitener, variance)
            best = int(np.argmin(values))
            if values[best] < min(here + 1e-6, least):
                new, least, gained = ahead[best], values[best], here - values[best]
                if known:  # causes of a given set are simulated as soon as that lowers the objective
                    break
        if new is back:
            return JointStep(back, 0.0, 0.0)
        moved = np.concatenate([new.theta - state.theta, new.m - state.m])
        return JointStep(new, float(np.max(np.abs(moved) / self._usual, initial=0.0)), gained)

    def _dampings(self, linear: Linear) -> list[Array]:
        """(K,) each: damping precisions; first-order coordinates are not damped."""
        scale = linear.sd.copy()
        scale[linear.main] = self.problem.usual
        return [np.where(linear.moved, damping / scale**2, 0.0) for damping in CAL.dampings]

    def _strides(self, linear: Linear) -> Array:
        """(K,) longest steps: beyond these, simulations differ from their linearisation."""
        stride = np.full(len(linear.at), np.inf)
        usual = self._usual
        stride[: len(usual)] = self.stride * usual
        return np.where(linear.moved, stride, np.inf)

    def _objectives(
        self, states: Sequence[JointState], first: FirstOrder, whitener: Whitener, variance: Array
    ) -> list[float]:
        """Half of the squares of residuals and of the prior that each state leaves."""
        residuals = self.problem.residuals([self.problem.vector(state) for state in states])
        result = [np.inf] * len(states)
        if finite := [k for k, e in enumerate(residuals) if np.all(np.isfinite(e))]:
            white = whitener.white(np.moveaxis(residuals[finite], 0, -1))
            left = first.left(white.reshape(-1, len(finite)))
            for k, value in zip(finite, left, strict=True):
                result[k] = self._objective(states[k], float(value), variance)
        return result

    def _objective(self, state: JointState, left: float, variance: Array) -> float:
        problem = self.problem
        theta = (state.theta - problem.theta_mean) / problem.theta_sd
        mains = np.where(problem.smooth | state.on, state.m - problem.mean, 0.0) / np.sqrt(variance)
        seconds = 0.0
        for k in np.flatnonzero(state.on & ~problem.smooth):
            axes = problem.causes[k].forms[state.form[k]].candidate.axes[1:]
            for axis, at in zip(axes, state.seconds[k], strict=True):
                if axis.low < axis.high:
                    seconds += ((at - axis.mean) / axis.sd) ** 2
        total = 0.5 * (left + float(theta @ theta) + float(mains @ mains) + seconds)
        return total if np.isfinite(total) else np.inf
