"""What is uncertain of a model besides what walks in it: each such number is moved by its standard deviation, the
filter is run again, and what the estimates owe to it joins their bands. The filter itself takes the model as certain.
"""

from __future__ import annotations

import numpy as np

from ..parameter import Array
from .state_space import StateSpace


def believed(space: StateSpace, size: int) -> Array:
    """(k, size) one standard deviation of every free parameter with a prior, as moves of p; what walks left out."""
    moves = []
    tracked = {own.name for own in space.tracked}
    for own in space.model.parameters:
        if own.shape != () or own.prior is None or own.fixed or own.name in tracked:
            continue
        sd, value, (low, high) = float(np.asarray(own.prior.sd)), float(own.array), own.bounds
        step = sd if value + sd <= high else -sd
        if 0 < sd < np.inf and low <= value + step <= high:
            move = np.zeros(size)
            move[space.place(own.name)] = step
            moves.append(move)
    return np.array(moves).reshape(len(moves), size)


def padded(space: StateSpace, uncertain: Array, size: int) -> Array:
    """Moves of the model's parameters as moves of p; what walks is left out."""
    found = np.zeros((len(uncertain), size))
    found[:, : uncertain.shape[1]] = uncertain
    found[:, [space.place(own.name) for own in space.tracked]] = 0.0
    return found
