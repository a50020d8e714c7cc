"""Fitting problems of models with memory as programs for Ipopt: lifted over time, or with the nodes eliminated.

Lifted, the unknowns are the parameters and, per run and row, one node per predicted output; the equations of the
model, `node = model(window of nodes and inputs, p)`, are constraints. Constraints and objective are CasADi expressions
of the traced model. Derivatives are handed over in blocks (`Run.linearise`): differentiating the windows of a run
symbolically would evaluate every sample as often as there are windows over it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as cs
import numpy as np
import scipy.sparse as sp

from ...base.shorthands import Array
from ..least_squares import LeastSquares
from ..series import Run
from ..shooting import Problem

UNLIMITED = 1e10
"""Ipopt takes no infinite values: an effect that stands at its infinite null (no limit at all) is pinned here."""


class Condensed:
    """The problem as a program over the parameters alone: open loop, or closed with the nodes eliminated.

    Unknowns are in units of their own curvature at x: Ipopt's tolerance is one for all of them, and curvatures of a
    network's weights and of a vehicle's numbers span ten orders of magnitude. Units are powers of two, so that changing
    them loses no digit: what was computed at x need not be computed again.

    Attributes
    ----------
    scale : (unknowns,) what one unit of an unknown of the program is.
    """

    def __init__(self, problem: Problem, x: Array) -> None:
        self.size = problem.layout.size
        curvature = np.diag(problem.normal_equations(x, problem.simulated_nodes(x)).H)
        known = problem.free & np.isfinite(curvature) & (curvature > 0)
        self.scale = np.where(known, np.exp2(-np.round(np.log2(np.where(known, curvature, 1.0)) / 2.0)), 1.0)
        Z = cs.MX.sym("Z", self.size)
        X = cs.DM(self.scale) * Z
        empty, gamma = cs.MX.sym("none", 0), cs.MX.sym("gamma")
        self._callbacks = _objective(problem), _normal_equations(problem, self.scale)
        objective, equations = self._callbacks
        (g, H), self.nlp = equations(X), {"x": Z, "f": objective(X)}
        self.derivatives = {
            "grad_f": cs.Function("grad_f", [Z, empty], [self.nlp["f"], g]),
            "hess_lag": cs.Function("hess_lag", [Z, empty, gamma, cs.MX.sym("lam", 0)], [gamma * cs.triu(H)]),
            "no_nlp_grad": True,  # what is evaluated by a callback has no further derivative
        }

    def start(self, x: Array, warm: bool) -> Array:
        """Starting point."""
        del warm
        return x / self.scale


class Computed(cs.Callback):  # type: ignore[misc]
    """Numpy's values of one vector as results of a CasADi function, computed once at each point.

    Parameters
    ----------
    name : of the function.
    size : of the vector.
    patterns : sparsities of the results.
    values : vector -> the nonzeros of each result, column by column.
    """

    def __init__(
        self, name: str, size: int, patterns: Sequence[cs.Sparsity], values: Callable[[Array], Sequence[Array]]
    ) -> None:
        cs.Callback.__init__(self)
        self._size, self._patterns, self._values = size, list(patterns), values
        self._last: tuple[Array, Sequence[Array]] | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        """The vector."""
        return 1

    def get_n_out(self) -> int:
        """How many results there are."""
        return len(self._patterns)

    def get_sparsity_in(self, _: int) -> cs.Sparsity:
        """The vector's."""
        return cs.Sparsity.dense(self._size, 1)

    def get_sparsity_out(self, k: int) -> cs.Sparsity:
        """A result's."""
        return self._patterns[k]

    def has_eval_buffer(self) -> bool:
        """Results are written into CasADi's own memory: a dense `cs.DM` of 544 columns takes 40 ms to make."""
        return True

    def eval_buffer(self, arguments: Sequence[memoryview], results: Sequence[memoryview | None]) -> int:
        """Write the results that are asked for; 0, as CasADi says done."""
        x = np.frombuffer(arguments[0])
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = (x.copy(), self._values(x.copy()))
        for result, known in zip(results, self._last[1], strict=True):
            if result is not None and len(result):
                np.frombuffer(result)[:] = known
        return 0


def _objective(problem: Problem) -> Computed:
    """The objective, by unknowns."""

    def values(x: Array) -> list[Array]:
        return [np.array([problem.objective(x, problem.simulated_nodes(x))])]

    return Computed("objective", problem.layout.size, [cs.Sparsity.dense(1, 1)], values)


def _normal_equations(problem: Problem, scale: Array) -> Computed:
    """Gradient and Gauss-Newton Hessian of the objective, by unknowns in units of `scale`."""

    def values(x: Array) -> list[Array]:
        equations = problem.normal_equations(x, problem.simulated_nodes(x))
        return [scale * equations.g, (np.outer(scale, scale) * equations.H).ravel(order="F")]

    size = problem.layout.size
    return Computed("normal_equations", size, [cs.Sparsity.dense(size, columns) for columns in (1, size)], values)


class Lifted:
    """The problem as a nonlinear program over parameters and nodes."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        outputs = len(problem.trace.model.outputs)
        lengths = [len(run) - run.first for run in problem.runs]
        edges = problem.layout.size + np.cumsum([0, *[length * outputs for length in lengths]])
        self._places = [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        self.size = int(edges[-1])
        X = cs.MX.sym("X", self.size)
        constraints, residuals = [], [cs.mtimes(_sparse(problem.R), X[: problem.layout.size]) - problem.r]
        for k, run in enumerate(problem.runs):
            p = X[problem.layout.index[k].tolist()]
            node = cs.reshape(X[self._places[k]], outputs, lengths[k])
            constraints.append(cs.vec(_model(run, node, p) - node))
            residuals.append(cs.vec(_observed_error(problem, k, node, p)))
        e = cs.vertcat(*residuals)
        self.nlp = {"x": X, "f": 0.5 * cs.sumsqr(e), "g": cs.vertcat(*constraints)}
        J = cs.jacobian(e, X)
        gamma, lam = cs.MX.sym("gamma"), cs.MX.sym("lam", self.size - problem.layout.size)
        H = cs.triu(gamma * cs.mtimes(J.T, J))
        empty = cs.MX.sym("none", 0)
        g = cs.Function("g", [X], [self.nlp["g"]])
        self._constraint_callback = _ConstraintJacobian(problem, self._places, self.size).function()
        self.derivatives = {
            "jac_g": cs.Function("jac_g", [X, empty], [g(X), self._constraint_callback(X)]),
            "hess_lag": cs.Function("hess_lag", [X, empty, gamma, lam], [H]),
        }

    def start(self, x: Array, warm: bool) -> Array:
        """Starting point: nodes at a simulation where x is believed to be the optimum, else at the measurements."""
        nodes = self.problem.simulated_nodes(x) if warm else self.problem.measured_nodes()
        return np.concatenate(
            [x, *[node[run.predicted].ravel() for node, run in zip(nodes, self.problem.runs, strict=True)]]
        )


class _ConstraintJacobian:
    """d(model - node)/d(parameters, nodes), evaluated in blocks by `Run.linearise`."""

    def __init__(self, problem: Problem, places: list[slice], size: int) -> None:
        self._problem, self._places, self._size = problem, places, size

    def function(self) -> Computed:
        """As a CasADi function of all variables."""
        pattern = self._assemble(None)
        sparsity = cs.Sparsity(*pattern.shape, pattern.indptr.tolist(), pattern.indices.tolist())
        return Computed("jac_values", self._size, [sparsity], lambda X: [self._assemble(X).data])

    def _assemble(self, X: Array | None) -> sp.csc_matrix:
        """The Jacobian at X, or its pattern for None, in compressed columns with a pattern that never changes."""
        problem, rows = self._problem, []
        for k, run in enumerate(problem.runs):
            outputs = run.measured.shape[1]
            length = len(run) - run.first
            by_p, by_nodes = self._values(k, X)
            index = problem.layout.index[k]
            entry_rows, entry_columns, entries = [], [], []
            base = np.arange(length * outputs).reshape(length, outputs)
            for output in range(outputs):
                columns = np.union1d(np.flatnonzero(problem.trace.touched_by_p[output]), run.actuation.touched)
                entry_rows.append(np.repeat(base[:, output], len(columns)))
                entry_columns.append(np.tile(index[columns], length))
                entries.append(by_p[:, output, columns].ravel())
            start = self._places[k].start
            for output, lag, source in np.argwhere(problem.trace.touched_by_nodes):
                origin = np.arange(length) - problem.trace.memory + lag  # row of the node among the predicted ones
                inside = origin >= 0
                entry_rows.append(base[inside, output])
                entry_columns.append(start + origin[inside] * outputs + source)
                entries.append(by_nodes[inside, output, lag, source])
            entry_rows.append(base.ravel())
            entry_columns.append(start + base.ravel())
            entries.append(np.full(base.size, -1.0))
            shape = (length * outputs, self._size)
            coordinates = (np.concatenate(entry_rows), np.concatenate(entry_columns))
            rows.append(sp.coo_matrix((np.concatenate(entries), coordinates), shape=shape))
        return sp.vstack(rows).tocsc()

    def _values(self, k: int, X: Array | None) -> tuple[Array, Array]:
        problem, run = self._problem, self._problem.runs[k]
        outputs = run.measured.shape[1]
        length = len(run) - run.first
        if X is None:
            by_p = np.ones((length, outputs, problem.trace.model.size))
            return by_p, np.ones((length, outputs, problem.trace.memory, outputs))
        nodes = np.vstack([run.measured[: run.first], X[self._places[k]].reshape(length, outputs)])
        lines = run.linearise(X[problem.layout.index[k]], nodes)
        assert lines.by_nodes is not None
        return lines.by_p, lines.by_nodes


def bounds_of(problem: LeastSquares, x: Array, size: int) -> tuple[Array, Array]:
    """Bounds of all variables; parameters that are held, or that mean no limit at all, are pinned where they stand."""
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[: len(x)], high[: len(x)] = problem.bounds
    held = np.flatnonzero(~problem.free | (np.abs(x) >= UNLIMITED))
    low[held] = high[held] = x[held]
    return low, high


def _model(run: Run, node: cs.MX, p: cs.MX) -> cs.MX:
    """The model's predictions of a run as an expression of the nodes, (outputs, rows)."""
    trace, first = run.trace, run.first
    u = run.actuation.expression(cs.MX(cs.DM(np.nan_to_num(run.recorded).T)), p)
    before = cs.DM(run.measured[:first].T)
    fed = trace.feedback.function.map(len(run))(cs.horzcat(before, node), u)
    rows = [u[k, :] for k in range(u.shape[0])]
    for position, name in enumerate(trace.fed_back):
        rows[trace.model.inputs.index(name)] = fed[position, :]
    u = cs.vertcat(*rows)
    z = trace.stage.function.map("stages", "serial", len(run), [1], [])(u, p)
    weights = cs.reshape(trace.weights.function(p), trace.memory, len(trace.tap_signal)).T
    length = len(run) - first
    tapped = cs.vertcat(*[z[int(signal), :] for signal in trace.tap_signal])
    h = sum(weights[:, lag] * tapped[:, lag : lag + length] for lag in range(trace.memory))
    newest = u[:, trace.memory - 1 : -1]
    return trace.head.function.map("heads", "serial", length, [2], [])(h, newest, p)


def _observed_error(problem: Problem, k: int, node: cs.MX, p: cs.MX) -> cs.MX:
    """Residuals of a run as an expression of its nodes, (outputs, rows), in noise standard deviations."""
    run = problem.runs[k]
    seen = problem.sensing.expression(node, p)
    weight = problem.weight(k)
    return (seen - cs.DM(run.measured[run.predicted].T)) * cs.DM(weight.T)


def _sparse(matrix: sp.csr_matrix) -> cs.DM:
    columns = matrix.tocsc()
    columns.sort_indices()
    pattern = cs.Sparsity(*columns.shape, columns.indptr.tolist(), columns.indices.tolist())
    return cs.DM(pattern, columns.data)
