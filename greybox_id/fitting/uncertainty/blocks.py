"""Residuals of a fit in blocks longer than they stay correlated, and what each block says about the unknowns.

How long that is, the residuals say themselves. Unknowns that only a short piece of the recording tells, like the
starts of short predictions, are nobody's interest but many: they are eliminated piece by piece, which changes nothing
about the others (Frisch, Waugh & Lovell), nor about their corrections where a piece lies within one block (Pustejovsky
& Tipton, Small-sample methods for cluster-robust variance estimation, J. Business & Economic Statistics 36 (2018)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from ...base.shorthands import Array, Mask
from ...base.statistics import correlation_time
from ...engine.least_squares import LeastSquares, Matched
from ...engine.motion.shooting import MotionProblem

LONGER = 10
"""A block is this many correlation times long: its sum misses a twentieth of the variance then."""
FEWEST, MOST = 8, 40
"""Blocks: with fewer their scatter is no estimate, with more the intervals hardly narrow."""
LOCAL = 1 / 16
"""An unknown that a single piece with less than this share of all rows tells is local."""


@dataclass(frozen=True)
class Blocks:
    """What blocks of rows say about the kept unknowns, the local ones eliminated.

    Attributes
    ----------
    kept : (unknowns,) those that are not local.
    H : (blocks, kept, kept) J'J of each.
    scores : (blocks, kept) J'r of each.
    prior : (kept, kept) R'R.
    pull : (local, kept) how much a local unknown gives way when a kept one moves.
    local, local_independent : (local, local) covariance of local unknowns while kept ones stay; and what it were if
        residuals were independent, of standard deviation one.
    local_dof : (local,) of freedom.
    rows : per block.
    correlation : integrated autocorrelation time of the residuals, rows.
    variance : of one residual, mirror images counted as one with their runs.
    """

    kept: Mask
    H: Array
    scores: Array
    prior: Array
    pull: Array
    local: Array
    local_independent: Array
    local_dof: Array
    rows: float
    correlation: float
    variance: float

    @property
    def missed(self) -> float:
        """Share of variance that sums over blocks miss, because neighbours share it, if correlation fades evenly."""
        return min(0.5, (self.correlation - 1.0 / self.correlation) / (2.0 * self.rows))

    @property
    def lone_variance(self) -> float:
        """Variance that a residual counts as in a sum, where scatter between blocks cannot say it."""
        return self.variance * self.correlation

    def over_all(self, of_kept: Array, of_local: Array) -> Array:
        """A covariance (unknowns, unknowns) from that of the kept ones and that of the local ones alone."""
        full = np.empty((len(self.kept), len(self.kept)))
        kept, local = np.flatnonzero(self.kept), np.flatnonzero(~self.kept)
        full[np.ix_(kept, kept)] = of_kept
        full[np.ix_(local, kept)] = -self.pull @ of_kept
        full[np.ix_(kept, local)] = full[np.ix_(local, kept)].T
        full[np.ix_(local, local)] = of_local + self.pull @ of_kept @ self.pull.T
        return full


def blocks(problem: LeastSquares, x: Array, nodes: Matched, keep: Mask) -> Blocks:
    """Sum over blocks, of equal length and over all rows end to end.

    A block is ten correlation times long, but at least a fortieth and at most an eighth of all rows; the least is less
    if an unknown is told by a few runs only, which then have eight blocks too.

    Parameters
    ----------
    problem : the problem. It is linearised twice: how long blocks are to be is known only after the first time.
    x : (unknowns,) an optimum of it.
    nodes : the problem's simulation there.
    keep : (unknowns,) what is not to be taken as local.
    """
    plan = _plan(problem, x, nodes, keep)
    local, kept, P = plan.local, ~plan.local, sp.csr_matrix(problem.R.T @ problem.R)
    place = np.where(local, np.cumsum(local), np.cumsum(kept)) - 1  # among the local ones, among the kept ones
    count, size, few = len(plan.edges) - 1, int(np.sum(kept)), int(np.sum(local))
    H, scores = np.zeros((count, size, size)), np.zeros((count, size))
    pull, alone, independent, dof = np.zeros((few, size)), np.zeros((few, few)), np.zeros((few, few)), np.ones(few)
    for k, start, residuals, J in _parts(problem, x, nodes):
        of = problem.layout.index[k]
        by_kept, by_local, theirs = J[:, :, kept[of]], J[:, :, local[of]], of[local[of]]
        if len(theirs):
            flat, value, everything = by_local.reshape(-1, len(theirs)), place[theirs], place[of[kept[of]]]
            prior, informed = P[theirs].toarray(), flat.T @ flat
            believed, coupling = prior[:, theirs], prior[:, kept]
            coupling[:, everything] += flat.T @ by_kept.reshape(len(flat), -1)
            inverse = la.pinvh(informed + believed)
            pull[value], independent[np.ix_(value, value)] = inverse @ coupling, inverse
            alone[np.ix_(value, value)] = inverse @ (plan.variance * plan.correlation * informed + believed) @ inverse
            dof[value] = max(1.0, len(residuals) / plan.correlation)
            by_kept = by_kept - by_local @ pull[value][:, everything]
        cuts = np.clip(plan.edges - plan.first[k % problem.copies] - start, 0, len(residuals))
        among = place[of[kept[of]]]
        for g in np.flatnonzero(np.diff(cuts)):
            rows = slice(cuts[g], cuts[g + 1])
            flat = by_kept[rows].reshape(-1, len(among))
            H[g][np.ix_(among, among)] += flat.T @ flat
            scores[g, among] += flat.T @ residuals[rows].ravel()
    whole = np.zeros((len(kept), size))  # what all unknowns do when a kept one moves
    whole[kept], whole[local] = np.eye(size), -pull
    return Blocks(
        kept, H, scores, whole.T @ (P @ whole), pull, alone, independent, dof,
        float(plan.first[-1]) / count, plan.correlation, plan.variance,
    )  # fmt: skip


@dataclass(frozen=True)
class _Plan:
    """What is local, and where blocks are cut: (blocks + 1,) edges and (pieces + 1,) beginnings of pieces, in rows."""

    local: Mask
    edges: NDArray[np.intp]
    first: NDArray[np.intp]
    correlation: float
    variance: float


def _plan(problem: LeastSquares, x: Array, nodes: Matched, keep: Mask) -> _Plan:
    size, index = problem.layout.size, problem.layout.index
    curvature, telling, pieces = (problem.R.T @ problem.R).diagonal(), np.zeros(size), np.zeros(size)
    series: list[list[tuple[int, Array]]] = [[] for _ in range(problem.copies)]
    squares, seen, in_parts = 0.0, set[int](), np.zeros(size, dtype=bool)
    for k, start, residuals, J in _parts(problem, x, nodes):
        curvature[index[k]] += np.einsum("rop,rop->p", J, J)
        squares += float(np.sum(residuals**2))
        pieces[index[k]] += k not in seen
        in_parts[index[k]] |= k in seen
        seen.add(k)
        if k < problem.copies:
            series[k].append((start, residuals))
    lengths = np.array([max(start + len(item) for start, item in parts) for parts in series])
    for k in range(problem.copies):
        telling[index[k]] += lengths[k]
    first = np.concatenate([[0], np.cumsum(lengths)])
    together = np.zeros((int(first[-1]), series[0][0][1].shape[1]))
    for k, parts in enumerate(series):
        for start, item in parts:  # a row in two parts is zero in one of them
            together[first[k] + start : first[k] + start + len(item)] += item
    total, correlation = len(together), correlation_time(together)
    local = (pieces == 1) & ~in_parts & (telling < LOCAL * total) & (curvature > 0.0) & problem.free & ~keep
    short = np.array([np.any(local[index[k]]) for k in range(problem.copies)])
    fewest = float(np.min(telling[problem.free & ~local & (telling > 0.0)], initial=total))
    longest = float(np.max(lengths[short], initial=1))
    least = max(LONGER * correlation, min(total / MOST, fewest / FEWEST), longest)
    count = max(1, round(total / max(1.0, min(least, total / FEWEST))))
    edges = np.round(total * np.arange(count + 1) / count).astype(np.intp)
    piece = np.clip(np.searchsorted(first, edges, "right") - 1, 0, len(lengths) - 1)
    begin, end = first[piece], first[piece + 1]
    edges = np.unique(np.where(short[piece], np.where(edges - begin < end - edges, begin, end), edges))
    return _Plan(local, edges, first, correlation, squares / max(1, int(np.count_nonzero(together))))


def _parts(problem: LeastSquares, x: Array, nodes: Matched) -> Iterator[tuple[int, int, Array, Array]]:
    """Piece, row in it, residuals and derivatives; long pieces part by part where a problem offers that."""
    if isinstance(problem, MotionProblem):
        yield from problem.parts(x, nodes)
    else:
        yield from ((k, 0, residuals, J) for k, (residuals, J) in enumerate(problem.residuals(x, nodes)))
