"""The least-squares problem of fitting a model with memory: lifted over time and condensed.

In closed loop the predictions themselves are unknowns: one node per output and row, matched to the model's prediction
from the nodes before it (multiple shooting with an interval of one sample). A Gauss-Newton step eliminates the nodes:
the linearised matching conditions give them as a + B dp, run by run, which leaves a dense problem in the parameters.
Source: Albersmeyer & Diehl, The lifted Newton method, SIAM J. Optim. 20 (2010).
In open loop the fed-back inputs are measurements and there are no nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp

from ..base.shorthands import Array, Index, Mask
from ..datasets.recording import Recording
from .elements import Sensing
from .least_squares import NormalEquations, lay_out, limits, prior_system
from .series import Run, runs
from .trace import Trace

Nodes = list[Array]
"""Per run, (n, outputs) predictions; rows before the first prediction are measurements."""

AT_ONCE = 4096
"""Rows up to which short runs are concatenated: beyond, the overhead of numpy's calls is negligible, and the Jacobian
fills the memory."""


@dataclass(frozen=True)
class _Stretch:
    """Runs that are evaluated in one call.

    Attributes
    ----------
    run : the concatenated runs.
    numbers : indices of these runs.
    spans : for each, its rows among the predictions of `run`; the rows between cross a join.
    """

    run: Run
    numbers: range
    spans: tuple[slice, ...]

    @staticmethod
    def of(several: Sequence[Run], numbers: range) -> _Stretch:
        """The stretch of these runs."""
        ends = np.cumsum([len(several[k]) for k in numbers]).tolist()
        first = several[numbers.start].first
        spans = [slice(end - len(several[k]), end - first) for k, end in zip(numbers, ends, strict=True)]
        return _Stretch(_joined([several[k] for k in numbers]), numbers, tuple(spans))

    @property
    def rows(self) -> list[slice]:
        """Rows of each of its runs."""
        return [slice(span.start, span.stop + self.run.first) for span in self.spans]

    def nodes(self, several: Nodes) -> Array | None:
        """The nodes of its runs, of those of all; None in open loop."""
        return np.concatenate([several[k] for k in self.numbers]) if several else None

    def over_all(self, several: Sequence[Array]) -> Array:
        """Rows of each run at their places among all predictions, zero across joins."""
        if len(several) == 1:
            return several[0]
        result = np.zeros((self.spans[-1].stop, *several[0].shape[1:]))
        for span, rows in zip(self.spans, several, strict=True):
            result[span] = rows
        return result


@dataclass(frozen=True)
class _Rare:
    """Columns of a matrix that are zero in most rows.

    Attributes
    ----------
    columns, rows : these columns, consecutive, and the rows in which any of them is not zero.
    beside : all other rows.
    others : the other columns.
    """

    columns: slice
    rows: Index
    beside: Mask
    others: tuple[slice, ...]

    def suits(self, matrix: Array) -> bool:
        """Whether they are zero in the same rows of another matrix too."""
        return not np.any(np.any(matrix[:, self.columns], axis=1)[self.beside])

    @staticmethod
    def of(matrix: Array) -> _Rare | None:
        """The longest run of such columns, if leaving their zeros out saves a third of the product of all columns."""
        nonzero = matrix.T != 0.0
        rare = np.count_nonzero(nonzero, axis=1) < FEW * len(matrix)
        edges = np.flatnonzero(np.diff(np.concatenate(([False], rare, [False])).astype(int))).reshape(-1, 2)
        if not len(edges):
            return None
        start, stop = edges[np.argmax(edges[:, 1] - edges[:, 0])].tolist()
        beside, size = ~np.any(nonzero[start:stop], axis=0), len(nonzero)
        share, others = (stop - start) / size, (slice(0, start), slice(stop, size))
        if (1.0 - share) ** 2 + 2.0 * share * (1.0 - np.mean(beside)) > LESS:
            return None
        return _Rare(
            slice(start, stop), np.flatnonzero(~beside), beside, tuple(one for one in others if one.stop > one.start)
        )


def _joined(several: Sequence[Run]) -> Run:
    """Runs concatenated, for evaluation in one call; predictions of windows across joins get weight zero."""
    if len(several) == 1:
        return several[0]
    result, start = copy(several[0]), 0
    result.pieces = []
    for run in several:
        result.pieces += [slice(start + piece.start, start + piece.stop) for piece in run.pieces]
        start += len(run)
    result.rows = range(start)
    result.recorded = np.concatenate([run.recorded for run in several])
    result.measured = np.concatenate([run.measured for run in several])
    result.unpredicted = np.concatenate([np.arange(len(run)) < run.first for run in several])
    return result


class Problem:
    """Least-squares problem of fitting a traced model to recordings.

    Parameters
    ----------
    trace : the model.
    recordings : training data.
    closed_loop : feed the model's own predictions back; open loop feeds measurements.
    noise : (outputs,) standard deviation by which residuals are divided, in each output's unit.
    strengths : factor by which each group of priors is tightened beyond its stated strength.
    keep : per run, (n,) weight of each row, 0 drops the row; None weights all rows with 1.

    A model that declares itself symmetric is fitted to every run and to its mirror image, each with half the weight;
    run k + copies is the mirror image of run k.
    """

    def __init__(
        self,
        trace: Trace,
        recordings: Sequence[Recording],
        *,
        closed_loop: bool = False,
        noise: Array,
        strengths: Mapping[str, float] | None = None,
        keep: Sequence[Array] | None = None,
    ) -> None:
        self.trace = trace
        self.runs: list[Run] = [run for recording in recordings for run in runs(trace, recording)]
        self.copies = len(self.runs)
        if trace.model.symmetric:
            self.runs += [run for recording in recordings for run in runs(trace, recording.mirrored())]
        self.closed_loop = closed_loop and bool(trace.fed_back)
        self.noise = np.asarray(noise, dtype=float)
        self._keep = list(keep) if keep is not None else [np.ones(len(run)) for run in self.runs]
        self.sensing = Sensing(trace.model)
        self.layout = lay_out(trace.model, len(self.runs), self.copies)
        self._stretches = self._cut()
        self._weights: list[Array] | None = None
        self.bounds, self.free = limits(trace.model, self.layout)
        self._priors: dict[tuple[tuple[str, float], ...], tuple[sp.csr_matrix, Array, Array]] = {}
        self.R, self.r, self._prior_curvature = self._prior(strengths or {})
        self._last: tuple[Array, NormalEquations] | None = None
        self._missed: tuple[Array, float] | None = None
        self._rare: dict[int, _Rare | None] = {}

    def counted(
        self,
        *,
        noise: Array | None = None,
        strengths: Mapping[str, float] | None = None,
        keep: Sequence[Array] | None = None,
    ) -> Problem:
        """The same problem with other noise, prior strengths or row weights; what is None stays as it is.

        Runs and their caches are shared. If only strengths change, the last linearisation is kept and its prior terms
        are exchanged.
        """
        other = copy(self)
        other._last = None
        if noise is not None or keep is not None:
            other._missed = other._weights = None
            other._rare = {}
        if noise is not None:
            other.noise = np.asarray(noise, dtype=float)
        if strengths is not None:
            other.R, other.r, other._prior_curvature = self._prior(strengths)
            if self._last is not None and noise is None and keep is None:
                x, last = self._last
                g = other.R.T @ other.prior_residuals(x) - self.R.T @ self.prior_residuals(x)
                other._last = x, NormalEquations(last.H + other._prior_curvature - self._prior_curvature, last.g + g)
        if keep is not None:
            other._keep = list(keep)
        return other

    def _cut(self) -> list[_Stretch]:
        """Runs without run-scoped parameters and sensors' memory, concatenated up to `AT_ONCE` rows."""
        alone = not self.sensing.plain or any(p.scope == "run" for p in self.trace.model.parameters)
        result, start, rows = [], 0, 0
        for k, run in enumerate(self.runs):
            if k > start and (alone or rows + len(run) > AT_ONCE):
                result.append(_Stretch.of(self.runs, range(start, k)))
                start, rows = k, 0
            rows += len(run)
        return [*result, _Stretch.of(self.runs, range(start, len(self.runs)))]

    def _prior(self, strengths: Mapping[str, float]) -> tuple[sp.csr_matrix, Array, Array]:
        """Jacobian R and offset r of the prior residuals R x - r, and R'R; cached for all copies of this problem."""
        key = tuple(sorted(strengths.items()))
        if key not in self._priors:
            R, r = prior_system(self.trace.model, self.layout, self.copies, strengths)
            self._priors[key] = R, r, (R.T @ R).toarray()
        return self._priors[key]

    @property
    def keep(self) -> Sequence[Array]:
        """Per run, (n,) weight of each row."""
        return self._keep

    @property
    def start(self) -> Array:
        """Unknowns at the parameters' nominal values."""
        return self.unknowns(self.trace.model.values)

    def unknowns(self, p: Array) -> Array:
        """All unknowns from one vector of model parameters; run-scoped ones get the same value in all runs."""
        x = np.empty(self.layout.size)
        for index in self.layout.index:
            x[index] = p
        return x

    def shared(self, x: Array) -> Array:
        """One vector of model parameters for new runs: run-scoped ones at the mean over runs."""
        return np.asarray(np.mean([x[index] for index in self.layout.index], axis=0))

    def simulated_nodes(self, x: Array) -> Nodes:
        """Nodes without matching gaps: a simulation of every run."""
        if not self.closed_loop:
            return []
        result: Nodes = []
        for stretch in self._stretches:
            nodes = stretch.run.simulate(x[self.layout.index[stretch.numbers.start]], stretch.rows)
            result += [nodes[rows] for rows in stretch.rows]
        return result

    def objective(self, x: Array, nodes: Nodes) -> float:
        """Half the sum of squared residuals, priors included; infinite where the model is not finite."""
        total = 0.5 * float(np.sum(self.prior_residuals(x) ** 2)) + self.misfit(x, nodes)
        return total if np.isfinite(total) else np.inf

    def misfit(self, x: Array, nodes: Nodes) -> float:
        """Half the sum of squared residuals of the data alone; the last open-loop value is cached."""
        if not nodes and self._missed is not None and np.array_equal(x, self._missed[0]):
            return self._missed[1]
        total = 0.0
        for place, y in enumerate(self._predicted(x, nodes)):
            residuals, _ = self._residuals(place, y, None, x)
            total += 0.5 * float(np.sum(residuals**2))
        if not nodes:
            self._missed = x.copy(), total
        return total

    def simulated(self, x: Array, nodes: Nodes) -> Iterator[Array]:
        """Per run, the simulated sensor readings, (rows, outputs)."""
        for stretch, y in zip(self._stretches, self._predicted(x, nodes), strict=True):
            for k, span in zip(stretch.numbers, stretch.spans, strict=True):
                yield self.sensing(y[span], None, x[self.layout.index[k]])[0]

    def _predicted(self, x: Array, nodes: Nodes) -> Iterator[Array]:
        """Per stretch, predictions (rows, outputs)."""
        for stretch in self._stretches:
            together, run = stretch.nodes(nodes), stretch.run
            p = x[self.layout.index[stretch.numbers.start]]
            yield run.predict(p) if together is None else together[run.predicted]

    def normal_equations(self, x: Array, nodes: Nodes) -> NormalEquations:
        """Linearise all residuals at a matched point and eliminate the nodes."""
        if self._last is not None and np.array_equal(self._last[0], x):  # nodes match, so x determines them
            return self._last[1]
        result = NormalEquations(self._prior_curvature.copy(), np.asarray(self.R.T @ self.prior_residuals(x)))
        for place, (residuals, J) in enumerate(self._linearised(x, nodes)):
            stretch, weight = self._stretches[place], self._weighing[place]
            rows = _counted(weight[:, 0])
            whole = place if isinstance(rows, slice) else None
            self._add(result, stretch.numbers.start, residuals[rows], J[rows], whole)
        self._last = (x.copy(), result)
        return result

    def folds(self, x: Array, nodes: Nodes, keeps: Sequence[Sequence[Array]]) -> list[Problem]:
        """One problem per choice of row weights, all linearised at x together.

        The normal equations of each at x are those of all rows minus those of its dropped rows, so that one
        linearisation serves all.

        Parameters
        ----------
        x, nodes : a matched point.
        keeps : for each problem, per run, (n,) factor from 0 to 1 on the weight that a row has in this problem.
        """
        whole = self.normal_equations(x, nodes)
        left_out = [NormalEquations(np.zeros_like(whole.H), np.zeros_like(whole.g)) for _ in keeps]
        for k, (residuals, J) in enumerate(self.residuals(x, nodes)):
            for equations, keep in zip(left_out, keeps, strict=True):
                dropped = 1.0 - keep[k][self.runs[k].predicted]
                rows = np.flatnonzero(dropped)
                root = np.sqrt(dropped[rows])
                self._add(equations, k, residuals[rows] * root[:, None], J[rows] * root[:, None, None])
        result = []
        for equations, keep in zip(left_out, keeps, strict=True):
            fold = self.counted(keep=[weight * kept for weight, kept in zip(self.keep, keep, strict=True)])
            fold._last = (x.copy(), NormalEquations(whole.H - equations.H, whole.g - equations.g))
            result.append(fold)
        return result

    def _add(self, equations: NormalEquations, k: int, residuals: Array, J: Array, place: int | None = None) -> None:
        """Add the rows' J'J and J'r of run k to the normal equations; `place`: of all rows of this stretch."""
        index = self.layout.index[k]
        free = self.free[index]
        flat, H, g = J.reshape(-1, J.shape[-1]), equations.H, equations.g
        if np.mean(free) <= FEW or len(index) != len(g):
            flat = flat[:, free]
            H[np.ix_(index[free], index[free])] += flat.T @ flat
            g[index[free]] += flat.T @ residuals.ravel()
            return
        # every unknown belongs to every run: no selection
        g += flat.T @ residuals.ravel()
        rare = None if place is None else self._rare_of(place, flat)
        if rare is None:
            np.add(H, flat.T @ flat, out=H)
            return
        for row, columns in enumerate(rare.others):
            H[columns, columns] += flat[:, columns].T @ flat[:, columns]
            for further in rare.others[row + 1 :]:
                product = flat[:, columns].T @ flat[:, further]
                H[columns, further] += product
                H[further, columns] += product.T
        rows = flat[rare.rows]
        product = rows[:, rare.columns].T @ rows
        H[rare.columns] += product
        for columns in rare.others:
            H[columns, rare.columns] += product[:, columns].T

    def _rare_of(self, place: int, flat: Array) -> _Rare | None:
        """Rare columns of a stretch's derivatives, looked for once: signals that are zero stay zero."""
        known = self._rare.get(place)
        if place not in self._rare or (
            known is not None and np.any(flat[:, known.columns], axis=1)[known.beside].any()
        ):
            known = self._rare[place] = _Rare.of(flat)
        return known

    def gradient(self, x: Array, nodes: Nodes) -> Array:
        """Gradient of the objective at a matched point, zero for fixed unknowns."""
        if not self.sensing.plain:
            return np.where(self.free, self.normal_equations(x, nodes).g, 0.0)
        g = np.asarray(self.R.T @ self.prior_residuals(x))
        for stretch, weight in zip(self._stretches, self._weighing, strict=True):
            k, run = stretch.numbers.start, stretch.run
            index = self.layout.index[k]
            weighed = partial(_weighed, run.measured[run.predicted], weight)
            adjoint = run.adjoint_product(x[index], weighed, stretch.nodes(nodes))
            if adjoint is None:
                return np.where(self.free, self.normal_equations(x, nodes).g, 0.0)
            np.add.at(g, index, adjoint)
        return np.where(self.free, g, 0.0)

    def residuals(self, x: Array, nodes: Nodes) -> Iterator[tuple[Array, Array]]:
        """Per run, residuals (rows, outputs) in noise standard deviations and their derivative (rows, outputs, p).

        The derivative is total: it includes the parameters' effect through the nodes. For fixed parameters it is zero.
        """
        for stretch, (residuals, J) in zip(self._stretches, self._linearised(x, nodes), strict=True):
            yield from ((residuals[span], J[span]) for span in stretch.spans)

    def _linearised(self, x: Array, nodes: Nodes) -> Iterator[tuple[Array, Array]]:
        """Per stretch, residuals and total derivative as of `residuals`, zero across joins."""
        for place, stretch in enumerate(self._stretches):
            k = stretch.numbers.start
            weight = self._weighing[place] if self._weighed_at_once else None
            lines = stretch.run.linearise(x[self.layout.index[k]], stretch.nodes(nodes), weight)
            by_p, free = lines.by_p, self.free[self.layout.index[k]]
            if not np.all(free):
                by_p[:, :, ~free] = 0.0
            if lines.by_nodes is not None and np.mean(free) > FEW:
                by_p = _condense(by_p, lines.by_nodes)  # zero columns stay zero; selecting the others costs more
            elif lines.by_nodes is not None:
                by_p[:, :, free] = _condense(by_p[:, :, free], lines.by_nodes)
            flat, J = self._residuals(place, lines.y, by_p, x)
            assert J is not None
            yield flat.reshape(lines.y.shape), J.reshape(by_p.shape)

    @property
    def _weighing(self) -> list[Array]:
        """Per stretch, factor on its residuals, (rows, outputs): root of the row's weight over the noise."""
        if self._weights is None:
            unit = self.noise * np.sqrt(len(self.runs) / self.copies)
            self._weights = [
                stretch.over_all(
                    [np.sqrt(self.keep[k][self.runs[k].predicted])[:, None] / unit for k in stretch.numbers]
                )
                for stretch in self._stretches
            ]
        return self._weights

    @property
    def _weighed_at_once(self) -> bool:
        """Whether the derivatives of predictions are those of readings, so that each is multiplied by its weight once.

        Those by nodes are not weighted.
        """
        return self.sensing.plain and not self.closed_loop

    def prior_residuals(self, x: Array) -> Array:
        """Residuals of the priors, in standard deviations."""
        return np.asarray(self.R @ x - self.r)

    def _residuals(self, place: int, y: Array, by_p: Array | None, x: Array) -> tuple[Array, Array | None]:
        run, weight = self._stretches[place].run, self._weighing[place]
        observed, observed_by_p = self.sensing(y, by_p, x[self.layout.index[self._stretches[place].numbers.start]])
        residuals = ((observed - run.measured[run.predicted]) * weight).ravel()
        if observed_by_p is None:
            return residuals, None
        if not self._weighed_at_once:
            observed_by_p *= weight[:, :, None]  # in place: a copy takes a third as long as J'J does
        return residuals, observed_by_p.reshape(len(residuals), -1)


def _weighed(measured: Array, weight: Array, predicted: Array) -> Array:
    """Derivative of half the sum of squared residuals with respect to the predictions."""
    return (predicted - measured) * weight**2


LESS = 2 / 3
"""Share of a product's multiplications that may remain if they are done block by block."""
FEW = 0.5
"""If a larger share of the rows counts, or of the unknowns is free, whole matrices are multiplied: other entries are
zero, and a selection would copy the rest."""


def _counted(keep: Array) -> slice | Mask:
    """The rows to multiply: all of them, unless only few have a weight."""
    counted = keep != 0.0
    return counted if np.count_nonzero(counted) < FEW * len(counted) else slice(None)


def _condense(by_p: Array, by_nodes: Array) -> Array:
    """Derivative of the nodes by the parameters: the linearised matching conditions, solved forward in time."""
    rows, outputs, memory, _ = by_nodes.shape
    total = np.zeros((memory + rows, outputs, by_p.shape[2]))  # measurements before the first prediction stay put
    flat = total.reshape((memory + rows) * outputs, -1)
    reach = np.flatnonzero(np.any(by_nodes, axis=(0, 1, 3)))
    oldest = int(reach[0]) if len(reach) else memory - 1
    propagate = np.ascontiguousarray(by_nodes[:, :, oldest:]).reshape(rows, outputs, -1)
    for k in range(rows):
        here = (memory + k) * outputs
        np.matmul(propagate[k], flat[(k + oldest) * outputs : here], out=flat[here : here + outputs])
        total[memory + k] += by_p[k]
    return total[memory:]
