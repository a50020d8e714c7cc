"""Sizes of effects that act in steps: a search is led to the best of many optima, not to the nearest one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..engine.motion.shooting import MotionProblem
from ..models.parameter import free_places

STEPPED = {"sensor_quantisation": "steer"}
"""Effect -> signal that it rounds to multiples of its magnitude. With another one steps are elsewhere, so that the
objective has an optimum wherever the largest reading is a whole number of them, with ripples of single rows on top."""
EVERY_SIZE = np.arange(1.0, 200.0, 0.25), False
"""Steps between none and the largest reading that are tried: searches from within a third of a step end right, and
finer steps than half a per cent of the signal are not looked for."""
NEAR_SIZES = np.linspace(-0.5, 0.5, 101), True
"""The same, beside those of the present size."""


def at_best_sizes(
    problem: MotionProblem, recordings: Sequence[Recording], x: Array, tried: tuple[Array, bool]
) -> Array:
    """(unknowns,) with free magnitudes of such effects where the objective is least, all else as it is.

    Parameters
    ----------
    tried : numbers of steps up to the largest reading, and whether these are beside the present one.
    """
    places = {name: place for name, place in free_places(problem.model.parameters).items() if name in STEPPED}
    best, least = x, _objective(problem, x) if places else np.inf
    for name, place in places.items():
        largest = max(float(np.max(np.abs(recording[STEPPED[name]]))) for recording in recordings)
        low, high = problem.model[name].bounds
        numbers, beside = tried
        for steps in numbers + largest / problem.shared(x)[place] if beside else numbers:
            if steps > 0 and low < (size := largest / steps) < high:
                other = x.copy()
                for index in problem.parameters.index:
                    other[index[place]] = size
                if (value := _objective(problem, other)) < least:
                    best, least = other, value
        x = best
    return best


def _objective(problem: MotionProblem, x: Array) -> float:
    value = problem.objective(x, problem.simulated_nodes(x))
    return value if np.isfinite(value) else np.inf
