"""What the training data said about a model's weights, to be weighed against a new recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..engine.least_squares import NormalEquations
from ..engine.shooting import Nodes, Problem
from ..engine.trace import Trace
from ..memory_model import MemoryModel
from ..parameter import Array
from ..recording import Recording
from .subsets import FEW


def learnt(
    part: MemoryModel, noise: Mapping[str, float], sd: Mapping[str, Array], trained: Sequence[Recording] | None
) -> Array:
    """Precision of a part's parameters by its training data alone, (parameters, parameters), about its own values.

    The curvature of the training data's sum of squares. Without the data, what the fit's standard deviations say of
    each weight by itself. Of the few effects that stand for a change of
    the car, the old data say nothing.
    """
    few = np.concatenate([np.full(own.size, own.name in FEW) for own in part.parameters])
    if trained is None:
        spread = np.concatenate(
            [np.broadcast_to(sd.get(own.name, np.inf), own.shape).ravel() for own in part.parameters]
        ).astype(float)
        told = np.isfinite(spread) & (spread > 0) & ~few
        return np.diag(np.where(told, 1.0 / np.where(told, spread, 1.0) ** 2, 0.0))
    problem = Problem(Trace(part), trained, noise=np.array([noise[name] for name in part.outputs]))
    J = np.concatenate([own for _, own in problem.residuals(problem.start, [])]).reshape(-1, len(few))
    J[:, few] = 0.0
    return np.asarray(J.T @ J)


class Held(Problem):
    """A problem that is held to a point by what was learnt before, as a quadratic.

    Parameters
    ----------
    part, recording, noise : as of `Problem`.
    precision : (parameters, parameters) about the part's own values.
    """

    def __init__(self, part: MemoryModel, recording: Recording, noise: Array, precision: Array) -> None:
        super().__init__(Trace(part), [recording], noise=noise)
        self._precision, self._about = precision, part.values

    def objective(self, x: Array, nodes: Nodes) -> float:
        """Half the sum of squares, and what moving away from the point costs."""
        away = x - self._about
        return super().objective(x, nodes) + 0.5 * float(away @ self._precision @ away)

    def normal_equations(self, x: Array, nodes: Nodes) -> NormalEquations:
        """Those of the problem with the quadratic."""
        own = super().normal_equations(x, nodes)
        free = self.free.astype(float)
        precision = self._precision * np.outer(free, free)
        return NormalEquations(own.H + precision, own.g + precision @ (x - self._about))
