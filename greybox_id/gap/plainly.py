"""What a map with memory gains from an effect: it must show in plain errors, not only in whitened ones.

Training minimises plain errors, and leaves coloured ones. Whitening looks at what is fast in them, at which training
never looked: there an effect seems to explain what other weights would explain as well, even on a recording like those
of the training, and plain errors grow with it. An effect gains what it gains in both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..estimation.colour import Colour
from ..estimation.hypothesis import Hypothesis
from ..shorthands import Array
from .selection import Selection


def plainly(selection: Selection, sd: Array, good: NDArray[np.bool_]) -> Selection:
    """The selection with hypotheses that cost as much as plain errors say, where that is more.

    Parameters
    ----------
    selection : hypotheses refitted on whitened residuals.
    sd : (channels,) of what training left.
    good : (N, channels) readings that count.
    """
    colour = selection.search.colour
    assert isinstance(colour, Colour)  # maps with memory know no forces
    weight = 0.5 / (sd**2 * _lasting(colour))
    base = selection.base

    def cost(own: Hypothesis) -> float:
        gain = float(np.sum(np.where(good, base.e**2 - own.e**2, 0.0) @ weight))
        return max(own.cost, base.cost - selection.search.trust * gain)

    tried = sorted((replace(own, cost=cost(own)) for own in selection.tried), key=lambda own: own.cost)
    return replace(selection, tried=tuple(tried))


def _lasting(colour: Colour) -> Array:
    """(channels,) how many rows tell as much as one would if residuals did not carry on from row to row."""
    slow = np.array([s / max(abs(1.0 - float(np.sum(a))), 1e-3) for s, a in zip(colour.sd, colour.ar, strict=True)])
    return np.asarray(np.maximum((slow / colour.stationary_sd) ** 2, 1.0))
