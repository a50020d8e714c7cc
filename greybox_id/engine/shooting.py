"""The least-squares problem of fitting a model with memory, lifted over time and condensed.

Closed loop, the predictions themselves are unknowns: one node per output and row, matched to what the model
makes of the nodes before it (multiple shooting with an interval of one sample). A Gauss-Newton step need not
carry the nodes: the matching conditions, linearised, give them as a + B dp, run by run, and what remains is a
dense problem in the parameters. Source: Albersmeyer & Diehl, The lifted Newton method, SIAM J. Optim. 20 (2010).
Open loop, the fed-back inputs are measurements and there are no nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .belief import belief_rows
from ..parameter import Array
from ..recording import Recording
from .sensing import Sensing
from .series import Run, runs
from .trace import Trace

Nodes = list[Array]
"""Per run, (n, outputs) predictions; measured before the first one."""


@dataclass(frozen=True)
class Layout:
    """Where a run's model parameters stand among the unknowns: run-scoped ones have a place per run."""

    index: tuple[NDArray[np.intp], ...]
    size: int


@dataclass
class NormalEquations:
    """A quadratic model of the objective about a point, nodes eliminated.

    Attributes
    ----------
    H : (unknowns, unknowns) Gauss-Newton Hessian, priors included.
    g : (unknowns,) gradient of the objective along the linearised matching conditions.
    objective : half the sum of squares, priors included, at the point.
    violation : sum of the matching conditions' absolute gaps, in noise standard deviations.
    offset, slope : per run, (n, outputs) and (n, outputs, parameters): node step = offset + slope dp.
    """

    H: Array
    g: Array
    objective: float
    violation: float
    offset: list[Array] = field(default_factory=list)
    slope: list[Array] = field(default_factory=list)


class Problem:
    """Fit a traced model to recordings.

    Parameters
    ----------
    trace : the model.
    recordings : what to fit it to.
    closed_loop : feed the model's own predictions back; open loop feeds measurements.
    noise : (outputs,) standard deviation that one residual counts as, in each output's unit.
    strengths : how much stronger than stated each group of priors is taken.
    keep : per run, (n,) weight of each row, 0 leaves it out; None keeps all.
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
        self.closed_loop = closed_loop and bool(trace.fed_back)
        self.noise = np.asarray(noise, dtype=float)
        self.keep = list(keep) if keep is not None else [np.ones(len(run)) for run in self.runs]
        self.sensing = Sensing(trace)
        self.layout = _layout(trace, len(self.runs))
        self.bounds, self.free = _limits(trace, self.layout)
        self.R, self.r = _beliefs(trace, self.layout, strengths)
        self._believed = (self.R.T @ self.R).toarray()

    @property
    def start(self) -> Array:
        """Unknowns at the parameters' nominal values."""
        return self.unknowns(self.trace.model.values)

    def unknowns(self, p: Array) -> Array:
        """All unknowns from one vector of model parameters, run-scoped ones alike in all runs."""
        x = np.empty(self.layout.size)
        for index in self.layout.index:
            x[index] = p
        return x

    def shared(self, x: Array) -> Array:
        """One vector of model parameters for new runs: run-scoped ones at the mean over runs."""
        return np.asarray(np.mean([x[index] for index in self.layout.index], axis=0))

    def measured_nodes(self) -> Nodes:
        """Nodes at the measurements, the fixed-node start."""
        return [run.measured for run in self.runs] if self.closed_loop else []

    def simulated_nodes(self, x: Array) -> Nodes:
        """Nodes that match exactly: a simulation of every run."""
        if not self.closed_loop:
            return []
        return [run.simulate(x[index]) for run, index in zip(self.runs, self.layout.index, strict=True)]

    def moved(self, nodes: Nodes, equations: NormalEquations, step: Array) -> Nodes:
        """Nodes after a step of the unknowns, to first order."""
        return [
            node + offset + slope @ step[index]
            for node, offset, slope, index in zip(
                nodes, equations.offset, equations.slope, self.layout.index, strict=True
            )
        ]

    def merit(self, x: Array, nodes: Nodes) -> tuple[float, float]:
        """Objective and violation at a point; infinite where the model is not finite."""
        objective = 0.5 * float(np.sum(self.belief_residuals(x) ** 2))
        violation = 0.0
        for k, run in enumerate(self.runs):
            p = x[self.layout.index[k]]
            node = nodes[k] if nodes else None
            predicted = run.predict(p, node)
            if node is not None:
                violation += float(np.sum(np.abs((predicted - node[run.predicted]) / self.noise)))
            residuals, _ = self._residuals(k, predicted if node is None else node[run.predicted], None, p)
            objective += 0.5 * float(np.sum(residuals**2))
        if not np.isfinite(objective + violation):
            return np.inf, np.inf
        return objective, violation

    def normal_equations(self, x: Array, nodes: Nodes) -> NormalEquations:
        """Linearise everything about a point and eliminate the nodes."""
        believed = self.belief_residuals(x)
        result = NormalEquations(
            H=self._believed.copy(),
            g=np.asarray(self.R.T @ believed),
            objective=0.5 * float(np.sum(believed**2)),
            violation=0.0,
        )
        for k, run in enumerate(self.runs):
            index = self.layout.index[k]
            node = nodes[k] if nodes else None
            lines = run.linearise(x[index], node)
            y, by_p = lines.y, lines.by_p
            if node is not None and lines.by_nodes is not None:
                gap = lines.y - node[run.predicted]
                result.violation += float(np.sum(np.abs(gap / self.noise)))
                offset, slope = _condense(gap, lines.by_p, lines.by_nodes, len(run), run.first)
                result.offset.append(offset)
                result.slope.append(slope)
                at_node, _ = self._residuals(k, node[run.predicted], None, x[index])
                result.objective += 0.5 * float(np.sum(at_node**2))
                y, by_p = node[run.predicted] + offset[run.predicted], slope[run.predicted]
            residuals, J = self._residuals(k, y, by_p, x[index])
            assert J is not None
            if node is None:
                result.objective += 0.5 * float(np.sum(residuals**2))
            result.H[np.ix_(index, index)] += J.T @ J
            result.g[index] += J.T @ residuals
        return result

    def residuals(self, x: Array, nodes: Nodes) -> list[tuple[Array, Array]]:
        """Per run, residuals (rows, outputs) in noise standard deviations and their derivative (rows, outputs, p)."""
        found = []
        for k, run in enumerate(self.runs):
            index = self.layout.index[k]
            node = nodes[k] if nodes else None
            lines = run.linearise(x[index], node)
            y, by_p = lines.y, lines.by_p
            if node is not None and lines.by_nodes is not None:
                offset, slope = _condense(y - node[run.predicted], by_p, lines.by_nodes, len(run), run.first)
                y, by_p = node[run.predicted] + offset[run.predicted], slope[run.predicted]
            flat, J = self._residuals(k, y, by_p, x[index])
            assert J is not None
            found.append((flat.reshape(y.shape), J.reshape(*y.shape, -1)))
        return found

    def belief_residuals(self, x: Array) -> Array:
        """Residuals of the priors, in standard deviations."""
        return np.asarray(self.R @ x - self.r)

    def _residuals(self, k: int, y: Array, by_p: Array | None, p: Array) -> tuple[Array, Array | None]:
        run = self.runs[k]
        observed, observed_by_p = self.sensing(y, by_p, p)
        weight = np.sqrt(self.keep[k][run.predicted])[:, None] / self.noise
        residuals = ((observed - run.measured[run.predicted]) * weight).ravel()
        if observed_by_p is None:
            return residuals, None
        return residuals, (observed_by_p * weight[:, :, None]).reshape(len(residuals), -1)


def _condense(gap: Array, by_p: Array, by_nodes: Array, rows: int, first: int) -> tuple[Array, Array]:
    """Solve the linearised matching conditions forward in time: node step = offset + slope dp."""
    outputs, memory = by_nodes.shape[1], by_nodes.shape[2]
    parameters = by_p.shape[2]
    both = np.zeros((rows, outputs, parameters + 1))
    forcing = np.concatenate([by_p, gap[:, :, None]], axis=2)
    propagate = by_nodes.reshape(len(gap), outputs, memory * outputs)
    for k in range(len(gap)):
        window = both[first + k - memory : first + k].reshape(memory * outputs, parameters + 1)
        both[first + k] = forcing[k] + propagate[k] @ window
    return both[:, :, -1], both[:, :, :-1]


def _layout(trace: Trace, count: int) -> Layout:
    size, columns = 0, []
    for parameter in trace.model.parameters:
        if parameter.scope == "run":
            block = size + np.arange(parameter.size * count).reshape(count, parameter.size)
        else:
            block = np.broadcast_to(size + np.arange(parameter.size), (count, parameter.size))
        size = int(block.max(initial=size - 1)) + 1
        columns.append(block)
    joined = np.hstack(columns) if columns else np.empty((count, 0))
    return Layout(tuple(row.astype(np.intp) for row in joined), size)


def _limits(trace: Trace, layout: Layout) -> tuple[tuple[Array, Array], NDArray[np.bool_]]:
    low, high = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    free = np.ones(layout.size, dtype=bool)
    start = 0
    for parameter in trace.model.parameters:
        for index in layout.index:
            own = index[start : start + parameter.size]
            low[own], high[own], free[own] = *parameter.bounds, not parameter.fixed
        start += parameter.size
    return (low, high), free


def _beliefs(trace: Trace, layout: Layout, strengths: Mapping[str, float] | None) -> tuple[sp.csr_matrix, Array]:
    """Prior rows over all unknowns: model-scoped parameters once, run-scoped ones once per run."""
    blocks, offsets, start = [], [], 0
    for parameter in trace.model.parameters:
        R, r = belief_rows([parameter], strengths)
        own = slice(start, start + parameter.size)
        start += parameter.size
        placements = layout.index if parameter.scope == "run" else layout.index[:1]
        for index in placements:
            place = sp.csr_matrix(
                (np.ones(parameter.size), (np.arange(parameter.size), index[own])), shape=(parameter.size, layout.size)
            )
            blocks.append(R @ place)
            offsets.append(r)
    return sp.vstack(blocks, format="csr"), np.concatenate(offsets)
