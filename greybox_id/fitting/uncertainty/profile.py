"""Profile likelihood: the rise of the objective along one unknown, with all others re-optimised.

A covariance describes only the neighbourhood of the optimum; intervals of strongly nonlinear models are asymmetric or
unbounded. The profile fixes one unknown at values further and further out and optimises all others, until the objective
has risen by the amount that the confidence allows. Correlated residuals widen it as they widen the covariance: the rise
is measured in units of the variance's inflation, and Student's t replaces chi-squared. For a linear model the interval
is exactly that of the covariance. Model-form error and other uncertainty beyond the noise are included likewise: the
allowed rise grows in proportion to the variance.

Sources: Bates & Watts, Nonlinear regression analysis and its applications (1988), section 6.1, profile t; Raue et al.,
Structural and practical identifiability analysis by exploiting the profile likelihood, Bioinformatics 25 (2009); the
rise calibrated by the variance: Chandler & Bate, Inference for clustered data using the independence loglikelihood,
Biometrika 94 (2007); Pace, Salvan & Sartori, Adjusting composite likelihood ratio statistics, Statistica Sinica 21
(2011).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, NamedTuple

import numpy as np

from ...base.errors import BadInput
from ...base.numbers import alike, number, with_unit
from ...base.shorthands import Array
from ...engine.least_squares import LeastSquares, Matched
from ...engine.solvers.gauss_newton import Solution, Status, gauss_newton
from .sandwich import Uncertainty, uncertainty

STRIDE = 0.4
"""Step aimed at, as a share of the interval's half width."""
GROWTH = 2.5
"""Largest ratio of successive steps."""
REACH = 100.0
"""Distance from the estimate, in half widths, at which a profile that has not risen enough counts as flat."""
CLOSE, CLOSER = 0.02, 8
"""Distance from the crossing, as a share of the half width, within which a profile is interpolated; largest number of
evaluations to get there."""
SETTLED, REPEATS = 1e-3, 10
"""Predicted decrease, as a share of the allowed rise, at which a point is optimised; largest number of restarts."""


class End(Enum):
    """End of one side of a profile, in words."""

    CROSSED = "ends where the fit becomes too bad"
    BOUND = "ends at the bound; the recording alone does not limit it there"
    FLAT = "has no end: the recording does not limit it there"
    NOT_FINITE = "ends where the model is not finite any more; the recording alone does not limit it there"


@dataclass(frozen=True)
class NoiseAlone:
    """The interval of a profile from the noise alone, without the fit's other uncertainty.

    Attributes
    ----------
    allowed : rise at which it ends.
    interval : lower and upper end; infinite or at the bound if the profile does not cross.
    ends : kind of the lower and upper end.
    """

    allowed: float
    interval: tuple[float, float]
    ends: tuple[End, End]


@dataclass(frozen=True)
class Profile:
    """The profile of one unknown.

    Attributes
    ----------
    index : index of the unknown.
    values : (points,) ascending.
    rise : (points,) of the objective above the optimum, all other unknowns re-optimised.
    allowed : rise at which the interval ends.
    interval : lower and upper end, including the fit's uncertainty beyond the noise (model-form error); infinite or at
        the bound if the profile does not cross.
    ends : kind of the lower and upper end.
    noise_alone : the interval without model-form error; the same if the fit has none.
    unknowns : (points, unknowns) all unknowns along the profile.
    settled : whether every point was fully optimised.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 200)
    >>> found = gb.fit("kinematic", lap, vehicle="roboracer").profile("yaw_lag")
    >>> found.identifiable
    True
    """

    index: int
    values: Array = field(repr=False)
    rise: Array = field(repr=False)
    allowed: float
    interval: tuple[float, float]
    ends: tuple[End, End]
    noise_alone: NoiseAlone
    unknowns: Array = field(repr=False)
    settled: bool

    @property
    def identifiable(self) -> bool:
        """Whether the recording (or a prior) limits the unknown on both sides."""
        return self.ends == (End.CROSSED, End.CROSSED)

    @property
    def at_a_better_optimum(self) -> bool:
        """Whether a point of the profile has a lower objective than the supposed optimum."""
        return bool(np.min(self.rise) < -0.01 * self.noise_alone.allowed)

    def about(self, name: str, unit: str = "") -> str:
        """The interval and its ends in plain sentences."""
        low, high = self.interval
        ends = alike(low, high, by=(high - low) / 4.0)
        stated = [f"{name} lies between {ends[0]} and {with_unit(ends[1], unit)}."]
        stated += [
            f"Its {side} side {end.value}."
            for side, end in zip(("lower", "upper"), self.ends, strict=True)
            if end is not End.CROSSED
        ]
        if self.at_a_better_optimum:
            better = self.values[np.argmin(self.rise)]
            stated.append(
                f"The fit was not at its optimum: the value {number(better, 4)} fits better; fit again from there."
            )
        if not self.settled:
            stated.append("Some points of the profile did not converge: the interval may be too narrow.")
        return " ".join(stated)


def profile(
    problem: LeastSquares,
    x: Array,
    nodes: Matched,
    index: int,
    *,
    known: Uncertainty | None = None,
    confidence: float = 0.95,
    wider: float = 1.0,
) -> Profile:
    """Profile one unknown around an optimum.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) an optimum of it.
    nodes : the problem's simulation there.
    index : index of the unknown.
    known : uncertainty at the optimum, if already known.
    confidence : of the interval.
    wider : ratio of the fit's standard deviation to that of the noise alone, at least 1.

    Raises
    ------
    BadInput : the unknown is fixed.
    """
    if not problem.free[index]:
        raise BadInput(f"The quantity with index {index} is fixed; only quantities that are fitted have a profile.")
    known = known or uncertainty(problem, x, nodes)
    inflation, sd = float(known.inflation[index]), float(known.sd[index])
    allowed = 0.5 * inflation * float(known.quantile(confidence)[index]) ** 2
    half_width = sd * float(known.quantile(confidence)[index])
    if not (np.isfinite(half_width) and half_width > 0.0):
        half_width = max(abs(float(x[index])), 1.0)
    goals = _Goal(allowed, half_width), _Goal(wider**2 * allowed, wider * half_width)
    walk = _Walk(problem, x, problem.objective(x, nodes), index, goals)
    lower, upper = walk.towards(-1), walk.towards(1)
    points = [*lower.points[:0:-1], *upper.points]
    noise, both = (
        ((below.limit, above.limit), (below.end, above.end))
        for below, above in zip(lower.limits, upper.limits, strict=True)
    )
    return Profile(
        index,
        np.array([point.x[index] for point in points]),
        np.array([point.rise for point in points]),
        goals[1].allowed,
        *both,
        NoiseAlone(allowed, *noise),
        np.array([point.x for point in points]),
        all(point.settled for point in points),
    )


class _Goal(NamedTuple):
    """The rise at which an interval ends, and its half width expected from the covariance."""

    allowed: float
    half: float

    def root(self, point: _Point) -> float:
        """Root of the rise over the allowed one: for a linear model, the distance in half widths."""
        return float(np.sqrt(max(point.rise, 0.0) / self.allowed))


class _Point(NamedTuple):
    x: Array
    rise: float
    settled: bool


class _Limit(NamedTuple):
    limit: float
    end: End


class _Side(NamedTuple):
    """One side of a profile: points outwards, the optimum first, and the end of each interval."""

    points: list[_Point]
    limits: list[_Limit]


class _Walk:
    """Steps outwards from an optimum x, (unknowns,), to one goal after the other, the nearest first."""

    def __init__(self, problem: LeastSquares, x: Array, objective: float, index: int, goals: tuple[_Goal, ...]) -> None:
        self.held = copy.copy(problem)
        self.held.free = problem.free.copy()
        self.held.free[index] = False
        self.x, self.objective, self.index, self.goals = x, objective, index, goals

    def towards(self, direction: Literal[-1, 1]) -> _Side:
        """Walk to the end of one side."""
        estimate, half = float(self.x[self.index]), self.goals[0].half
        points, limits = [_Point(self.x, 0.0, True)], list[_Limit]()
        step = STRIDE * min(half, max(abs(estimate), half / REACH))
        stopped: _Limit | None = None
        for goal in self.goals:
            if stopped is None:  # a stop ends the wider interval, too
                stopped, step = self._walked(goal, direction, points, step)
            limits.append(stopped or _Limit(self._crossing(points, goal), End.CROSSED))
        return _Side(points, limits)

    def _walked(
        self, goal: _Goal, direction: Literal[-1, 1], points: list[_Point], step: float
    ) -> tuple[_Limit | None, float]:
        """Add points up to the first beyond a goal; return the limit if the walk stops before, and the next step."""
        bound, shortened = float(self.held.bounds[(direction + 1) // 2][self.index]), 0
        while goal.root(points[-1]) < 1.0:
            value = float(points[-1].x[self.index])
            if value == bound:
                return _Limit(bound, End.BOUND), step
            if abs(value - self.x[self.index]) >= REACH * goal.half:
                return _Limit(direction * np.inf, End.FLAT), step
            further = direction * min(direction * value + step, direction * bound)
            result = self._at(further, points, goal)
            if result is None:
                step, shortened = step / 4.0, shortened + 1
                if shortened > CLOSER:
                    return _Limit(value, End.NOT_FINITE), step
                continue
            slope = (goal.root(result) - goal.root(points[-1])) / abs(further - value)
            points.append(result)
            step = min(GROWTH * step, STRIDE / slope if slope > 0.0 else np.inf)
        return None, step

    def _crossing(self, points: list[_Point], goal: _Goal) -> float:
        """The crossing in the last stretch, by secants in the root of the rise, which is nearly linear."""
        for _ in range(CLOSER):
            inside, outside = points[-2:]
            if min(abs(goal.root(p) - 1.0) for p in (inside, outside)) < CLOSE:
                break
            result = self._at(self._between(inside, outside, goal), points[:-1], goal)
            if result is None:
                break
            points.insert(-1, result)
            if goal.root(result) >= 1.0:
                points.pop()
        inside, outside = points[-2:]
        return self._between(inside, outside, goal)

    def _between(self, inside: _Point, outside: _Point, goal: _Goal) -> float:
        low, high = goal.root(inside), goal.root(outside)
        share = (1.0 - low) / (high - low)
        return float(inside.x[self.index] + share * (outside.x[self.index] - inside.x[self.index]))

    def _at(self, value: float, points: list[_Point], goal: _Goal) -> _Point | None:
        """The other unknowns optimised with this one fixed at a value; None if the model is not finite."""
        last = points[-1].x
        starts = [last.copy()]
        if len(points) > 1:
            along = last - points[-2].x
            starts.insert(0, last + along * (value - last[self.index]) / along[self.index])
        for start in starts:
            start[self.index] = value
            solution = gauss_newton(self.held, start, negligible=0.0, search="levenberg_marquardt")
            for _ in range(REPEATS):
                if solution.status not in (Status.SLOW, Status.STEP_LIMIT) or self._settled(solution, goal):
                    break
                solution = gauss_newton(self.held, solution.x, negligible=0.0, search="levenberg_marquardt")
            if solution.status is Status.INTERRUPTED:
                raise KeyboardInterrupt
            if solution.status is not Status.NOT_FINITE:
                return _Point(solution.x, solution.objective - self.objective, self._settled(solution, goal))
        return None

    def _settled(self, solution: Solution, goal: _Goal) -> bool:
        """Whether further steps would not change the interval noticeably."""
        return solution.status is Status.CONVERGED or solution.decrement * solution.objective < SETTLED * goal.allowed
