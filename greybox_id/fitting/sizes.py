"""Step sizes of effects that round an input: search for the best of many optima, and intervals that include them all.

With another size the steps are elsewhere, so that the objective has an optimum wherever the largest reading is a whole
number of steps, with ripples from single rows on top. Curvature describes only the ripple in which a search ended, not
the uncertainty of the size. Therefore the objective is profiled outwards over ripples, and over optima beyond the best
one; the interval contains the sizes that explain the readings as well as the best one, but for chance.

The role of chance is known for thresholds: a size moves the thresholds between steps, rows cross them one by one, and
the log-likelihood around the truth is a random walk to both sides, not a parabola. Twice its rise is below z with the
probability (1 - exp(-z / 2))^2. Source: Hansen, Sample splitting and threshold estimation, Econometrica 68 (2000),
theorem 2 and table 1. The best of the many sizes tried gains something even if nothing is rounded: a size of zero
remains possible unless the gain exceeds that of the best of as many by chance (chi-squared, after Bonferroni).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy

import numpy as np
from scipy.special import chdtri

from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..engine.motion.shooting import MotionProblem
from ..engine.solvers.gauss_newton import Status, gauss_newton
from ..models.parameter import free_places
from .how import Say, quiet
from .uncertainty.sandwich import Uncertainty

EVERY_SIZE = np.arange(1.0, 200.0, 0.25), False
"""Numbers of steps up to the largest reading that are tried: a search from within a third of a step converges to the
right size, and steps finer than half a per cent of the signal are not searched. False: not relative to the present."""
NEAR_SIZES = np.linspace(-0.5, 0.5, 101), True
"""Numbers of steps relative to the present one."""
CONFIDENCE = 0.95
RISE = -2.0 * float(np.log(1.0 - np.sqrt(CONFIDENCE)))
"""Twice the rise of the objective up to which sizes count as possible."""
BY_CHANCE = float(chdtri(1, (1.0 - CONFIDENCE) / len(EVERY_SIZE[0])))
"""Twice the gain of the best of all sizes over none that chance exceeds with the probability 1 - CONFIDENCE."""
STEPS_OF_OTHERS = 5
"""Steps of the search for the other unknowns at a fixed size."""
BETWEEN = 4
"""How often the interval between the last possible size and the next one is halved."""


def at_best_sizes(
    problem: MotionProblem, recordings: Sequence[Recording], x: Array, tried: tuple[Array, bool], say: Say = quiet
) -> Array:
    """(unknowns,) with the free sizes of rounding effects set to their best values, all else unchanged.

    Parameters
    ----------
    tried : numbers of steps up to the largest reading, and whether they are relative to the present one.
    """
    places = rounding(problem)
    best, least = x, _objective(problem, x) if places else np.inf
    for name, place in places.items():
        largest = _largest(problem, recordings, name)
        low, high = problem.model[name].bounds
        numbers, relative = tried
        for k, steps in enumerate(numbers + largest / problem.shared(x)[place] if relative else numbers):
            if steps > 0 and low < (size := largest / steps) < high:
                other = _with_size(problem, x, place, size)
                if (value := _objective(problem, other)) < least:
                    best, least = other, value
                say(f"{problem.model.name}: size {k + 1} of {len(numbers)}, {name}={size:.6g}", passing=True)
        x = best
    return best


def error_of_sizes(
    problem: MotionProblem, recordings: Sequence[Recording], x: Array, from_curvature: Uncertainty, say: Say = quiet
) -> Array:
    """(unknowns, unknowns) contribution of the sizes' many optima to the covariance, the other unknowns following.

    Parameters
    ----------
    x : (unknowns,) an optimum.
    from_curvature : uncertainty from the curvature there.
    """
    result = np.zeros((problem.layout.size, problem.layout.size))
    for name, place in rounding(problem).items():
        index = int(problem.parameters.index[0][place])
        inflation, quantile = float(from_curvature.inflation[index]), float(from_curvature.quantile(CONFIDENCE)[index])
        unit = 0.5 * (max(1.0, inflation) if np.isfinite(inflation) else 1.0)
        possible = _Possible(problem, x, place, unit * RISE, say)
        ends = possible.ends(_largest(problem, recordings, name))
        none = problem.model[name].null
        if none is not None and (without := possible.at(none, unit * BY_CHANCE)) is not None:
            ends.append(without)
        away = max((end - x for end in ends), key=lambda moved: abs(moved[index]))
        result += np.outer(away, away) / quantile**2
    return result


def rounding(problem: MotionProblem) -> dict[str, int]:
    """Free sizes of effects that round an input, and their indices among the parameters."""
    return {k: v for k, v in free_places(problem.model.parameters).items() if k in problem.model.rounded}


class _Possible:
    """The sizes that explain the readings as well as an optimum x, (unknowns,), but for chance."""

    def __init__(self, problem: MotionProblem, x: Array, place: int, allowed: float, say: Say) -> None:
        self.problem, self.x, self.place, self.allowed, self.say = problem, x, place, allowed, say
        self.name = problem.model.name
        self.held = copy(problem)
        self.held.free = problem.free.copy()
        self.held.free[[index[place] for index in problem.parameters.index]] = False
        self.least, self.tried = _objective(problem, x), 0

    def ends(self, largest: float) -> list[Array]:
        """(unknowns,) at the smallest and the largest possible size.

        Parameters
        ----------
        largest : largest reading that is rounded.
        """
        both = [self._end(list(self._outwards(largest, side)), largest) for side in (-1, 1)]
        return [*both, self.x]

    def _outwards(self, largest: float, side: int) -> Iterator[float]:
        """Sizes to one side: over ripples in steps that start at one row and double, then over the optima beyond."""
        size = self._size(self.x)
        low, high = (float(bound[self.problem.parameters.index[0][self.place]]) for bound in self.problem.bounds)
        rows = sum(len(run) for run in self.problem.runs)
        numbers = EVERY_SIZE[0]
        steps = largest / size if size > 0 else float(numbers[-1])
        share = 1.0 / (steps * rows)
        while size > 0 and share < 1.0 / steps:
            yield float(np.clip(size * (1.0 + side * share), low, high))
            share *= 2.0
        further = steps - side * (1.0 + (numbers - numbers[0]))
        for number in further[(further >= numbers[0]) & (further <= numbers[-1])]:
            if low < largest / number < high:
                yield largest / float(number)

    def _end(self, sizes: Sequence[float], largest: float) -> Array:
        """(unknowns,) at the outermost possible size; the search ends after a step's width without a possible one."""
        last, after = self.x, np.nan
        for size in sizes:
            if self._size(last) > 0 and abs(largest / size - largest / self._size(last)) > 1.0 and np.isfinite(after):
                break
            x = self.at(size, self.allowed)
            last, after = (x, np.nan) if x is not None else (last, size if np.isnan(after) else after)
        for _ in range(BETWEEN if np.isfinite(after) else 0):
            middle = 0.5 * (self._size(last) + after)
            x = self.at(middle, self.allowed)
            last, after = (x, after) if x is not None else (last, middle)
        return last

    def at(self, size: float, allowed: float) -> Array | None:
        """(unknowns,) with a size, the others optimal; None if the objective is higher by more than `allowed`."""
        self.tried += 1
        self.say(f"{self.name}: interval of the size, {self.tried} tried, {size:.6g}", passing=True)
        x = _with_size(self.problem, self.x, self.place, size)
        objective = _objective(self.problem, x)
        if objective - self.least > allowed:
            solution = gauss_newton(
                self.held, x, max_steps=STEPS_OF_OTHERS, negligible=0.0, search="levenberg_marquardt"
            )
            if solution.status is Status.INTERRUPTED:
                raise KeyboardInterrupt
            x, objective = solution.x, solution.objective
        self.least = min(self.least, objective)
        return x if objective - self.least <= allowed else None

    def _size(self, x: Array) -> float:
        return float(self.problem.shared(x)[self.place])


def _with_size(problem: MotionProblem, x: Array, place: int, size: float) -> Array:
    result = x.copy()
    for index in problem.parameters.index:
        result[index[place]] = size
    return result


def _largest(problem: MotionProblem, recordings: Sequence[Recording], name: str) -> float:
    """Largest of the readings that a size rounds."""
    signal = problem.model.rounded[name]
    return max(float(np.nanmax(np.abs(recording[signal]))) for recording in recordings)


def _objective(problem: MotionProblem, x: Array) -> float:
    value = problem.objective(x, problem.simulated_nodes(x))
    return value if np.isfinite(value) else np.inf
