"""Sizes of effects that round: a search is led to the best of many optima, and their interval counts all of them.

With another size the steps are elsewhere, so that the objective has an optimum wherever the largest reading is a whole
number of them, with ripples of single rows on top. Curvature describes the ripple that a search ended in, not how far
sizes may be off. So the objective is followed outwards over ripples, and over optima beside the best one, while all
else does its best; what a size may be is what explains the readings as well as the best one, but for chance.

How much chance is, is known of thresholds: a size moves the thresholds between steps, rows cross them one by one, and
the log-likelihood about the truth is a random walk to both sides, not a parabola. Twice its rise is below z with the
probability (1 - exp(-z / 2))^2. Source: Hansen, Sample splitting and threshold estimation, Econometrica 68 (2000),
theorem 2 and table 1. Of the many sizes that are tried, the best gains something where nothing is rounded, too: none is
possible unless it gains more than the best of so many does by chance (chi-squared, after Bonferroni).
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
"""Steps between none and the largest reading that are tried: searches from within a third of a step end right, and
finer steps than half a per cent of the signal are not looked for."""
NEAR_SIZES = np.linspace(-0.5, 0.5, 101), True
"""The same, beside those of the present size."""
CONFIDENCE = 0.95
RISE = -2.0 * float(np.log(1.0 - np.sqrt(CONFIDENCE)))
"""Twice the rise of the objective within which sizes are held for possible."""
BY_CHANCE = float(chdtri(1, (1.0 - CONFIDENCE) / len(EVERY_SIZE[0])))
"""Twice the gain that the best of all sizes has over none by chance, in as many fits as the confidence says."""
STEPS_OF_OTHERS = 5
"""Steps of the search that has all else follow a size that is held."""
BETWEEN = 4
"""How often the stretch between the last possible size and the next one is halved."""


def at_best_sizes(
    problem: MotionProblem, recordings: Sequence[Recording], x: Array, tried: tuple[Array, bool], say: Say = quiet
) -> Array:
    """(unknowns,) with free magnitudes of effects that round where the objective is least, all else as it is.

    Parameters
    ----------
    tried : numbers of steps up to the largest reading, and whether these are beside the present one.
    """
    places = rounding(problem)
    best, least = x, _objective(problem, x) if places else np.inf
    for name, place in places.items():
        largest = _largest(problem, recordings, name)
        low, high = problem.model[name].bounds
        numbers, beside = tried
        for k, steps in enumerate(numbers + largest / problem.shared(x)[place] if beside else numbers):
            if steps > 0 and low < (size := largest / steps) < high:
                other = _with_size(problem, x, place, size)
                if (value := _objective(problem, other)) < least:
                    best, least = other, value
                say(f"{problem.model.name}: size {k + 1} of {len(numbers)}, {name}={size:.6g}", passing=True)
        x = best
    return best


def error_of_sizes(
    problem: MotionProblem, recordings: Sequence[Recording], x: Array, known: Uncertainty, say: Say = quiet
) -> Array:
    """(unknowns, unknowns) what the many optima of sizes add to the covariance of the unknowns, all else following.

    Parameters
    ----------
    x : (unknowns,) an optimum.
    known : what its curvature says.
    """
    result = np.zeros((problem.layout.size, problem.layout.size))
    for name, place in rounding(problem).items():
        index = int(problem.parameters.index[0][place])
        inflation, quantile = float(known.inflation[index]), float(known.quantile(CONFIDENCE)[index])
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
    """Free magnitudes of effects that round an input, and their places among the parameters."""
    return {k: v for k, v in free_places(problem.model.parameters).items() if k in problem.model.rounded}


class _Possible:
    """The sizes that explain the readings as well as an optimum, (unknowns,) x, but for chance."""

    def __init__(self, problem: MotionProblem, x: Array, place: int, allowed: float, say: Say) -> None:
        self.problem, self.x, self.place, self.allowed, self.say = problem, x, place, allowed, say
        self.name = problem.model.name
        self.held = copy(problem)
        self.held.free = problem.free.copy()
        self.held.free[[index[place] for index in problem.parameters.index]] = False
        self.least, self.tried = _objective(problem, x), 0

    def ends(self, largest: float) -> list[Array]:
        """(unknowns,) at the smallest and the largest such size.

        Parameters
        ----------
        largest : reading that is rounded.
        """
        both = [self._end(list(self._outwards(largest, side)), largest) for side in (-1, 1)]
        return [*both, self.x]

    def _outwards(self, largest: float, side: int) -> Iterator[float]:
        """Sizes to one side: over ripples, as few rows as one and then twice as many, then over optima beside this."""
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
        """(unknowns,) at the outermost possible size; a stretch of one step without any ends the search."""
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
        """(unknowns,) with a size, all else at its best; None where the objective is higher by more than allowed."""
        self.tried += 1
        self.say(f"{self.name}: interval of the size, {self.tried} tried, {size:.6g}", passing=True)
        x = _with_size(self.problem, self.x, self.place, size)
        value = _objective(self.problem, x)
        if value - self.least > allowed:
            solution = gauss_newton(
                self.held, x, max_steps=STEPS_OF_OTHERS, negligible=0.0, search="levenberg_marquardt"
            )
            if solution.status is Status.INTERRUPTED:
                raise KeyboardInterrupt
            x, value = solution.x, solution.objective
        self.least = min(self.least, value)
        return x if value - self.least <= allowed else None

    def _size(self, x: Array) -> float:
        return float(self.problem.shared(x)[self.place])


def _with_size(problem: MotionProblem, x: Array, place: int, size: float) -> Array:
    result = x.copy()
    for index in problem.parameters.index:
        result[index[place]] = size
    return result


def _largest(problem: MotionProblem, recordings: Sequence[Recording], name: str) -> float:
    """Of the readings that a magnitude rounds."""
    signal = problem.model.rounded[name]
    return max(float(np.nanmax(np.abs(recording[signal]))) for recording in recordings)


def _objective(problem: MotionProblem, x: Array) -> float:
    value = problem.objective(x, problem.simulated_nodes(x))
    return value if np.isfinite(value) else np.inf
