"""A bench on which one parameter has another value in some of the rows: an effect that begins or ends there.

Runs are cut where these rows begin and end, and the pieces are simulated one after the other, each from where the one
before it ended: the parameter changes at that instant, the equations do not. Parameter vectors have one more number at
their end, the value in those rows; where it is NaN, nothing differs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.shorthands import Array, Index
from ...engine.motion.lanes import Interval, Lanes, cut_rows, lay, segment_ends
from ...engine.motion.schedule import Schedule
from .bench import Bench, Integrated, Passage, Plans, Simulated


@dataclass(frozen=True)
class Piece:
    """An unbroken piece of a run.

    Attributes
    ----------
    interval : its rows.
    inside : whether the parameter has its other value there.
    stage : how many pieces of its run come before it.
    """

    interval: Interval
    inside: bool
    stage: int


class PartBench(Bench):
    """See the module.

    Parameters
    ----------
    whole : the bench, which is not changed.
    index : of the parameter, on which no delay or latency depends.
    rows : in which it has another value, of all N.
    """

    def __init__(self, whole: Bench, index: int, rows: slice) -> None:
        vars(self).update(vars(whole))
        self.whole, self.index, self.part = whole, index, rows
        self.pieces = [piece for k, run in enumerate(self.rows) for piece in _pieces(k, run, rows)]
        self._first = np.array([piece.stage == 0 for piece in self.pieces])
        self._inside = np.array([piece.inside for piece in self.pieces])
        self._simulated: dict[bytes, Simulated] = {}

    def _simulated_along(self, plans: Sequence[Plans], P: Array) -> list[Simulated]:
        """See `Bench`."""
        cuts = [[self._cut_within(plan, piece.interval) for piece in self.pieces] for plan in plans]
        return [
            self._simulated_by(plan, runs)
            for plan, runs in zip(plans, self._staged(plans, P, self._starts(P), cuts), strict=True)
        ]

    def _cut_within(self, plans: Plans, rows: Interval) -> Index:
        """Segments, counted from the first of a piece, at which the lanes of the piece begin that `linearise` cuts."""
        plan = plans.runs[rows.run]
        segments = plan.row_segment[cut_rows(plan, rows.start, rows.stop, plans.lanes[rows.run])]
        return np.asarray(segments - plan.row_segment[rows.start])

    def along(self, p: Array) -> Array:
        """See `Bench`."""
        plans = self._scheduled(tuple(self.simulator.shifts(p[: self.size])))
        return np.repeat(self._of_pieces(p), [stop - start for start, stop in self._ends(plans)], axis=0)

    def trajectory(self, p: Array) -> list[tuple[Schedule, Array]]:
        """See `Bench`."""
        plans = self._scheduled(tuple(self.simulator.shifts(p[: self.size])))
        every = [np.arange(stop - start) for start, stop in self._ends(plans)]
        (result,) = self._staged([plans], p[None], self._starts(p[None]), [every])
        return [(plan, item.cuts) for plan, item in zip(plans.runs, result, strict=True)]

    def _ends(self, plans: Plans) -> list[tuple[int, int]]:
        """First segment of each piece, and the one behind its last."""
        return [
            segment_ends(plans.runs[run], start, stop) for run, start, stop in (piece.interval for piece in self.pieces)
        ]

    def _staged(
        self, plans: Sequence[Plans], P: Array, starts: Array, cuts: Sequence[Sequence[Index]]
    ) -> list[list[Integrated]]:
        """Runs of simulations, their pieces integrated one after the other.

        Parameters
        ----------
        plans, P, starts : of each simulation, the last (K, runs, nz).
        cuts : of each simulation, by piece, segments at whose starts states are kept.
        """
        by_piece, segments = np.stack([self._of_pieces(p) for p in P]), [self._ends(each) for each in plans]
        result: list[list[list[Integrated]]] = [[[] for _ in self.runs] for _ in P]
        for stage in range(max(piece.stage for piece in self.pieces) + 1):
            now = [
                (k, at, piece) for k in range(len(P)) for at, piece in enumerate(self.pieces) if piece.stage == stage
            ]
            passages, z0 = [], []
            for k, at, item in now:
                run = item.interval.run
                passages.append(Passage(plans[k].runs[run], slice(*segments[k][at]), cuts[k][at]))
                z0.append(result[k][run][-1].end if stage else starts[k, run])
            p = np.array([by_piece[k, at] for k, at, _ in now])
            for (k, _, item), each in zip(now, self._integrated(passages, np.array(z0), p), strict=True):
                result[k][item.interval.run].append(each)
        return [[_joined(pieces) for pieces in runs] for runs in result]

    def _lanes_in(self, plans: Plans, p: Array) -> tuple[Lanes, Array, Sequence[tuple[Index, int]]]:
        intervals = [piece.interval for piece in self.pieces]
        cut = lay(plans.runs, intervals, [plans.lanes[interval.run] for interval in intervals])
        held = np.flatnonzero(self._inside[cut.interval]) if self._differs(p) else np.empty(0, dtype=np.intp)
        first = cut.first & self._first[cut.interval]
        return replace(cut, first=first), self._of_pieces(p)[cut.interval], [(held, self.index)]

    def _at_starts(self, P: Array) -> Sequence[Array]:
        by_piece = np.stack([self._of_pieces(p) for p in P], axis=1)
        return list(by_piece[self._first])

    def _differs(self, p: Array) -> bool:
        return len(p) > self.size and bool(np.isfinite(p[self.size]))

    def _of_pieces(self, p: Array) -> Array:
        """(pieces, parameters) in force in each."""
        size = self.size
        result = np.tile(p[:size], (len(self.pieces), 1))
        if self._differs(p):
            result[self._inside, self.index] = p[size]
        return result


def _pieces(run: int, value: slice, part: slice) -> list[Piece]:
    """A run, cut where the part begins and ends."""
    rows = value.stop - value.start
    edges = [0, *sorted({cut - value.start for cut in (part.start, part.stop) if 0 < cut - value.start < rows}), rows]
    return [
        Piece(Interval(run, a, b), part.start <= value.start + a < part.stop, stage)
        for stage, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True))
    ]


def _joined(pieces: Sequence[Integrated]) -> Integrated:
    """A run made of its integrated pieces."""
    cuts, y = (np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("cuts", "y"))
    return Integrated(cuts, pieces[-1].end, y)
