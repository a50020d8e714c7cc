"""A motion problem as a nonlinear program over parameters, starts and nodes: multiple shooting.

The nodes are the states at the cuts; that each is where the lane before it ends is a constraint. Values and derivatives come
from the same kernel that Gauss-Newton uses, about nodes that need not match.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ..engine.motion.shooting import MotionProblem
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
        self._callback = _Linearised("linearised", self)
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
        return np.concatenate([x, nodes.ravel()]) / self.scale

    def evaluate(self, X: Array) -> tuple[float, Array, Array, Array, Array]:
        """Objective, constraints, gradient, constraints' Jacobian and Gauss-Newton Hessian."""
        values = X * self.scale
        x, nodes = values[: self.unknowns], values[self.unknowns :].reshape(len(self._inner), self.states)
        f, g, df, dg, H = self.problem.at_nodes(x, nodes)
        return f, g, df * self.scale, dg * self.scale, H * np.outer(self.scale, self.scale)


class _Linearised(cs.Callback):  # type: ignore[misc]
    """Everything Ipopt asks for at one point, computed once."""

    def __init__(self, name: str, program: MotionProgram) -> None:
        cs.Callback.__init__(self)
        self._program = program
        self._last: tuple[Array, list[cs.DM]] | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 5

    def get_sparsity_in(self, _: int) -> cs.Sparsity:
        return cs.Sparsity.dense(self._program.size, 1)

    def get_sparsity_out(self, k: int) -> cs.Sparsity:
        n, m = self._program.size, self._program.constraints
        return cs.Sparsity.dense(*((1, 1), (m, 1), (n, 1), (m, n), (n, n))[k])

    def eval(self, arguments: list[cs.DM]) -> list[cs.DM]:
        X = np.asarray(arguments[0].full()).ravel()
        if self._last is None or not np.array_equal(self._last[0], X):
            self._last = (X, [cs.DM(value) for value in self._program.evaluate(X)])
        return self._last[1]
