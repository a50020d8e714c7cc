"""The least-squares problem of fitting a motion model: multiple shooting, the nodes eliminated.

A run is predicted in intervals. Each starts from the readings of its first row, taken back through the sensors; where the
start is free, it may deviate from them. Over the whole run (no horizon) that is output error: one interval, cut only so
that its pieces can be linearised side by side. With a horizon it is multi-step prediction: every interval starts afresh,
actuators alone carry on, for they know nothing of the vehicle.

The states at cuts follow by simulation; their derivatives follow from piece to piece by the chain rule. What is left
is a dense problem in the parameters and the free starts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import BadInput
from ...motion_model import MotionModel
from ...parameter import Array
from ...recording import Recording
from ..layout import Layout, NormalEquations, beliefs, lay_out, limits
from .lanes import Interval, Lanes, lay
from .runs import Index, MotionRun, motion_runs
from .schedule import Schedule, schedule
from .simulator import Simulator
from .starts import IntervalStarts
from .stiffness import longest_segment
from .trace import MotionTrace

Mask = NDArray[np.bool_]

LANES = 16
"""A single long run is cut into so many lanes: two blocks of the eight that compiled code integrates at once."""
MOST_PASSES, CLOSED, WIDEST_GAP = 5, 1e-9, 0.3
"""Lanes are matched in so many passes at most, until no gap exceeds this share of a state's size; with gaps wider than
the last, one lane after the other is simulated instead."""
Starts = Literal["free", "measured"]


@dataclass(frozen=True)
class Simulated:
    """A simulation of all intervals.

    Attributes
    ----------
    lanes : their layout, at the shifts' values.
    cut : the same cut for linearising.
    starts : (lanes of cut, nz) states where they begin.
    y : (N, outputs) predicted readings of all rows of all intervals; NaN where none was taken.
    """

    lanes: Lanes
    cut: Lanes
    starts: Array
    y: Array

    @property
    def taken(self) -> Mask:
        """(N, outputs) whether a reading was taken."""
        return np.asarray(self.lanes.lane >= 0)


@dataclass(frozen=True)
class Chain:
    """The last linearisation: at x, states at the lanes' starts, their derivative, and that of their ends by them."""

    x: Array
    columns: Index
    starts: Array
    by: Array
    ends: Array


class MotionProblem:
    """Fit a motion model to recordings.

    Parameters
    ----------
    simulator : the model.
    recordings : what to fit it to.
    noise : (outputs,) standard deviation that one residual counts as, in each output's unit.
    horizon : s predicted from one start; None for whole runs.
    starts : "free" lets the start of every interval deviate from its readings; "measured" takes them as they are.
    strengths : how much stronger than stated each group of priors is taken.
    robust : residuals beyond so many standard deviations count linearly (Huber); None for least squares throughout.
    keep : per run, (n,) weight of each row or (n, outputs) of each reading, 0 leaves it out; None keeps all.

    Attributes
    ----------
    parameters : per run, where its parameters stand among the unknowns.
    layout : per interval, where its parameters and its free starts stand.
    """

    def __init__(
        self,
        simulator: Simulator,
        recordings: Sequence[Recording],
        *,
        noise: Array,
        horizon: float | None = None,
        starts: Starts = "free",
        strengths: Mapping[str, float] | None = None,
        robust: float | None = None,
        keep: Sequence[Array] | None = None,
    ) -> None:
        self.simulator, self.trace = simulator, simulator.trace
        model = self.trace.model
        self.model = model
        self.runs: list[MotionRun] = [run for recording in recordings for run in motion_runs(model, recording)]
        self.noise = np.asarray(noise, dtype=float)
        self.horizon, self.robust = horizon, robust
        at = {name: k for k, name in enumerate(model.outputs)}
        seen = np.any([np.any(np.isfinite(run.measured), axis=0) for run in self.runs], axis=0)
        self.measured = tuple(name for name in self.trace.names if name in at and seen[at[name]])
        self._channels = np.array([at[name] for name in self.measured], dtype=np.intp)
        self.intervals = [
            found for k, run in enumerate(self.runs) for found in _intervals(k, run, self._channels, horizon)
        ]
        if not self.intervals:
            raise BadInput(
                f"No run of {self.runs[0].name} has a row at which {', '.join(self.measured)} are all there."
            )
        self.longest = longest_segment(self.trace, self.runs, model.values)
        self.parameters = lay_out(model, len(self.runs), len(self.runs))
        self.loose = _loose(self.trace, self.measured) if starts == "free" else np.empty(0, dtype=np.intp)
        self.layout = _with_starts(self.parameters, self.intervals, len(self.loose))
        self.copies = len(self.intervals)
        low, high, free = _all_limits(model, self.parameters, self.layout.size)
        self.bounds, self.free = (low, high), free
        self.R, self.r = self._beliefs(strengths)
        self._believed = (self.R.T @ self.R).toarray()
        self.target, self.weight = self._targets(keep)
        self._interval_starts = IntervalStarts(
            simulator, self.runs, self.intervals, self.measured, carried=horizon is not None
        )
        self._plans: tuple[Array, list[Schedule], Lanes, Lanes] | None = None
        self._chain: Chain | None = None

    def weighing(self, keep: Sequence[Array] | None) -> MotionProblem:
        """The same problem with other weights of rows or readings; all that was laid out is shared."""
        other = copy(self)
        other.target, other.weight = self._targets(keep)
        return other

    @property
    def sample_time(self) -> float:
        """Usual step of the recordings, s."""
        return float(np.median([run.sample_time for run in self.runs]))

    @property
    def start(self) -> Array:
        """Unknowns at the parameters' nominal values, starts at their readings."""
        return self.unknowns(self.model.values)

    def unknowns(self, p: Array) -> Array:
        """All unknowns from one vector of model parameters: alike in all runs, starts at their readings."""
        x = np.zeros(self.layout.size)
        for index in self.parameters.index:
            x[index] = p
        return x

    def shared(self, x: Array) -> Array:
        """One vector of model parameters for new runs: run-scoped ones at the mean over runs."""
        low, high = (bound[self.parameters.index[0]] for bound in self.bounds)
        mean = np.mean([x[index] for index in self.parameters.index], axis=0)
        return np.asarray(np.clip(mean, low, high))  # the mean of equal numbers at a bound may lie beyond it by rounding

    def per_run(self, x: Array) -> Array:
        """(runs, parameters) the parameters of each run."""
        return np.array([x[index] for index in self.parameters.index])

    def simulated_nodes(self, x: Array) -> Simulated:
        """A simulation of every interval."""
        lanes, cut = self._lanes(x)
        p = self._of_intervals(x)
        z0, _ = self._starts(x)
        with np.errstate(all="ignore"):
            found = self._side_by_side(x, z0, p, lanes, cut)
            if found is not None:
                return found
            z, y = self.simulator.kernel.simulate(z0, lanes.segments, p, lanes.reads)
        return Simulated(lanes, cut, z[cut.interval, cut.offset], lanes.gathered(y))

    def _side_by_side(self, x: Array, z0: Array, p: Array, lanes: Lanes, cut: Lanes) -> Simulated | None:
        """A simulation of all lanes at once, from states at the cuts that the last linearisation foretells.

        Newton's method closes what gaps are left; None where that does not work out, or nothing is known yet.
        """
        chain = self._chain
        if cut is lanes or chain is None or chain.starts.shape[0] != len(cut.interval):
            return None
        moved = (x - chain.x)[self._moving_index(chain.columns)]
        starts = chain.starts + np.einsum("lzq,lq->lz", chain.by, moved[cut.interval])
        starts[cut.first] = z0
        scale = np.max(np.abs(starts), axis=0) + 1e-6
        for _ in range(MOST_PASSES):
            z, y = self.simulator.kernel.simulate(starts, cut.segments, p[cut.interval], cut.reads)
            gaps = np.where(cut.first[:, None], 0.0, np.roll(z[:, -1], 1, axis=0) - starts)
            size = np.max(np.abs(gaps / scale))
            if not size < WIDEST_GAP:
                return None
            if size < CLOSED:
                return Simulated(lanes, cut, starts, cut.gathered(y))
            carried = np.zeros(self.trace.size)
            for lane in np.flatnonzero(~cut.first):
                carried = gaps[lane] + (0.0 if cut.first[lane - 1] else chain.ends[lane - 1] @ carried)
                starts[lane] += carried
        return None

    def objective(self, x: Array, nodes: Simulated) -> float:
        """Half the sum of squared residuals, priors included; infinite where the model is not finite."""
        total = 0.5 * float(np.sum(self.belief_residuals(x) ** 2)) + self.misfit(x, nodes)
        return total if np.isfinite(total) else np.inf

    def misfit(self, x: Array, nodes: Simulated) -> float:
        """Half the sum of squared residuals of the data alone."""
        del x
        e = np.abs(self._residuals(nodes))
        if self.robust is None:
            return 0.5 * float(np.sum(e**2))
        return float(np.sum(np.where(e <= self.robust, 0.5 * e**2, self.robust * (e - 0.5 * self.robust))))

    def normal_equations(self, x: Array, nodes: Simulated) -> NormalEquations:
        """Linearise everything about a simulated point."""
        H, g = self._believed.copy(), self._pull_of_beliefs(x)
        columns, e, J = self._linearised(x, nodes)
        pieces = self._pieces(nodes, columns)
        for rows, index in pieces:
            flat = J[rows].reshape(-1, J.shape[-1])
            H[np.ix_(index, index)] += flat.T @ flat
            g[index] += flat.T @ e[rows].ravel()

        def pulled(x: Array, nodes: Simulated) -> Array:
            e, _ = self._weighted(nodes)
            found = self._pull_of_beliefs(x)
            for rows, index in pieces:
                found[index] += J[rows].reshape(-1, J.shape[-1]).T @ e[rows].ravel()
            return found

        return NormalEquations(H, g, pulled)

    def _pieces(self, nodes: Simulated, columns: Index) -> list[tuple[slice, Index]]:
        """Rows that share their unknowns, and where these stand: everything at once where all intervals do."""
        if len(self.loose) == 0 and len({tuple(i) for i in self.parameters.index}) == 1:
            return [(slice(0, len(self.target)), self.parameters.index[0][columns])]
        return [(rows, self._columns(k, columns)) for k, rows in enumerate(self._rows(nodes))]

    def at_nodes(self, x: Array, inner: Array) -> tuple[float, Array, Array, Array, Array]:
        """The lifted problem at nodes that need not match.

        Parameters
        ----------
        x : (unknowns,).
        inner : (cuts, nz) states at the cuts.

        Returns
        -------
        Objective, gaps (cuts * nz), gradient, the gaps' Jacobian and the Gauss-Newton Hessian, by [x, nodes].
        """
        lanes, cut = self._lanes(x)
        p, size = self._of_intervals(x), self.trace.size
        starts, starts_by_p = self._starts(x)
        begin = np.empty((len(cut.interval), size))
        begin[cut.first], begin[~cut.first] = starts, inner
        columns = self._moving()
        z_end, Z_end, y, Y = self.simulator.kernel.linearise(begin, cut.segments, p[cut.interval], cut.reads, columns)
        nodes = Simulated(lanes, cut, begin, cut.gathered(y))
        total = len(x) + inner.size
        where = np.cumsum(~cut.first) - 1  # the node at which a lane begins
        S = np.zeros((len(cut.interval), size, total))  # states at the lanes' beginnings by all variables
        for lane, interval in enumerate(cut.interval):
            if cut.first[lane]:
                index = self.layout.index[interval]
                S[lane][:, index[columns]] = starts_by_p[interval][:, columns]
                S[lane][self.loose, index[self.model.size :]] = 1.0
            else:
                own = len(x) + where[lane] * size
                S[lane][:, own : own + size] = np.eye(size)
        J = Y[..., :size].reshape(len(S), -1, size) @ S
        ends = Z_end[..., :size] @ S
        for lane, interval in enumerate(cut.interval):
            index = self.layout.index[interval][columns]
            J[lane][:, index] += Y[lane, :, :, size:].reshape(J.shape[1], -1)
            ends[lane][:, index] += Z_end[lane, :, size:]
        J = cut.gathered(J.reshape(*Y.shape[:3], total), 0.0)
        e, weight = self._weighted(nodes)
        flat, e = (J * weight[:, :, None]).reshape(-1, total), e.ravel()
        before = np.flatnonzero(~cut.first) - 1
        own = len(x) + np.arange(inner.size)
        gaps_by = ends[before].reshape(inner.size, total)
        gaps_by[np.arange(inner.size), own] -= 1.0
        H, g = flat.T @ flat, flat.T @ e
        H[: len(x), : len(x)] += self._believed
        g[: len(x)] += self._pull_of_beliefs(x)
        return self.objective(x, nodes), (z_end[before] - inner).ravel(), g, gaps_by, H

    def residuals(self, x: Array, nodes: Simulated) -> Iterator[tuple[Array, Array]]:
        """Per interval, residuals (rows, outputs) in noise standard deviations and their derivative (rows, outputs, p).

        p are the interval's unknowns as the layout lists them; by held ones the derivative is zero. What was not read
        counts as zero.
        """
        columns, e, J = self._linearised(x, nodes)
        moving = np.concatenate((columns, self.model.size + np.arange(len(self.loose))))
        for rows in self._rows(nodes):
            full = np.zeros((*e[rows].shape, self.model.size + len(self.loose)))
            full[:, :, moving] = J[rows]
            yield e[rows], full

    def belief_residuals(self, x: Array) -> Array:
        """Residuals of the priors, in standard deviations."""
        return np.asarray(self.R @ x - self.r) if len(self.r) else np.zeros(0)

    def _pull_of_beliefs(self, x: Array) -> Array:
        return np.asarray(self.R.T @ self.belief_residuals(x)) if len(self.r) else np.zeros(len(x))

    def errors(self, nodes: Simulated) -> Array:
        """(N, outputs) prediction minus reading, in the outputs' units; NaN where there is none."""
        return np.where((self.weight > 0) & nodes.taken, nodes.y - self.target, np.nan)

    def _residuals(self, nodes: Simulated) -> Array:
        """(N, outputs) in noise standard deviations; zero where there is no reading."""
        return np.where((self.weight > 0) & nodes.taken, nodes.y - self.target, 0.0) * self.weight

    def _rows(self, nodes: Simulated) -> list[slice]:
        edges = nodes.lanes.rows
        return [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]

    def _moving(self) -> Index:
        """Parameters that are free in any run."""
        return np.flatnonzero(np.any([self.free[index] for index in self.parameters.index], axis=0))

    def _moving_index(self, columns: Index) -> Index:
        """(intervals, q) where the moving parameters and free starts of each interval stand."""
        chosen = np.concatenate((columns, self.model.size + np.arange(len(self.loose))))
        return np.array([index[chosen] for index in self.layout.index])

    def _columns(self, k: int, columns: Index) -> Index:
        index = self.layout.index[k]
        return np.concatenate((index[columns], index[self.model.size :]))

    def _of_intervals(self, x: Array) -> Array:
        return self.per_run(x)[[interval.run for interval in self.intervals]]

    def _lanes(self, x: Array) -> tuple[Lanes, Lanes]:
        """Intervals as lanes, whole and cut; laid out anew when a delay moved."""
        shifts = np.array([self.simulator.shifts(p) for p in self.per_run(x)])
        if self._plans is None or not np.array_equal(self._plans[0], shifts):
            plans = [schedule(self.trace, run, own, self.longest) for run, own in zip(self.runs, shifts, strict=True)]
            lanes = lay(plans, self.intervals)
            cuts = max(1, LANES // len(self.intervals))
            self._plans = (shifts, plans, lanes, lay(plans, self.intervals, cuts) if cuts > 1 else lanes)
        return self._plans[2], self._plans[3]

    def _starts(self, x: Array) -> tuple[Array, Array]:
        """States at the intervals' starts and their derivative by the parameters."""
        self._lanes(x)
        assert self._plans is not None
        z, by_p = self._interval_starts(self.per_run(x), self._plans[1])
        if len(self.loose):
            z[:, self.loose] += x[self.parameters.size :].reshape(len(self.intervals), -1)
        return z, by_p

    def _linearised(self, x: Array, nodes: Simulated) -> tuple[Index, Array, Array]:
        """Moving parameters, weighted residuals (N, outputs), and their derivative by these and the free starts."""
        cut, p = nodes.cut, self._of_intervals(x)
        columns = self._moving()
        _, starts_by_p = self._starts(x)
        _, Z_end, _, Y = self.simulator.kernel.linearise(
            nodes.starts, cut.segments, p[cut.interval], cut.reads, columns
        )
        G = self._chained(cut, Z_end, starts_by_p[:, :, columns])
        size = self.trace.size
        self._chain = Chain(x.copy(), columns, nodes.starts, G, Z_end[:, :, :size])
        lanes, reads, outputs, _ = Y.shape
        J = Y[..., :size].reshape(lanes, reads * outputs, size) @ G
        J[:, :, : len(columns)] += Y[..., size:].reshape(lanes, reads * outputs, -1)
        J = cut.gathered(J.reshape(lanes, reads, outputs, -1), 0.0)
        e, weight = self._weighted(nodes)
        J *= weight[:, :, None]
        return columns, e, J

    def _weighted(self, nodes: Simulated) -> tuple[Array, Array]:
        """Weighted residuals and their weights; those in the tails of a robust loss weigh less."""
        e, weight = self._residuals(nodes), np.where(nodes.taken, self.weight, 0.0)
        if self.robust is None:
            return e, weight
        tail = np.sqrt(np.minimum(1.0, self.robust / np.maximum(np.abs(e), 1e-12)))
        return e * tail, weight * tail

    def _chained(self, cut: Lanes, Z_end: Array, starts_by_p: Array) -> Array:
        """Derivative of every lane's starting states by the parameters and its interval's free starts, (L, nz, q)."""
        size, moving = self.trace.size, starts_by_p.shape[2]
        G = np.zeros((len(cut.interval), size, moving + len(self.loose)))
        G[cut.first, :, :moving] = starts_by_p
        G[:, self.loose, moving + np.arange(len(self.loose))] = cut.first[:, None]
        for lane in np.flatnonzero(~cut.first):
            G[lane] = Z_end[lane - 1, :, :size] @ G[lane - 1]
            G[lane, :, :moving] += Z_end[lane - 1, :, size:]
        return G

    def _targets(self, keep: Sequence[Array] | None) -> tuple[Array, Array]:
        """Readings to be met, (N, outputs), and the weight of each: zero where there is none."""
        target = np.vstack([self.runs[i.run].measured[i.start : i.stop] for i in self.intervals])
        weight = np.where(np.isfinite(target), 1.0 / self.noise, 0.0)
        if keep is not None:
            kept = [np.asarray(keep[i.run][i.start : i.stop], dtype=float) for i in self.intervals]
            weight = weight * np.sqrt(np.vstack([own.reshape(len(own), -1) for own in kept]))
        return np.where(np.isfinite(target), target, 0.0), weight

    def _beliefs(self, strengths: Mapping[str, float] | None) -> tuple[sp.csr_matrix, Array]:
        """Priors of the parameters, and of starts that no reading tells."""
        R, r = beliefs(self.model, self.parameters, len(self.runs), strengths)
        R = sp.hstack([R, sp.csr_matrix((R.shape[0], self.layout.size - R.shape[1]))], format="csr")
        untold = [
            (index[self.model.size + j], 1.0 / self.model.states[state].scale)
            for index in self.layout.index
            for j, state in enumerate(self.loose)
            if self.trace.names[state] not in self.measured
        ]
        if not untold:
            return R, r
        places, weights = np.array([a for a, _ in untold]), np.array([b for _, b in untold])
        rows = sp.csr_matrix((weights, (np.arange(len(untold)), places)), shape=(len(untold), self.layout.size))
        return sp.vstack([R, rows], format="csr"), np.concatenate((r, np.zeros(len(untold))))


def _intervals(k: int, run: MotionRun, channels: Index, horizon: float | None) -> list[Interval]:
    """The rows of a run in stretches of a horizon, each from a row at which the measured states have a reading."""
    rows = len(run) if horizon is None else max(1, round(horizon / run.sample_time))
    wanted = np.arange(0, len(run), rows)
    starts = run.starts(channels, wanted)
    stops = [*starts[1:].tolist(), len(run)]
    return [Interval(k, int(a), int(b)) for a, b in zip(starts, stops, strict=True)]


def _loose(trace: MotionTrace, measured: tuple[str, ...]) -> Index:
    """States whose start is unknown: those measured with noise, and those whose start is only a guess."""
    return np.array(
        [k for k, s in enumerate(trace.model.states) if s.name in measured or callable(s.start)], dtype=np.intp
    )


def _with_starts(parameters: Layout, intervals: Sequence[Interval], loose: int) -> Layout:
    index = tuple(
        np.concatenate((parameters.index[i.run], parameters.size + k * loose + np.arange(loose))).astype(np.intp)
        for k, i in enumerate(intervals)
    )
    return Layout(index, parameters.size + loose * len(intervals))


def _all_limits(model: MotionModel, parameters: Layout, size: int) -> tuple[Array, Array, Mask]:
    (low, high), free = limits(model, parameters)
    more = size - len(low)
    return (
        np.append(low, np.full(more, -np.inf)),
        np.append(high, np.full(more, np.inf)),
        np.append(free, np.ones(more, dtype=bool)),
    )
