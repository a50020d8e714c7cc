"""How residuals are made independent: by unknown forces where a model has them, else by the colour that is left."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..engine.simulation import FreeRuns
from ..shorthands import Array
from .bench import Bench
from .hypothesis import Hypothesis
from .model_error import Amplitudes, Believed, ForceSizes, estimated, linearised, model_error
from .noise import Whitener, colour, white_noise
from .search import Search
from .unknown_forces import knows_unknown_forces


def whitener(
    bench: FreeRuns, good: NDArray[np.bool_], prior: Believed, sd: Array
) -> Callable[[Search, Hypothesis | None], Whitener]:
    """How residuals are whitened: by unknown forces where the model has them, else by the colour that is left."""
    if not isinstance(bench, Bench) or not knows_unknown_forces(bench.model):
        return lambda search, own: white_noise(sd, good, bench.rows) if own is None else colour(own.e, good, bench.rows)
    sizes = ForceSizes(bench)

    def whiten(search: Search, own: Hypothesis | None) -> Whitener:
        if own is None:
            p = search.moved(np.array([axis.mean for axis in search.moving]))
            return model_error(linearised(bench, p, sd, sizes), prior.median, good)
        assert isinstance(search.bench, Bench)  # not always the same one: an effect may act in part of the rows
        about = linearised(search.bench, search.vector(own), sd, sizes)
        return model_error(about, estimated(about, own.e, good, prior), good)

    return whiten


def amplitudes_left(
    bench: FreeRuns, search: Search, best: Hypothesis, sd: Array, good: NDArray[np.bool_], prior: Believed
) -> Amplitudes | None:
    """Of the model error that is left beside a hypothesis."""
    if not isinstance(bench, Bench) or not knows_unknown_forces(bench.model):
        return None
    return estimated(linearised(bench, search.vector(best), sd, ForceSizes(bench)), best.e, good, prior)
