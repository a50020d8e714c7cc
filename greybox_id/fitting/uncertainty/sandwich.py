"""Uncertainty of a fit's unknowns: a sandwich covariance, corrected for correlated residuals.

Neighbouring residuals are not independent: a car's unmodelled lag or bump lasts. The plain Gauss-Newton covariance
assumes independence and is then several times too small. Here the scores (gradients of single residuals) are summed
over blocks many times longer than the correlation, and the scatter of these sums sets the covariance. With few blocks,
the scatter around the fit is smaller than around the truth, and uncertain itself: each block's sum is corrected for its
leverage on the fit (CR2), and intervals are those of Student's t with the degrees of freedom that the blocks leave for
each unknown.

Sources: Bell & McCaffrey, Bias reduction in standard errors for linear regression with multi-stage samples, Survey
Methodology 28 (2002); Imbens & Kolesar, Robust standard errors in small samples, Review of Economics and Statistics 98
(2016); in the space of the unknowns: Niccodemi et al., Refining clustered standard errors with few clusters, University
of Groningen (2020).

The length of blocks follows from the residuals' correlation time. Unknowns that only a short piece of the recording
informs, such as initial states of short predictions, are many nuisance parameters: they are eliminated piece by piece,
which changes nothing about the others (Frisch, Waugh & Lovell), nor about their corrections if a piece lies within one
block (Pustejovsky & Tipton, Small-sample methods for cluster-robust variance estimation, J. Business & Economic
Statistics 36 (2018)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from ...base.shorthands import Array, Mask
from ...base.statistics import correlation_time
from ...engine.least_squares import LeastSquares, Matched
from ...engine.motion.shooting import MotionProblem

LONGER = 10
"""Length of a block in correlation times: its sum misses a twentieth of the variance then."""
FEWEST, MOST = 8, 40
"""Number of blocks: with fewer the scatter is no estimate, with more the intervals hardly narrow."""
LOCAL = 1 / 16
"""An unknown informed by a single piece with less than this share of all rows is local."""
AT_HAND = 4_000_000
"""Largest number of derivatives kept for the second pass, 32 MB; more are computed again."""


@dataclass(frozen=True)
class Blocks:
    """Scores and curvature of blocks of rows by the kept unknowns, the local ones eliminated.

    Attributes
    ----------
    kept : (unknowns,) mask of those that are not local.
    H : (blocks, kept, kept) J'J of each block; of all rows together, (1, kept, kept), if J is at hand.
    J : of each block of a network, its number, and the derivatives (rows, kept) of a part of it; else empty.
    scores : (blocks, kept) J'r of each block.
    prior : (kept, kept) R'R.
    pull : (local, kept) negative change of the optimal local unknowns per change of a kept one.
    local, local_independent : (local, local) covariance of local unknowns with kept ones fixed; and the same for
        independent residuals of standard deviation one.
    local_dof : (local,) their degrees of freedom.
    rows : rows per block.
    correlation : integrated autocorrelation time of the residuals, rows.
    variance : variance of one residual, mirror images counted together with their runs.
    """

    kept: Mask
    H: Array
    J: list[tuple[int, Array]]
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
        """Share of variance that sums over blocks miss at their edges, if the correlation decays exponentially."""
        return min(0.5, (self.correlation - 1.0 / self.correlation) / (2.0 * self.rows))

    @property
    def lone_variance(self) -> float:
        """Effective variance of a residual in a sum, where scatter between blocks gives no estimate."""
        return self.variance * self.correlation

    def scores_after(self, step: Array) -> Array:
        """Scores after a step of the kept unknowns, to first order."""
        if not self.J:
            return np.asarray(self.scores + self.H @ step)
        result = self.scores.copy()
        for block, J in self.J:
            result[block] += (J @ step) @ J
        return result

    def leverages(self, block: int, free: Mask, U: Array) -> tuple[Array, Array]:
        """Leverages of a block on the free unknowns and their directions, in coordinates in which H is the unit matrix.

        Directions on which it has none may be absent.
        """
        root = np.concatenate([np.empty((0, len(U))), *(J[:, free] @ U.T for g, J in self.J if g == block)])
        if not self.J or len(root) >= len(U):
            of_block = root.T @ root if self.J else U @ self.H[block][np.ix_(free, free)] @ U.T
            share, Q = np.linalg.eigh(of_block)
            return np.clip(share, 0.0, 1.0), Q
        share, V = np.linalg.eigh(root @ root.T)
        seen = share > NO_LEVERAGE * float(np.max(share, initial=NO_LEVERAGE))
        return np.clip(share[seen], 0.0, 1.0), (root.T @ V[:, seen]) / np.sqrt(share[seen])

    def over_all(self, of_kept: Array, of_local: Array) -> Array:
        """A covariance (unknowns, unknowns) from that of the kept ones and that of the local ones alone."""
        if np.all(self.kept):
            return of_kept
        full = np.empty((len(self.kept), len(self.kept)))
        kept, local = np.flatnonzero(self.kept), np.flatnonzero(~self.kept)
        full[np.ix_(kept, kept)] = of_kept
        full[np.ix_(local, kept)] = -self.pull @ of_kept
        full[np.ix_(kept, local)] = full[np.ix_(local, kept)].T
        full[np.ix_(local, local)] = of_local + self.pull @ of_kept @ self.pull.T
        return full


def blocks(problem: LeastSquares, x: Array, nodes: Matched, keep: Mask) -> Blocks:
    """Sum scores and curvature over blocks of equal length, which divide all rows end to end.

    A block is ten correlation times long, but at least a fortieth and at most an eighth of all rows; the lower limit is
    smaller if only a few runs inform an unknown, so that these have eight blocks, too.

    Parameters
    ----------
    problem : the problem. It is linearised twice: the length of blocks is known only after the first pass.
    x : (unknowns,) an optimum of it.
    nodes : the problem's simulation there.
    keep : (unknowns,) mask of unknowns that must not be local.
    """
    plan = _plan(problem, x, nodes, keep)
    local, kept, P = plan.local, ~plan.local, sp.csr_matrix(problem.R.T @ problem.R)
    place = np.where(local, np.cumsum(local), np.cumsum(kept)) - 1  # index among the local, or the kept unknowns
    count, size, few = len(plan.edges) - 1, int(np.sum(kept)), int(np.sum(local))
    numbers = sum(J.size for *_, J in plan.parts)  # of a network, J is smaller than J'J of every block
    at_hand = 0 < numbers < count * size**2 and all(len(of) == size for of in problem.layout.index)
    H, scores, of_blocks = np.zeros((1 if at_hand else count, size, size)), np.zeros((count, size)), []
    pull, dof = np.zeros((few, size)), np.ones(few)
    local_covariance, independent = np.zeros((few, few)), np.zeros((few, few))
    for k, start, residuals, J in plan.parts or _parts(problem, x, nodes):
        of = problem.layout.index[k]
        local_of_piece = of[local[of]]
        by_kept, by_local = (J[:, :, kept[of]], J[:, :, local[of]]) if len(local_of_piece) else (J, J[:, :, :0])
        if len(local_of_piece):
            flat, places_local, places_kept = (
                by_local.reshape(-1, len(local_of_piece)),
                place[local_of_piece],
                place[of[kept[of]]],
            )
            prior, informed = P[local_of_piece].toarray(), flat.T @ flat
            prior_block, coupling = prior[:, local_of_piece], prior[:, kept]
            coupling[:, places_kept] += flat.T @ by_kept.reshape(len(flat), -1)
            inverse = la.pinvh(informed + prior_block)
            pull[places_local], independent[np.ix_(places_local, places_local)] = inverse @ coupling, inverse
            local_covariance[np.ix_(places_local, places_local)] = (
                inverse @ (plan.variance * plan.correlation * informed + prior_block) @ inverse
            )
            dof[places_local] = max(1.0, len(residuals) / plan.correlation)
            by_kept = by_kept - by_local @ pull[places_local][:, places_kept]
        cuts = np.clip(plan.edges - plan.first[k % problem.copies] - start, 0, len(residuals))
        among = place[of[kept[of]]]
        if at_hand:
            H[0] += by_kept.reshape(-1, size).T @ by_kept.reshape(-1, size)
        for g in np.flatnonzero(np.diff(cuts)):
            rows = slice(cuts[g], cuts[g + 1])
            flat = by_kept[rows].reshape(-1, len(among))
            if at_hand:
                of_blocks.append((int(g), flat))
            elif len(among) == size:
                H[g] += flat.T @ flat
            else:
                H[g][np.ix_(among, among)] += flat.T @ flat
            scores[g, among] += flat.T @ residuals[rows].ravel()
    responses = np.zeros((len(kept), size))  # change of all unknowns with a kept one
    responses[kept], responses[local] = np.eye(size), -pull
    return Blocks(
        kept, H, of_blocks, scores, responses.T @ (P @ responses), pull, local_covariance, independent, dof,
        float(plan.first[-1]) / count, plan.correlation, plan.variance,
    )  # fmt: skip


_Part = tuple[int, int, Array, Array]
"""Piece, row in it, residuals (rows, outputs) and derivatives (rows, outputs, unknowns of the piece)."""


@dataclass(frozen=True)
class _Plan:
    """The local unknowns, and where blocks are cut: (blocks + 1,) edges and (pieces + 1,) starts of pieces, in rows.

    `parts` : the linearised parts; empty if they would fill the memory.
    """

    local: Mask
    edges: NDArray[np.intp]
    first: NDArray[np.intp]
    correlation: float
    variance: float
    parts: list[_Part]


def _plan(problem: LeastSquares, x: Array, nodes: Matched, keep: Mask) -> _Plan:
    size, index = problem.layout.size, problem.layout.index
    curvature, informing_rows, pieces = (problem.R.T @ problem.R).diagonal(), np.zeros(size), np.zeros(size)
    series: list[list[tuple[int, Array]]] = [[] for _ in range(problem.copies)]
    squares, seen, in_parts = 0.0, set[int](), np.zeros(size, dtype=bool)
    linearised: list[_Part] = []
    numbers = 0
    for k, start, residuals, J in _parts(problem, x, nodes):
        numbers += J.size
        if numbers <= AT_HAND:
            linearised.append((k, start, residuals, J))
        else:
            linearised.clear()
        curvature[index[k]] += np.einsum("rop,rop->p", J, J)
        squares += float(np.sum(residuals**2))
        pieces[index[k]] += k not in seen
        in_parts[index[k]] |= k in seen
        seen.add(k)
        if k < problem.copies:
            series[k].append((start, residuals))
    lengths = np.array([max(start + len(item) for start, item in parts) for parts in series])
    for k in range(problem.copies):
        informing_rows[index[k]] += lengths[k]
    first = np.concatenate([[0], np.cumsum(lengths)])
    residuals_in_order = np.zeros((int(first[-1]), series[0][0][1].shape[1]))
    for k, parts in enumerate(series):
        for start, item in parts:  # a row in two parts is zero in one of them
            residuals_in_order[first[k] + start : first[k] + start + len(item)] += item
    total, correlation = len(residuals_in_order), correlation_time(residuals_in_order)
    local = (pieces == 1) & ~in_parts & (informing_rows < LOCAL * total) & (curvature > 0.0) & problem.free & ~keep
    short = np.array([np.any(local[index[k]]) for k in range(problem.copies)])
    fewest = float(np.min(informing_rows[problem.free & ~local & (informing_rows > 0.0)], initial=total))
    longest = float(np.max(lengths[short], initial=1))
    least = max(LONGER * correlation, min(total / MOST, fewest / FEWEST), longest)
    count = max(1, round(total / max(1.0, min(least, total / FEWEST))))
    edges = np.round(total * np.arange(count + 1) / count).astype(np.intp)
    piece = np.clip(np.searchsorted(first, edges, "right") - 1, 0, len(lengths) - 1)
    begin, end = first[piece], first[piece + 1]
    edges = np.unique(np.where(short[piece], np.where(edges - begin < end - edges, begin, end), edges))
    return _Plan(
        local, edges, first, correlation, squares / max(1, int(np.count_nonzero(residuals_in_order))), linearised
    )


def _parts(problem: LeastSquares, x: Array, nodes: Matched) -> Iterator[_Part]:
    """Index of the piece, first row in it, residuals and derivatives; long pieces in parts, if the problem can."""
    if isinstance(problem, MotionProblem):
        yield from problem.parts(x, nodes)
    else:
        yield from ((k, 0, residuals, J) for k, (residuals, J) in enumerate(problem.residuals(x, nodes)))


MANY = 200
"""Number of unknowns above which they are a network's weights."""
NO_LEVERAGE = 1e-12
"""Share of a block's largest leverage at which rounding leaves no direction."""
PULL = 0.99
"""Leverage of a block on a direction up to which its scatter is corrected; beyond, it is no estimate."""
RIDGE = 1e-12
"""Prior precision relative to each unknown's own curvature: it decides only in exactly degenerate directions."""


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of a fit's unknowns.

    Attributes
    ----------
    covariance : (unknowns, unknowns); rows of fixed unknowns are zero. Unknowns at bounds may be off them, and the
        others with them. Unknowns without information from data or prior have infinite variance.
    independent : (unknowns, unknowns) the same for independent residuals of standard deviation one, and with unknowns
        at bounds fixed there.
    released, released_independent : both without bounds.
    dof : (unknowns,) degrees of freedom for Student's t; infinite if only a prior informs the unknown, near 1 if a
        single stretch of the recording does.
    inflation : (unknowns,) ratio of the variance to that for independent residuals of standard deviation one.
    centre : (unknowns,) the estimate; for an unknown at its bound, the estimate without the bound.
    sd : (unknowns,) standard deviation around the centre; for an unknown at its bound, as if it were free.
    at_bound : (unknowns,) whether the estimate is at its bound.
    bounds : lowest and highest values, (unknowns,) each.
    blocks : number of blocks over which scores were summed.
    block_rows : rows per block.
    correlation_rows : integrated autocorrelation time of the residuals, rows.
    """

    covariance: Array
    independent: Array
    released: Array
    released_independent: Array
    dof: Array
    inflation: Array
    centre: Array
    sd: Array
    at_bound: Mask
    bounds: tuple[Array, Array]
    blocks: int
    block_rows: float
    correlation_rows: float

    def quantile(self, confidence: float = 0.95) -> Array:
        """Half an interval's width in standard deviations, (unknowns,)."""
        upper, finite = 0.5 + 0.5 * confidence, np.isfinite(self.dof)
        return np.where(finite, stdtrit(np.where(finite, self.dof, 1.0), upper), ndtri(upper))

    def interval(self, confidence: float = 0.95, wider: float = 1.0) -> Array:
        """Lower and upper end of each unknown's interval, (unknowns, 2), clipped to the bounds.

        For an unknown at its bound, the interval begins there and extends as far as that of the optimum without bounds.

        Parameters
        ----------
        confidence : of the interval.
        wider : ratio of the stated standard deviation to the one here.
        """
        half, centre = self.quantile(confidence) * wider * self.sd, np.where(np.isfinite(self.sd), self.centre, 0.0)
        return np.clip(np.stack([centre - half, centre + half]), *self.bounds).T


def uncertainty(problem: LeastSquares, x: Array, nodes: Matched) -> Uncertainty:
    """Uncertainty of the unknowns around an optimum.

    With J the residuals' derivative and R the priors', both in standard deviations, H = J'J + R'R, the covariance is
    H^-1 (S + R'R) H^-1, S the sum over blocks of the outer product of corrected sums of scores J'r. A run and its
    mirror image have the same noise: their scores belong to one block. Recordings shorter than eighty correlation
    times of their residuals have eight blocks only: the degrees of freedom fall to seven and below, and the intervals
    widen by a fifth and more.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) an optimum of it.
    nodes : the problem's simulation there.
    """
    low, high = problem.bounds
    at_bound = problem.free & ((x <= low) | (x >= high))
    scores = blocks(problem, x, nodes, keep=at_bound)
    kept, H = np.flatnonzero(scores.kept), scores.prior + np.sum(scores.H, axis=0)
    informed = problem.free[kept] & (np.diag(H) > 0.0)
    stopped, uninformed = at_bound[kept] & informed, kept[problem.free[kept] & ~informed]
    within_bounds = _sandwich(scores, H, informed & ~stopped)
    of_kept, centre, dof, without_bounds = within_bounds.covariance, x.copy(), np.empty(len(x)), within_bounds
    dof[kept], dof[~scores.kept] = within_bounds.dof, scores.local_dof
    if np.any(stopped):
        gradient = problem.normal_equations(x, nodes).g
        beyond, step = _released(scores, H, informed, gradient[kept] - scores.pull.T @ gradient[~scores.kept])
        without_bounds, at_bounds = _sandwich(beyond, H, informed), kept[stopped]
        centre[at_bounds], dof[at_bounds] = x[at_bounds] + step[stopped], without_bounds.dof[stopped]
        outward = np.where(x[at_bounds] <= low[at_bounds], -1.0, 1.0) * step[stopped]
        free_to = without_bounds.covariance[np.ix_(stopped, stopped)]
        of_kept = of_kept + _off_bounds(H, informed, stopped, outward, (high - low)[at_bounds], free_to)
    covariance = scores.over_all(of_kept, scores.local)
    independent = scores.over_all(within_bounds.independent, scores.local_independent)
    released = scores.over_all(without_bounds.covariance, scores.local)
    released_independent = scores.over_all(without_bounds.independent, scores.local_independent)
    for each in (covariance, independent, released, released_independent):
        each[uninformed, uninformed] = np.inf
    variance, of_independent = np.diag(covariance).copy(), np.diag(independent).copy()
    if np.any(stopped):
        variance[at_bounds] = np.diag(without_bounds.covariance)[stopped]
        of_independent[at_bounds] = np.diag(without_bounds.independent)[stopped]
    comparable = np.isfinite(variance) & (of_independent > 0.0)
    inflation = np.divide(variance, of_independent, out=np.ones(len(x)), where=comparable)
    return Uncertainty(
        covariance, independent, released, released_independent, dof, inflation, centre,
        np.sqrt(np.maximum(variance, 0.0)), at_bound, problem.bounds, len(scores.scores), scores.rows,
        scores.correlation,
    )  # fmt: skip


def covariance(problem: LeastSquares, x: Array, nodes: Matched) -> Array:
    """Covariance of the unknowns around an optimum, (unknowns, unknowns); see `uncertainty`."""
    return uncertainty(problem, x, nodes).covariance


class _Sandwich(NamedTuple):
    """Parts of `Uncertainty`; covariances of the free unknowns alone, zero elsewhere."""

    covariance: Array
    independent: Array
    dof: Array


def _sandwich(blocks: Blocks, H: Array, free: Mask) -> _Sandwich:
    """CR2 and Satterthwaite's degrees of freedom for the free unknowns, in coordinates in which H is the unit matrix.

    There, block g has the leverage A_g on every direction, and its scores scatter around the fit like A_g - A_g^2:
    (I - A_g)^-1/2 makes them scatter like A_g. The variance of an unknown is then a quadratic form in independent
    residuals, with a matrix M between blocks, and has (tr M)^2 / tr M^2 degrees of freedom; the prior's contribution to
    the variance is known and has infinitely many (Welch). In directions informed by (nearly) one block alone, the
    residuals' variance times their correlation time replaces the scatter.
    """
    result = _Sandwich(np.zeros_like(H), np.zeros_like(H), np.full(len(H), np.inf))
    size, among = int(np.sum(free)), np.ix_(free, free)
    if size == 0:
        return result
    unit, C = _factor(H[among])
    U = la.solve_triangular(C, np.diag(unit), lower=True)
    if size > MANY:
        return _uncorrected(blocks, H, free, U)
    middle = np.zeros((size, size))
    diagonal_of_blocks, pulled = np.empty((len(blocks.scores), size)), np.empty((size, len(blocks.scores), size))
    for g, score in enumerate(blocks.scores):
        share, Q = blocks.leverages(g, free, U)
        correction = 1.0 / np.sqrt(1.0 - np.minimum(share, PULL))
        lost = share * (1.0 - correction**2 * (1.0 - share))
        plain = U @ score[free]
        corrected = plain + Q @ ((correction - 1.0) * (Q.T @ plain))
        middle += np.outer(corrected, corrected) + blocks.lone_variance * (Q * lost) @ Q.T
        turned = Q.T @ U
        diagonal_of_blocks[g] = (share * correction**2 + lost) @ turned**2
        pulled[:, g] = (Q @ ((share * correction)[:, None] * turned)).T
    between = pulled @ pulled.transpose(0, 2, 1)
    shared = np.diagonal(between, axis1=1, axis2=2)
    diagonal = diagonal_of_blocks.T - shared
    trace = np.sum(diagonal, axis=1)
    squares = np.sum(between**2, axis=(1, 2)) + np.sum(diagonal**2 - shared**2, axis=1)
    middle /= 1.0 - blocks.missed
    inverse = U.T @ U
    of_data, of_prior = U.T @ middle @ U, inverse @ (blocks.prior[among] + np.diag(RIDGE / unit**2)) @ inverse
    by_data, by_prior = np.diag(of_data), np.diag(of_prior)
    determined = (by_data > 0.0) & (squares > 0.0)
    share_of_data = by_data[determined] / (by_data + by_prior)[determined]
    result.covariance[among], result.independent[among] = of_data + of_prior, inverse
    of_sum = np.maximum(trace[determined] ** 2 / squares[determined], 1.0)
    with np.errstate(divide="ignore"):  # what the prior alone informs has infinitely many
        result.dof[np.flatnonzero(free)[determined]] = of_sum / share_of_data**2
    return result


def _uncorrected(blocks: Blocks, H: Array, free: Mask, U: Array) -> _Sandwich:
    """`_sandwich` without the correction of single blocks (CR1), since their leverage on a network's weights is small.

    The degrees of freedom are the blocks less one; the eigenvalues of every block would cost seconds.
    """
    among, count = np.ix_(free, free), len(blocks.scores)
    inverse = U.T @ U
    moves = blocks.scores[:, free] @ inverse  # of the optimum, by each block's scores
    of_data = moves.T @ moves * count / max(count - 1, 1) / (1.0 - blocks.missed)
    result = _Sandwich(np.zeros_like(H), np.zeros_like(H), np.full(len(H), np.inf))
    result.covariance[among], result.independent[among] = of_data + inverse @ blocks.prior[among] @ inverse, inverse
    result.dof[free] = max(count - 1, 1)
    return result


def _released(blocks: Blocks, H: Array, free: Mask, gradient: Array) -> tuple[Blocks, Array]:
    """The blocks with scores at the optimum without bounds, one Gauss-Newton step away, and that step (unknowns,)."""
    step = np.zeros(len(H))
    unit, C = _factor(H[np.ix_(free, free)])
    step[free] = -unit * la.cho_solve((C, True), unit * gradient[free])
    return replace(blocks, scores=blocks.scores_after(step)), step


def _off_bounds(H: Array, mask: Mask, stopped: Mask, outward: Array, room: Array, covariance: Array) -> Array:
    """Contribution to the covariance of all unknowns from those at bounds, which may be off them.

    The distance of an unknown from its bound has a normal distribution around the optimum without bounds, truncated at
    both bounds. The others follow: a tyre's stiffness and friction depend on a shape factor that stopped at its bound.

    Parameters
    ----------
    H : (unknowns, unknowns).
    mask, stopped : (unknowns,) free unknowns, and those of them at their bound.
    outward : (stopped,) distance of the optimum without bounds beyond the bound.
    room : (stopped,) distance between the bounds.
    covariance : (stopped, stopped) without bounds.
    """
    sd = np.sqrt(np.diag(covariance))
    off = np.array([_reach_inward(t, r) for t, r in zip(outward / sd, room / sd, strict=True)])
    inner, follow = mask & ~stopped, np.zeros((len(H), int(np.sum(stopped))))
    follow[stopped] = np.eye(int(np.sum(stopped)))
    if np.any(inner):
        unit, C = _factor(H[np.ix_(inner, inner)])
        follow[inner] = -unit[:, None] * la.cho_solve((C, True), unit[:, None] * H[np.ix_(inner, stopped)])
    return np.asarray(follow @ (covariance * np.outer(off, off)) @ follow.T)


def _reach_inward(beyond: float, room: float) -> float:
    """Root mean square of a normal variable of mean -beyond and variance one, truncated to between zero and room."""
    far = min(room, 10.0 - min(beyond, 0.0) if beyond < 5.0 else 50.0 / beyond)
    inward = np.linspace(0.0, far, 1001)
    weight = np.exp(-0.5 * inward**2 - beyond * inward)
    return float(np.sqrt(np.sum(weight * inward**2) / np.sum(weight)))


def _factor(H: Array) -> tuple[Array, Array]:
    """Scales that give H a unit diagonal, and the Cholesky factor of the scaled H."""
    unit = 1.0 / np.sqrt(np.diag(H))
    inner = H * np.outer(unit, unit)
    inner[np.diag_indices_from(inner)] += RIDGE
    return unit, la.cholesky(inner, lower=True)
