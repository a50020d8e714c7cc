"""Linearisation of a model of motion around a steady state, as a system of python-control."""

from __future__ import annotations

import warnings

import casadi as cs
import control
import numpy as np
from scipy.optimize import least_squares

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..engine.simulation import equations_of_motion
from ..export.equations import Equations
from ..models.model import Model

EXACT = 1e-15
"""Tolerances of the search for a steady state: machine precision."""
SETTLED = 1e-6
"""Largest rate of a state relative to its scale, 1/s, that counts as steady."""


def linearised(model: Model, v_x: float, steer: float = 0.0) -> control.StateSpace:
    """The linear system around the steady state at a speed [m/s] and a road-wheel angle [rad].

    dx/dt = A x + B u, y = C x + D u, in deviations from the steady state. A to D are derivatives of the model's own
    equations, with actuators and relaxed quantities as states. Pure delays are omitted.

    Raises
    ------
    BadInput : if the model is not one of equations of motion, or has no such steady state.
    """
    for name, value in (("v_x", v_x), ("steer", steer)):
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise BadInput(f"{name}: a finite number is needed, not {value!r:.40}.")
    if not v_x > 0:
        raise BadInput(f"v_x: a speed above zero is needed, in m/s, not {v_x!r:.40}.")
    equations = Equations(equations_of_motion(model, "; only these are linearised"), moving=())
    for what, seconds in equations.shifts().items():
        warnings.warn(f"The {what}, {seconds:.4g} s, is not in the linear system.", stacklevel=4)
    ode, output, none = equations.ode, equations.output, cs.DM.zeros(0)
    x, u = equations.x, equations.u
    rates, read = ode(x, u, none), output(x, u, none)
    jacobians = cs.Function(
        "jacobians", [x, u], [cs.jacobian(rates, x), cs.jacobian(rates, u), cs.jacobian(read, x), cs.jacobian(read, u)]
    )
    x_0, u_0 = _steady(equations, cs.Function("rates", [x, u], [rates]), v_x, steer)
    A, B, C, D = (np.asarray(jacobian.full()) for jacobian in jacobians(x_0, u_0))
    return control.ss(
        A, B, C, D,
        states=[state.name for state in equations.states],
        inputs=[item.name for item in equations.inputs],
        outputs=[output.name for output in equations.outputs],
        name=model.name,
    )  # fmt: skip


def _steady(equations: Equations, rates: cs.Function, v_x: float, steer: float) -> tuple[Array, Array]:
    """States and inputs of the steady state: v_x and steer as given, all others such that all rates are zero."""
    model = equations.model
    states, inputs = [state.name for state in equations.states], list(model.inputs)
    given = {"v_x": v_x, "steer": steer}
    x_0 = np.array([given.get(name, 0.0) for name in states])
    u_0 = np.array([given.get(name, model.defaults.get(name, 0.0)) for name in inputs])
    for k, actuator in enumerate(model.actuators, len(model.states)):  # equal to their commands
        x_0[k] = given.get(actuator.signal, 0.0)
    loose_x = [k for k, name in enumerate(states) if name != "v_x"]
    loose_u = [k for k, name in enumerate(inputs) if name == "drive"] if "v_x" in states else []
    scale = np.array([*(state.scale for state in model.states), *([1.0] * (len(states) - len(model.states)))])

    def scaled_rates(free: Array) -> Array:
        x, u = x_0.copy(), u_0.copy()
        x[loose_x], u[loose_u] = free[: len(loose_x)], free[len(loose_x) :]
        scaled: Array = np.asarray(rates(x, u).full(), dtype=float).ravel() / scale
        return scaled

    start = np.concatenate([x_0[loose_x], u_0[loose_u]])
    result = start
    if len(start):
        result = np.asarray(least_squares(scaled_rates, start, x_scale="jac", xtol=EXACT, ftol=EXACT, gtol=EXACT).x)
    if not np.max(np.abs(scaled_rates(result)), initial=0.0) < SETTLED:
        raise BadInput(f"{model.name} has no steady state at v_x = {v_x:g} m/s and steer = {steer:g} rad.")
    x_0[loose_x], u_0[loose_u] = result[: len(loose_x)], result[len(loose_x) :]
    return x_0, u_0
