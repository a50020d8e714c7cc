"""Lanes of which one continues the other: their derivatives, and how to simulate them all at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...parameter import Array
from .lanes import Lanes
from .runs import Index

MOST_PASSES, CLOSED, WIDEST_GAP = 5, 1e-9, 0.3
"""Lanes are matched in so many passes at most, until no gap exceeds this share of a state's size; with gaps wider than
the last, one lane after the other is simulated instead."""


@dataclass(frozen=True)
class Chain:
    """A linearisation of all lanes.

    Attributes
    ----------
    x : (unknowns,) where it was made.
    index : (intervals, q) where the unknowns that move each interval stand among all.
    starts : (L, nz) states where lanes begin.
    by : (L, nz, q) their derivative by those unknowns.
    ends : (L, nz, nz) the derivative of states where lanes end by where they begin.
    """

    x: Array
    index: Index
    starts: Array
    by: Array
    ends: Array

    def foretold(self, x: Array, z0: Array, lanes: Lanes) -> Array:
        """States where lanes begin, (L, nz), to first order in the unknowns; intervals begin at z0."""
        moved = (x - self.x)[self.index]
        starts: Array = self.starts + np.einsum("lzq,lq->lz", self.by, moved[lanes.interval])
        starts[lanes.first] = z0
        return starts

    def matched(
        self, starts: Array, lanes: Lanes, simulate: Callable[[Array], tuple[Array, Array]]
    ) -> tuple[Array, Array] | None:
        """Simulate all lanes at once, and close the gaps between them by Newton's method.

        Parameters
        ----------
        starts : (L, nz) states to begin from.
        lanes : in the order in which they continue one another.
        simulate : starts -> states at all segments, readings.

        Returns
        -------
        States where lanes begin and readings; None where the gaps do not close.
        """
        scale = np.max(np.abs(starts), axis=0) + 1e-6
        for _ in range(MOST_PASSES):
            z, y = simulate(starts)
            gaps = np.where(lanes.first[:, None], 0.0, np.roll(z[:, -1], 1, axis=0) - starts)
            size = np.max(np.abs(gaps / scale))
            if not size < WIDEST_GAP:
                return None
            if size < CLOSED:
                return starts, y
            carried = np.zeros(starts.shape[1])
            for lane in np.flatnonzero(~lanes.first):
                carried = gaps[lane] + (0.0 if lanes.first[lane - 1] else self.ends[lane - 1] @ carried)
                starts[lane] += carried
        return None


def chained(lanes: Lanes, ends: Array, starts_by_p: Array, loose: Index) -> Array:
    """Derivative of every lane's beginning by the moving parameters and its interval's free starts, (L, nz, q).

    Parameters
    ----------
    lanes : in the order in which they continue one another.
    ends : (L, nz, nz + moving) derivative of their ends by their beginnings and by the parameters.
    starts_by_p : (intervals, nz, moving) derivative of where intervals start.
    loose : states that start freely.
    """
    size, moving = ends.shape[1], starts_by_p.shape[2]
    G = np.zeros((len(lanes.interval), size, moving + len(loose)))
    G[lanes.first, :, :moving] = starts_by_p
    G[:, loose, moving + np.arange(len(loose))] = lanes.first[:, None]
    for lane in np.flatnonzero(~lanes.first):
        G[lane] = ends[lane - 1, :, :size] @ G[lane - 1]
        G[lane, :, :moving] += ends[lane - 1, :, size:]
    return G
