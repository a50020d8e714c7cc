"""A bench on which one parameter has a value of its own in some of the rows: an effect that begins there, or ends.

Runs are cut where the rows begin and end, and the pieces are simulated one behind the other, each from where the one
before it ended: the change is at that instant, and no equation is another one. Parameter vectors have one more number
at their end, the value in those rows; where it is not a number, nothing differs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..engine.motion.lanes import Interval, Lanes, cut_rows, lay
from ..engine.motion.schedule import Schedule
from ..shorthands import Array, Index
from .bench import Bench, Simulated
from .calibration import CAL


@dataclass(frozen=True)
class Piece:
    """An unbroken piece of a run.

    Attributes
    ----------
    interval : its rows.
    inside : whether the parameter has its own value there.
    stage : how many pieces of its run are before it.
    """

    interval: Interval
    inside: bool
    stage: int


class PartBench(Bench):
    """See the module.

    Parameters
    ----------
    whole : the bench, which is left as it is.
    index : of the parameter, which moves no instant.
    rows : in which it has a value of its own, of all N.
    """

    def __init__(self, whole: Bench, index: int, rows: slice) -> None:
        vars(self).update(vars(whole))
        self.whole, self.index, self.part = whole, index, rows
        self.pieces = [piece for k, run in enumerate(self.rows) for piece in _pieces(k, run, rows)]
        self._first = np.array([piece.stage == 0 for piece in self.pieces])
        self._inside = np.array([piece.inside for piece in self.pieces])
        self._simulated: dict[bytes, Simulated] = {}
        self._laid: dict[tuple[tuple[float, ...], ...], Lanes] = {}

    def simulate_anew(self, P: Array) -> list[Simulated]:
        """Simulations with each vector, whatever is remembered."""
        size, pieces = self.model.size, len(self.pieces)
        shifts = [tuple(self.simulator.shifts(p[:size])) for p in P]
        starts, found = self._starts(P)[0], list[Simulated]()
        per_call = max(1, CAL.lanes // len(self.runs))
        for first in range(0, len(P), per_call):
            own = range(first, min(first + per_call, len(P)))
            plans = [plan for k in own for plan in self._scheduled(shifts[k])]
            lanes = self._lanes_of_pieces(tuple(shifts[k] for k in own), plans)
            p = np.concatenate([self._of_pieces(P[k]) for k in own])
            z0 = np.zeros((len(p), starts.shape[2]))
            z0[np.tile(self._first, len(own))] = starts[first : first + len(own)].reshape(-1, starts.shape[2])
            z, y = self._staged(z0, lanes, p, plans)
            read = lanes.gathered(y).reshape(len(own), *self.measured.shape)
            for at in range(len(own)):
                cuts = []
                for k, piece in enumerate(self.pieces):
                    plan, rows = plans[at * len(self.runs) + piece.interval.run], piece.interval
                    segments = plan.row_segment[cut_rows(plan, rows.start, rows.stop, self._cuts)]
                    cuts.append(z[at * pieces + k, segments - plan.row_segment[rows.start]])
                found.append(Simulated(read[at].copy(), np.concatenate(cuts)))
        return found

    def along(self, p: Array) -> Array:
        """See `Bench`."""
        plans, by_piece = self._scheduled(tuple(self.simulator.shifts(p[: self.model.size]))), self._of_pieces(p)
        return np.repeat(by_piece, [_segments(plans[own.interval.run], own.interval) for own in self.pieces], axis=0)

    def trajectory(self, p: Array) -> list[tuple[Schedule, Array]]:
        """See `Bench`."""
        shifts = tuple(self.simulator.shifts(p[: self.model.size]))
        plans, starts = self._scheduled(shifts), self._starts(p[None])[0][0]
        z0 = np.zeros((len(self.pieces), starts.shape[1]))
        z0[self._first] = starts
        z, _ = self._staged(z0, self._lanes_of_pieces((shifts,), plans), self._of_pieces(p), plans)
        found: list[list[Array]] = [[] for _ in self.runs]
        for k, piece in enumerate(self.pieces):
            own = piece.interval
            found[own.run].append(z[k, : _segments(plans[own.run], own)])
        return [(plan, np.concatenate(own)) for plan, own in zip(plans, found, strict=True)]

    def _staged(self, z0: Array, lanes: Lanes, p: Array, plans: Sequence[Schedule]) -> tuple[Array, Array]:
        """States at all segments and readings of all pieces, those of a run one after the other; z0 is filled in."""
        kernel, count = self.simulator.kernel, len(z0) // len(self.pieces)
        pieces = [(at * len(self.runs), piece) for at in range(count) for piece in self.pieces]
        stage = np.array([piece.stage for _, piece in pieces])
        length = np.array([_segments(plans[at + own.interval.run], own.interval) for at, own in pieces])
        z = np.zeros((len(z0), lanes.segments.shape[1] + 1, z0.shape[1]))
        y = np.zeros((len(z0), int(np.sum(lanes.reads)), self.measured.shape[1]))
        for now in range(int(np.max(stage)) + 1):
            own = np.flatnonzero(stage == now)
            most = int(np.max(length[own]))
            reads = lanes.reads[:most]
            with np.errstate(all="ignore"):
                states, readings = kernel.simulate(z0[own], lanes.segments[own, :most], p[own], reads)
            z[own, : most + 1], y[own, : readings.shape[1]] = states, readings
            followed = own[np.append(stage, 0)[own + 1] == now + 1]
            z0[followed + 1] = z[followed, most]
        return z, y

    def _lanes_of_pieces(self, shifts: tuple[tuple[float, ...], ...], plans: Sequence[Schedule]) -> Lanes:
        if shifts not in self._laid:
            count = len(self.runs)
            intervals = [
                replace(piece.interval, run=k * count + piece.interval.run)
                for k in range(len(shifts))
                for piece in self.pieces
            ]
            while len(self._laid) > CAL.lanes:
                del self._laid[next(iter(self._laid))]
            self._laid[shifts] = lay(plans, intervals)
        return self._laid[shifts]

    def _lanes_in(self, plans: Sequence[Schedule], p: Array) -> tuple[Lanes, Array, Sequence[tuple[Index, int]]]:
        cut = lay(plans, [piece.interval for piece in self.pieces], self._cuts)
        held = np.flatnonzero(self._inside[cut.interval]) if self._differs(p) else np.empty(0, dtype=np.intp)
        first = cut.first & self._first[cut.interval]
        return replace(cut, first=first), self._of_pieces(p)[cut.interval], [(held, self.index)]

    def _at_starts(self, P: Array) -> Sequence[Array]:
        by_piece = np.stack([self._of_pieces(p) for p in P], axis=1)
        return list(by_piece[self._first])

    def _differs(self, p: Array) -> bool:
        return len(p) > self.model.size and bool(np.isfinite(p[self.model.size]))

    def _of_pieces(self, p: Array) -> Array:
        """(pieces, parameters) in force in each."""
        size = self.model.size
        found = np.tile(p[:size], (len(self.pieces), 1))
        if self._differs(p):
            found[self._inside, self.index] = p[size]
        return found


def _pieces(run: int, own: slice, part: slice) -> list[Piece]:
    """A run, cut where the part begins and ends."""
    rows = own.stop - own.start
    edges = [0, *sorted({cut - own.start for cut in (part.start, part.stop) if 0 < cut - own.start < rows}), rows]
    return [
        Piece(Interval(run, a, b), part.start <= own.start + a < part.stop, stage)
        for stage, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True))
    ]


def _segments(plan: Schedule, rows: Interval) -> int:
    """How many there are in some rows of a run."""
    last = plan.row_segment[rows.stop] if rows.stop < len(plan.row_segment) else len(plan.segments)
    return int(last - plan.row_segment[rows.start])
