"""The fitting problem of a motion model as a program for Ipopt: parameters, and nodes where lanes begin."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import casadi as cs
import numpy as np

from ...base.shorthands import Array, Index
from ..kernel import Against
from ..motion.lanes import Lanes
from ..motion.shooting import LANES, MotionProblem
from .programs import Computed


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


def _linearised(problem: MotionProblem, scale: Array, cut: Lanes) -> Computed:
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

    def values(X: Array) -> list[Array]:
        x = X * scale
        at = at_nodes(problem, x[:unknowns], x[unknowns:].reshape(-1, problem.trace.size))
        others = at.objective, at.gaps, at.gradient * scale, at.gaps_by * scale
        return [*(np.ravel(value, "F") for value in others), at.H[rows, columns] * (scale[rows] * scale[columns])]

    return Computed("linearised", n, [*dense, of_H], values)
