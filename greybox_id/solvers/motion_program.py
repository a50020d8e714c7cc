"""A motion problem as a nonlinear program over parameters, starts and nodes: multiple shooting.

The nodes are the states at the cuts; that each is where the lane before it ends is a constraint. Values and derivatives
come from the same kernel that Gauss-Newton uses, about nodes that need not match.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import casadi as cs
import numpy as np

from ..engine.motion.lanes import Lanes
from ..engine.motion.runs import Index
from ..engine.motion.shooting import MotionProblem, SimulatedRuns
from ..parameter import Array


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
        self._callback = _Linearised("linearised", self, nodes.cut)
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

    def evaluate(self, X: Array) -> LiftedMotion:
        """Everything in the program's own units."""
        values, scale = X * self.scale, self.scale
        x, nodes = values[: self.unknowns], values[self.unknowns :].reshape(len(self._inner), self.states)
        f, gaps, g, gaps_by, H = at_nodes(self.problem, x, nodes)
        return LiftedMotion(f, gaps, g * scale, gaps_by * scale, H * np.outer(scale, scale))


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


def at_nodes(problem: MotionProblem, x: Array, inner: Array) -> LiftedMotion:
    """The lifted problem at nodes that need not match.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,).
    inner : (cuts, nz) states at the cuts.
    """
    lanes, cut = problem.lanes(x)
    p, size, moving = problem.of_intervals(x), problem.trace.size, problem.moving
    starts, starts_by_p = problem.starts(x)
    begin = np.empty((len(cut.interval), size))
    begin[cut.first], begin[~cut.first] = starts, inner
    z_end, Z_end, y, Y = problem.simulator.kernel.linearise(begin, cut.segments, p[cut.interval], cut.reads, moving)
    nodes = SimulatedRuns(lanes, cut, begin, cut.gathered(y))
    e, weight = (cut.scattered(own) for own in problem.targets.weighted(nodes.y, nodes.taken))
    total = len(x) + inner.size
    H, g, gaps_by = np.zeros((total, total)), np.zeros(total), np.zeros((inner.size, total))
    H[: len(x), : len(x)], g[: len(x)] = problem.believed, problem.pull_of_priors(x)
    for lane, variables in enumerate(_variables(problem, cut)):
        of_p, others = slice(0, len(moving)), slice(len(moving), None)
        by = np.zeros((size, len(variables)))  # the lane's beginning by its variables
        if cut.first[lane]:
            by[:, of_p] = starts_by_p[cut.interval[lane]][:, moving]
            by[problem.loose, len(moving) + np.arange(len(problem.loose))] = 1.0
        else:
            by[:, others] = np.eye(size)
            gaps_by[variables[others] - len(x), variables[others]] -= 1.0
        J = (Y[lane, :, :, :size] @ by).reshape(-1, len(variables))
        J[:, of_p] += Y[lane, :, :, size:].reshape(len(J), -1)
        J *= weight[lane].reshape(-1, 1)
        H[np.ix_(variables, variables)] += J.T @ J
        g[variables] += J.T @ e[lane].ravel()
        if not cut.first[(lane + 1) % len(cut.first)]:
            end = Z_end[lane, :, :size] @ by
            end[:, of_p] += Z_end[lane, :, size:]
            gaps_by[np.ix_(np.sum(~cut.first[: lane + 1]) * size + np.arange(size), variables)] += end
    before = np.flatnonzero(~cut.first) - 1
    return LiftedMotion(problem.objective(x, nodes), (z_end[before] - inner).ravel(), g, gaps_by, H)


def _variables(problem: MotionProblem, cut: Lanes) -> Iterator[Index]:
    """Per lane, its variables: the parameters that move, and the free starts of its interval or its own node."""
    size, of_model, node = problem.trace.size, problem.model.size, 0
    for first, interval in zip(cut.first, cut.interval, strict=True):
        index = problem.layout.index[interval]
        if first:
            own = index[of_model:]
        else:
            own, node = problem.layout.size + node * size + np.arange(size), node + 1
        yield np.concatenate((index[problem.moving], own))


class _Linearised(cs.Callback):  # type: ignore[misc]
    """Everything Ipopt asks for at one point, computed once."""

    def __init__(self, name: str, program: MotionProgram, cut: Lanes) -> None:
        cs.Callback.__init__(self)
        self._program = program
        problem, n, m = program.problem, program.size, program.constraints
        pattern = np.zeros((n, n), dtype=bool)
        pattern[: len(problem.believed), : len(problem.believed)] = problem.believed != 0.0
        pattern[np.arange(n), np.arange(n)] = True
        for variables in _variables(problem, cut):
            pattern[np.ix_(variables, variables)] = True
        self._columns, self._rows = np.nonzero(pattern.T)  # column by column, as CasADi stores them
        dense = [cs.Sparsity.dense(*shape) for shape in ((1, 1), (m, 1), (n, 1), (m, n))]
        self._patterns = [*dense, cs.Sparsity.triplet(n, n, self._rows.tolist(), self._columns.tolist())]
        self._last: tuple[Array, list[cs.DM]] | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 5

    def get_sparsity_in(self, _: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self._program.size, 1)

    def get_sparsity_out(self, k: int) -> cs.Sparsity:
        return self._patterns[k]

    def eval(self, arguments: list[cs.DM]) -> list[cs.DM]:
        X = np.asarray(arguments[0].full()).ravel()
        if self._last is None or not np.array_equal(self._last[0], X):
            *others, H = self._program.evaluate(X)
            values = cs.DM(self._patterns[-1], H[self._rows, self._columns])
            self._last = (X, [*(cs.DM(value) for value in others), values])
        return self._last[1]
