"""The fitting problem as nonlinear programs for Ipopt: lifted over time, or with the nodes eliminated.

Constraints and objective are CasADi expressions of the traced model. Derivatives are handed over in blocks
(`Run.linearise`): differentiating the windows of a run symbolically would evaluate every sample as often as there are
windows over it.
"""

from __future__ import annotations

import casadi as cs
import numpy as np
import scipy.sparse as sp

from ..engine.free_run import free_run_expression
from ..engine.least_squares import LeastSquares
from ..engine.series import Run
from ..engine.shooting import Problem
from ..parameter import Array

UNLIMITED = 1e10
"""Ipopt takes no infinite values: an effect that stands at its infinite null (no limit at all) is pinned here."""


class Condensed:
    """The problem as a program over the parameters alone: open loop, or closed with the nodes eliminated.

    Unknowns are in units of their own curvature at x: Ipopt's tolerance is one for all of them, and curvatures of a
    network's weights and of a vehicle's numbers span ten orders of magnitude.

    Attributes
    ----------
    scale : (unknowns,) what one unit of an unknown of the program is.
    """

    def __init__(self, problem: Problem, x: Array) -> None:
        self.size = problem.layout.size
        curvature = np.diag(problem.normal_equations(x, problem.simulated_nodes(x)).H)
        told = problem.free & np.isfinite(curvature) & (curvature > 0)
        self.scale = np.where(told, 1.0 / np.sqrt(np.where(told, curvature, 1.0)), 1.0)
        Z = cs.MX.sym("Z", self.size)
        X = cs.DM(self.scale) * Z
        residuals = [cs.mtimes(_sparse(problem.R), X) - problem.r]
        for k, run in enumerate(problem.runs):
            p = X[problem.layout.index[k].tolist()]
            y = _simulated(run, p) if problem.closed_loop else _model(run, None, p)
            residuals.append(cs.vec(_observed_error(problem, k, y, p)))
        self.nlp = {"x": Z, "f": 0.5 * cs.sumsqr(cs.vertcat(*residuals))}
        empty, gamma = cs.MX.sym("none", 0), cs.MX.sym("gamma")
        self._equations = _NormalEquations("normal_equations", problem, self.scale)
        g, H = self._equations(X)
        self.derivatives = {
            "grad_f": cs.Function("grad_f", [Z, empty], [self.nlp["f"], g]),
            "hess_lag": cs.Function("hess_lag", [Z, empty, gamma, cs.MX.sym("lam", 0)], [gamma * cs.triu(H)]),
        }

    def start(self, x: Array, warm: bool) -> Array:
        """Starting point."""
        del warm
        return x / self.scale


class _NormalEquations(cs.Callback):  # type: ignore[misc]
    """Gradient and Gauss-Newton Hessian of the objective, by unknowns in units of `scale`."""

    def __init__(self, name: str, problem: Problem, scale: Array) -> None:
        cs.Callback.__init__(self)
        self._problem, self._scale = problem, scale
        self._last: tuple[Array, list[cs.DM]] | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 2

    def get_sparsity_in(self, _: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self._problem.layout.size, 1)

    def get_sparsity_out(self, k: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self._problem.layout.size, self._problem.layout.size if k else 1)

    def eval(self, arguments: list[cs.DM]) -> list[cs.DM]:
        x = np.asarray(arguments[0].full()).ravel()
        if self._last is None or not np.array_equal(self._last[0], x):
            equations = self._problem.normal_equations(x, self._problem.simulated_nodes(x))
            by = self._scale
            self._last = (x, [cs.DM(by * equations.g), cs.DM(np.outer(by, by) * equations.H)])
        return self._last[1]


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
        self._constraint_callback = _ConstraintJacobian("jac_values", problem, self._places, self.size)
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


class _ConstraintJacobian(cs.Callback):  # type: ignore[misc]
    """d(model - node)/d(parameters, nodes), evaluated in blocks by `Run.linearise`."""

    def __init__(self, name: str, problem: Problem, places: list[slice], size: int) -> None:
        cs.Callback.__init__(self)
        self._problem, self._places, self._size = problem, places, size
        pattern = self._assemble(None)
        self._sparsity = cs.Sparsity(
            pattern.shape[0], pattern.shape[1], pattern.indptr.tolist(), pattern.indices.tolist()
        )
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, _: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self._size, 1)

    def get_sparsity_out(self, _: int) -> cs.Sparsity:
        return self._sparsity

    def eval(self, arguments: list[cs.DM]) -> list[cs.DM]:
        return [cs.DM(self._sparsity, self._assemble(np.asarray(arguments[0].full()).ravel()).data)]

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


def _model(run: Run, node: cs.MX | None, p: cs.MX) -> cs.MX:
    """The model's predictions of a run as an expression of the nodes, (outputs, rows)."""
    trace, first = run.trace, run.first
    u = run.actuation.expression(cs.MX(cs.DM(np.nan_to_num(run.recorded).T)), p)
    if node is not None:
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


def _simulated(run: Run, p: cs.MX) -> cs.MX:
    """A free run as an expression of the parameters, (outputs, rows)."""
    measured_loop, _ = run.inputs(run.trace.model.values, run.measured)
    recorded = np.where(np.isnan(run.recorded), measured_loop, run.recorded)
    fed = [run.trace.model.inputs.index(name) for name in run.trace.fed_back]
    recorded[:, fed] = measured_loop[:, fed]
    u = run.actuation.expression(cs.MX(cs.DM(recorded.T)), p)
    return free_run_expression(run.trace, u, run.measured, p)


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
