"""Ipopt on the same problem, lifted over time: it certifies what Gauss-Newton found, or carries on from it.

Closed loop, the unknowns are the parameters and, per run and row, one node per predicted output; the equations of
the model, `node = model(window of nodes and inputs, p)`, are constraints. Open loop there are parameters alone. The
objective is the least-squares objective, bounds are bounds, and the Hessian is Gauss-Newton's.

The fitting problems as nonlinear programs for Ipopt: lifted over time, or with the nodes eliminated.

Lifted, constraints and objective are CasADi expressions of the traced model. Derivatives are handed over in blocks
(`Run.linearise`): differentiating the windows of a run symbolically would evaluate every sample as often as there are
windows over it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as cs
import numpy as np
import scipy.sparse as sp

from ...base.shorthands import Array, Index
from ..kernel import Against
from ..least_squares import LeastSquares
from ..motion.lanes import Lanes
from ..motion.shooting import LANES, MotionProblem
from ..series import Run
from ..shooting import Problem
from .gauss_newton import Solution, Status

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


class _Computed(cs.Callback):  # type: ignore[misc]
    """Numpy's values of one vector as results of a CasADi function, computed once at each point.

    Parameters
    ----------
    name : of the function.
    size : of the vector.
    patterns : sparsities of the results.
    values : vector -> results.
    """

    def __init__(
        self, name: str, size: int, patterns: Sequence[cs.Sparsity], values: Callable[[Array], list[cs.DM]]
    ) -> None:
        cs.Callback.__init__(self)
        self._size, self._patterns, self._values = size, list(patterns), values
        self._last: tuple[Array, list[cs.DM]] | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return len(self._patterns)

    def get_sparsity_in(self, _: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self._size, 1)

    def get_sparsity_out(self, k: int) -> cs.Sparsity:
        return self._patterns[k]

    def eval(self, arguments: list[cs.DM]) -> list[cs.DM]:
        x = np.asarray(arguments[0].full()).ravel()
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = (x, self._values(x))
        return self._last[1]


def _objective(problem: Problem) -> _Computed:
    """The objective, by unknowns."""

    def values(x: Array) -> list[cs.DM]:
        return [cs.DM(problem.objective(x, problem.simulated_nodes(x)))]

    return _Computed("objective", problem.layout.size, [cs.Sparsity.dense(1, 1)], values)


def _normal_equations(problem: Problem, scale: Array) -> _Computed:
    """Gradient and Gauss-Newton Hessian of the objective, by unknowns in units of `scale`."""

    def values(x: Array) -> list[cs.DM]:
        equations = problem.normal_equations(x, problem.simulated_nodes(x))
        return [cs.DM(scale * equations.g), cs.DM(np.outer(scale, scale) * equations.H)]

    size = problem.layout.size
    return _Computed("normal_equations", size, [cs.Sparsity.dense(size, columns) for columns in (1, size)], values)


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

    def function(self) -> _Computed:
        """As a CasADi function of all variables."""
        pattern = self._assemble(None)
        sparsity = cs.Sparsity(*pattern.shape, pattern.indptr.tolist(), pattern.indices.tolist())
        return _Computed("jac_values", self._size, [sparsity], lambda X: [cs.DM(sparsity, self._assemble(X).data)])

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


class MotionProgram:
    """Variables [x, nodes], objective, matching constraints and their derivatives, for CasADi's nlpsol."""

    def __init__(self, problem: MotionProblem, x: Array) -> None:
        self.problem = problem
        nodes = problem.simulated_nodes(x)
        self._inner = np.flatnonzero(~nodes.cut.first)
        self.unknowns, self.states = problem.layout.size, problem.trace.size
        self.size = self.unknowns + len(self._inner) * self.states
        self.constraints = len(self._inner) * self.states
        # Variables in units of what one residual's worth of error is: SI units span orders of magnitude.
        curvature = np.diag(problem.normal_equations(x, nodes).H)
        of_x = 1.0 / np.sqrt(np.where(curvature > 0, curvature, 1.0))
        self.scale = np.concatenate([of_x, np.tile(np.max(np.abs(nodes.starts), axis=0) + 1e-3, len(self._inner))])
        X, none = cs.MX.sym("X", self.size), cs.MX.sym("none", 0)
        gamma, lam = cs.MX.sym("gamma"), cs.MX.sym("lam", self.constraints)
        self._callback = _linearised(problem, self.scale, nodes.cut)
        f, g, df, dg, H = self._callback(X)
        self.nlp = {"x": X, "f": f, "g": g}
        self.derivatives = {
            "grad_f": cs.Function("grad_f", [X, none], [f, df]),
            "jac_g": cs.Function("jac_g", [X, none], [g, dg]),
            "hess_lag": cs.Function("hess_lag", [X, none, gamma, lam], [gamma * cs.triu(H)]),
            "no_nlp_grad": True,  # what is linearised by a callback has no further derivative
        }

    def start(self, x: Array, warm: bool) -> Array:
        """Starting point: nodes at a simulation."""
        del warm
        nodes = self.problem.simulated_nodes(x).starts[self._inner]
        return np.asarray(np.concatenate([x, nodes.ravel()]) / self.scale)


class LiftedMotion(NamedTuple):
    """The lifted problem at a point: by all variables, [x, nodes].

    Attributes
    ----------
    objective : half the sum of squares.
    gaps : (cuts * nz,) where lanes end minus where the next ones begin.
    gradient : (variables,) of the objective.
    gaps_by : (cuts * nz, variables) derivative of the gaps.
    H : (variables, variables) Gauss-Newton Hessian.
    """

    objective: float
    gaps: Array
    gradient: Array
    gaps_by: Array
    H: Array


@np.errstate(over="ignore", invalid="ignore")  # far off, it is not finite, and Ipopt takes a shorter step
def at_nodes(problem: MotionProblem, x: Array, inner: Array) -> LiftedMotion:
    """The lifted problem at nodes that need not match.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,).
    inner : (cuts, nz) states at the cuts.
    """
    _, cut = problem.lanes(x)
    p, size, moving = problem.of_intervals(x), problem.trace.size, problem.moving
    starts, starts_by_p = problem.starts(x)
    begin = np.empty((len(cut.interval), size))
    begin[cut.first], begin[~cut.first] = starts, inner
    of_lanes, against, misfit = p[cut.interval], problem.against(cut), 0.0
    total, z_end = len(x) + inner.size, np.empty_like(begin)
    H, g, gaps_by = np.zeros((total, total)), np.zeros(total), np.zeros((inner.size, total))
    H[: len(x), : len(x)], g[: len(x)] = problem.believed, problem.pull_of_priors(x)
    for lane, variables in enumerate(_variables(problem, cut)):
        if lane % LANES == 0:  # so many at a time: their derivatives take no more memory in a day than in an hour
            some = slice(lane, lane + LANES)
            z_end[some], Z_end, y, Y = problem.simulator.kernel.linearise(
                begin[some], cut.segments[some], of_lanes[some], cut.reads, moving
            )
            held = Against(against.target[some], against.weight[some], against.robust)
            e, weight = held.weighted(y)
            misfit += held.misfit(y)
        k = lane % LANES
        of_p, others = slice(0, len(moving)), slice(len(moving), None)
        by = np.zeros((size, len(variables)))  # the lane's beginning by its variables
        if cut.first[lane]:
            by[:, of_p] = starts_by_p[cut.interval[lane]][:, moving]
            by[problem.loose, len(moving) + np.arange(len(problem.loose))] = 1.0
        else:
            by[:, others] = np.eye(size)
            gaps_by[variables[others] - len(x), variables[others]] -= 1.0
        J = (Y[k, :, :, :size] @ by).reshape(-1, len(variables))
        J[:, of_p] += Y[k, :, :, size:].reshape(len(J), -1)
        J *= weight[k].reshape(-1, 1)
        H[np.ix_(variables, variables)] += J.T @ J
        g[variables] += J.T @ e[k].ravel()
        if not cut.first[(lane + 1) % len(cut.first)]:
            end = Z_end[k, :, :size] @ by
            end[:, of_p] += Z_end[k, :, size:]
            gaps_by[np.ix_(np.sum(~cut.first[: lane + 1]) * size + np.arange(size), variables)] += end
    before = np.flatnonzero(~cut.first) - 1
    objective = 0.5 * float(np.sum(problem.prior_residuals(x) ** 2)) + misfit
    objective = objective if np.isfinite(objective) else np.inf
    return LiftedMotion(objective, (z_end[before] - inner).ravel(), g, gaps_by, H)


def _variables(problem: MotionProblem, cut: Lanes) -> Iterator[Index]:
    """Per lane, its variables: the parameters that move, and the free starts of its interval or its own node."""
    size, of_model, node = problem.trace.size, problem.model.size, 0
    for first, interval in zip(cut.first, cut.interval, strict=True):
        index = problem.layout.index[interval]
        if first:
            value = index[of_model:]
        else:
            value, node = problem.layout.size + node * size + np.arange(size), node + 1
        yield np.concatenate((index[problem.moving], value))


def _linearised(problem: MotionProblem, scale: Array, cut: Lanes) -> _Computed:
    """Everything Ipopt asks for at one point, in the program's units; the program, which holds it, is not held."""
    n, unknowns = len(scale), problem.layout.size
    m = n - unknowns
    pattern = np.zeros((n, n), dtype=bool)
    pattern[: len(problem.believed), : len(problem.believed)] = problem.believed != 0.0
    pattern[np.arange(n), np.arange(n)] = True
    for variables in _variables(problem, cut):
        pattern[np.ix_(variables, variables)] = True
    columns, rows = np.nonzero(pattern.T)  # column by column, as CasADi stores them
    dense = [cs.Sparsity.dense(*shape) for shape in ((1, 1), (m, 1), (n, 1), (m, n))]
    of_H = cs.Sparsity.triplet(n, n, rows.tolist(), columns.tolist())

    def values(X: Array) -> list[cs.DM]:
        x = X * scale
        at = at_nodes(problem, x[:unknowns], x[unknowns:].reshape(-1, problem.trace.size))
        others = at.objective, at.gaps, at.gradient * scale, at.gaps_by * scale
        return [*(cs.DM(value) for value in others), cs.DM(of_H, at.H[rows, columns] * (scale[rows] * scale[columns]))]

    return _Computed("linearised", n, [*dense, of_H], values)


SAME = 2e-5
"""An optimum is confirmed when Ipopt improves the objective by less than this share."""
NEAR = 5e-3
"""Gradient, by unknowns in units of their curvature, at which an optimum of a network is confirmed: no weight by itself
would move by more than a two-hundredth of the standard deviation that it has where all others stay. Ipopt's steps are
those of Gauss-Newton, which gain slowly along a network's bent valleys; besides, the objective must hardly fall."""


@dataclass(frozen=True)
class IpoptVerdict:
    """What Ipopt said.

    Attributes
    ----------
    words : Ipopt's return status.
    iterations : its iterations.
    gradient : infinity norm of the dual infeasibility at the end.
    violation : largest gap of the constraints at the end, in the outputs' units.
    cpu_seconds : s.
    """

    words: str
    iterations: int
    gradient: float
    violation: float
    cpu_seconds: float


def ipopt(
    problem: Problem | MotionProblem, x: Array, *, max_iterations: int = 200, warm: bool = False, lifted: bool = True
) -> tuple[Solution, IpoptVerdict]:
    """Minimise a lifted least-squares problem with Ipopt.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) starting parameters; nodes start at a simulation where `warm`, else at the measurements.
    warm : x is believed to be the optimum: keep it where it is, close to bounds if it must be.
    lifted : closed loop, keep the nodes as unknowns; False eliminates them by simulation, which has the same optima
        and, with hundreds of weights, factorises twenty times faster.

    Returns
    -------
    Solution and Ipopt's verdict.
    """
    clock = time.process_time()
    program = _program(problem, x, lifted)
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.max_iter": max_iterations,
        "ipopt.tol": (NEAR if isinstance(program, Condensed) else 1e-4) if warm else 1e-6,
        "ipopt.linear_solver": "mumps",
        "ipopt.mu_strategy": "adaptive",
        "ipopt.fixed_variable_treatment": "make_parameter",
        "error_on_fail": False,
        "show_eval_warnings": False,  # a trial point beyond all bounds is Ipopt's affair; it shortens the step
        **program.derivatives,
    }
    if warm:
        options |= {
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_strategy": "monotone",
            "ipopt.mu_init": 1e-9,
            **{f"ipopt.warm_start_{kind}_push": 1e-9 for kind in ("bound", "slack_bound", "mult_bound")},
            **{f"ipopt.warm_start_{kind}_frac": 1e-9 for kind in ("bound", "slack_bound")},
        }
    solver = cs.nlpsol("ipopt", "ipopt", program.nlp, options)
    limited = np.clip(x, -UNLIMITED, UNLIMITED)
    scale = np.ones(program.size) if isinstance(program, Lifted) else program.scale
    low, high = (bound / scale for bound in bounds_of(problem, limited, program.size))
    start = program.start(limited, warm)
    if np.any(np.isnan([start, low, high])):
        where = Solution(x, problem.simulated_nodes(x), Status.NOT_FINITE, 0, np.inf, np.nan, ())
        return where, IpoptVerdict("Invalid number at the start", 0, np.nan, np.nan, time.process_time() - clock)
    result = solver(x0=start, lbx=low, ubx=high, lbg=0.0, ubg=0.0)
    stats = solver.stats()
    unknowns = np.clip((np.asarray(result["x"].full()).ravel() * scale)[: len(x)], *problem.bounds)
    unknowns[np.isinf(x)] = x[np.isinf(x)]
    same: LeastSquares = problem
    matched = same.simulated_nodes(unknowns)
    objective = same.objective(unknowns, matched)
    trajectory = stats.get("iterations", {})
    status = {
        "Solve_Succeeded": Status.CONVERGED,
        "Solved_To_Acceptable_Level": Status.CONVERGED,
        "Maximum_Iterations_Exceeded": Status.STEP_LIMIT,
        "User_Requested_Stop": Status.INTERRUPTED,
    }.get(stats["return_status"], Status.STALLED)
    solution = Solution(
        unknowns, matched, status, int(stats["iter_count"]), objective, np.nan, tuple(trajectory.get("obj", ()))
    )
    return solution, IpoptVerdict(
        words=stats["return_status"].replace("_", " "),
        iterations=int(stats["iter_count"]),
        gradient=float(trajectory.get("inf_du", [np.nan])[-1]),
        violation=float(trajectory.get("inf_pr", [np.nan])[-1]),
        cpu_seconds=time.process_time() - clock,
    )


def _program(problem: Problem | MotionProblem, x: Array, lifted: bool) -> Condensed | Lifted | MotionProgram:
    if isinstance(problem, MotionProblem):
        return MotionProgram(problem, x)
    return Lifted(problem) if problem.closed_loop and lifted else Condensed(problem, x)
