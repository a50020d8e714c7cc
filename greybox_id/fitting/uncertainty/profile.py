"""Profile likelihood: how far one unknown can move while all others do their best to make up for it.

A covariance describes the optimum's immediate surroundings; far from linear models have intervals that lean to one side
or have no end. The profile follows the optimum of all other unknowns while one is held at values further and further
out, until the objective has risen by what the confidence allows. Correlated residuals widen it as they widen the
covariance: the rise counts in units of the variance's inflation, and Student's t takes the place of chi-squared. For a
linear model the interval is that of the covariance, exactly.

Sources: Bates & Watts, Nonlinear regression analysis and its applications (1988), section 6.1, profile t; Raue et al.,
Structural and practical identifiability analysis by exploiting the profile likelihood, Bioinformatics 25 (2009).
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
"""A step is at most so many times the one before."""
REACH = 100.0
"""So many half widths away from the estimate, a profile that has not risen enough counts as flat."""
CLOSE, CLOSER = 0.02, 8
"""How near the crossing, as a share of the half width, a profile is evaluated before it is interpolated; tries."""
SETTLED, REPEATS = 1e-3, 10
"""Share of the allowed rise that an optimisation may still promise; how often a slow one is carried on."""


class End(Enum):
    """How one side of a profile ends, in words."""

    CROSSED = "ends where the fit becomes too bad"
    BOUND = "ends at the bound; the recording alone does not limit it there"
    FLAT = "has no end: the recording does not limit it there"
    NOT_FINITE = "ends where the model is not finite any more; the recording alone does not limit it there"


@dataclass(frozen=True)
class Profile:
    """The profile of one unknown.

    Attributes
    ----------
    index : of the unknown.
    values : (points,) rising.
    rise : (points,) of the objective above the optimum, all other unknowns re-optimised.
    allowed : rise at which the interval ends.
    interval : lower and upper end; infinite or at the bound where the profile does not cross.
    ends : how either side ends.
    unknowns : (points, unknowns) all unknowns along the profile.
    settled : whether every point was optimised to its end.

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
    unknowns: Array = field(repr=False)
    settled: bool

    @property
    def identifiable(self) -> bool:
        """Whether the recording (or a prior) limits the unknown on both sides."""
        return self.ends == (End.CROSSED, End.CROSSED)

    @property
    def at_a_better_optimum(self) -> bool:
        """Whether a point of the profile fits better than the supposed optimum did."""
        return bool(np.min(self.rise) < -0.01 * self.allowed)

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
    told: Uncertainty | None = None,
    confidence: float = 0.95,
) -> Profile:
    """Profile one unknown about an optimum.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) an optimum of it.
    nodes : the problem's simulation there.
    index : of the unknown.
    told : uncertainty at the optimum, if it is known already.
    confidence : of the interval.

    Raises
    ------
    BadInput : the unknown is held.
    """
    if not problem.free[index]:
        raise BadInput(f"The quantity with index {index} is fixed; only quantities that are fitted have a profile.")
    told = told or uncertainty(problem, x, nodes)
    inflation, sd = float(told.inflation[index]), float(told.sd[index])
    allowed = 0.5 * inflation * float(told.quantile(confidence)[index]) ** 2
    half = sd * float(told.quantile(confidence)[index])
    if not (np.isfinite(half) and half > 0.0):
        half = max(abs(float(x[index])), 1.0)
    walk = _Walk(problem, x, problem.objective(x, nodes), index, allowed, half)
    lower, upper = walk.towards(-1), walk.towards(1)
    points = [*lower.points[:0:-1], *upper.points]
    return Profile(
        index,
        np.array([point.x[index] for point in points]),
        np.array([point.rise for point in points]),
        allowed,
        (lower.limit, upper.limit),
        (lower.end, upper.end),
        np.array([point.x for point in points]),
        all(point.settled for point in points),
    )


class _Point(NamedTuple):
    x: Array
    rise: float
    settled: bool


class _Side(NamedTuple):
    """One side of a profile: points outwards, the optimum first."""

    points: list[_Point]
    end: End
    limit: float


class _Walk:
    """Steps outwards from an optimum, (unknowns,) x; half: width to one side that the covariance makes us expect."""

    def __init__(
        self, problem: LeastSquares, x: Array, objective: float, index: int, allowed: float, half: float
    ) -> None:
        self.held = copy.copy(problem)
        self.held.free = problem.free.copy()
        self.held.free[index] = False
        self.x, self.objective, self.index, self.allowed, self.half = x, objective, index, allowed, half

    def towards(self, direction: Literal[-1, 1]) -> _Side:
        """Walk to the end of one side."""
        bound = float(self.held.bounds[(direction + 1) // 2][self.index])
        points, value = [_Point(self.x, 0.0, True)], float(self.x[self.index])
        estimate = value
        step = STRIDE * min(self.half, max(abs(value), self.half / REACH))
        shortened = 0
        while True:
            if value == bound:
                return _Side(points, End.BOUND, bound)
            if abs(value - estimate) >= REACH * self.half:
                return _Side(points, End.FLAT, direction * np.inf)
            further = direction * min(direction * value + step, direction * bound)
            result = self._at(further, points)
            if result is None:
                step, shortened = step / 4.0, shortened + 1
                if shortened > CLOSER:
                    return _Side(points, End.NOT_FINITE, value)
                continue
            slope = (self._root(result) - self._root(points[-1])) / abs(further - value)
            points.append(result)
            value = further
            if self._root(result) >= 1.0:
                return _Side(points, End.CROSSED, self._crossing(points))
            step = min(GROWTH * step, STRIDE / slope if slope > 0.0 else np.inf)

    def _crossing(self, points: list[_Point]) -> float:
        """Where the last stretch crosses, approached by secants in the root of the rise, which is nearly straight."""
        for _ in range(CLOSER):
            inside, outside = points[-2:]
            if min(abs(self._root(p) - 1.0) for p in (inside, outside)) < CLOSE:
                break
            result = self._at(self._between(inside, outside), points[:-1])
            if result is None:
                break
            points.insert(-1, result)
            if self._root(result) >= 1.0:
                points.pop()
        return self._between(*points[-2:])

    def _between(self, inside: _Point, outside: _Point) -> float:
        low, high = self._root(inside), self._root(outside)
        share = (1.0 - low) / (high - low)
        return float(inside.x[self.index] + share * (outside.x[self.index] - inside.x[self.index]))

    def _root(self, point: _Point) -> float:
        """Root of the rise over the allowed one: for a linear model, the distance in half widths."""
        return float(np.sqrt(max(point.rise, 0.0) / self.allowed))

    def _at(self, value: float, points: list[_Point]) -> _Point | None:
        """The others at their best while the unknown is held at a value; None where the model is not finite."""
        last = points[-1].x
        starts = [last.copy()]
        if len(points) > 1:
            along = last - points[-2].x
            starts.insert(0, last + along * (value - last[self.index]) / along[self.index])
        for start in starts:
            start[self.index] = value
            solution = gauss_newton(self.held, start, negligible=0.0, search="levenberg_marquardt")
            for _ in range(REPEATS):
                if solution.status not in (Status.SLOW, Status.STEP_LIMIT) or self._settled(solution):
                    break
                solution = gauss_newton(self.held, solution.x, negligible=0.0, search="levenberg_marquardt")
            if solution.status is Status.INTERRUPTED:
                raise KeyboardInterrupt
            if solution.status is not Status.NOT_FINITE:
                return _Point(solution.x, solution.objective - self.objective, self._settled(solution))
        return None

    def _settled(self, solution: Solution) -> bool:
        """Whether further steps would not matter to the interval."""
        return solution.status is Status.CONVERGED or solution.decrement * solution.objective < SETTLED * self.allowed
