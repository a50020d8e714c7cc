"""Steady states of equations of motion, and quantities in a steady state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as cs
import numpy as np

from ..base.shorthands import Array
from ..engine.motion.trace import MotionTrace
from ..models.motion_model import MotionModel
from ..models.parameter import Parameter

ROUNDS, SETTLED = 30, 1e-9
"""Most Newton steps to a steady state, and largest rates in it, in units of each state's scale per second."""
LONGEST_STEP = 1.0
"""Largest Newton step, in scales of the states."""


def without_memory(model: MotionModel, outputs: Sequence[str]) -> MotionModel:
    """The same model without delays, lags and sensors, with the given quantities as outputs."""
    return replace(
        model, outputs=tuple(outputs), delays=(), actuators=(), relaxations=(), sensors=(), latencies=()
    )  # fmt: skip


class OverSlip:
    """Lateral force over vertical load of one axle, as a function of its slip angle, with all effects on it.

    The vehicle drives straight at constant speed; the slip angles of both axles are given and equal.

    Parameters
    ----------
    model : must have the quantities alpha_f, alpha_r and F_y, F_z of the axle.
    suffix : of the axle, "f" or "r".
    v_x : speed, m/s.
    """

    def __init__(self, model: MotionModel, suffix: str, v_x: float) -> None:
        names = (f"F_y{suffix}", f"F_z{suffix}")
        bare = without_memory(model, names).with_parameters(Parameter(_SLIP, "rad", 0.0))
        slipping = bare.altered(**{name: lambda _, q: getattr(q.p, _SLIP) for name in ("alpha_f", "alpha_r")})
        trace = MotionTrace(slipping)
        slip, p = cs.SX.sym("slip"), cs.SX.sym("p", model.size)
        x = [v_x if name == "v_x" else 0.0 for name in trace.names]
        y = trace.output(cs.vertcat(*x), _segment(trace, {"v_x": v_x}), cs.vertcat(p, slip))
        self._share = cs.Function("share", [slip, p], [y[0] / y[1]])

    def __call__(self, slip: Array, p: Array) -> Array:
        """(n,) F_y / F_z at slip angles (n,) [rad] and parameters (parameters,)."""
        return np.asarray(self._share(slip.reshape(1, -1), p).full()).ravel()


def steady_turns(model: MotionModel, steer: Array, v_x: float) -> Array | None:
    """Yaw rates of steady turns at one speed, (n,) rad/s; NaN from the first one that is not found.

    Parameters
    ----------
    model : with steer as an input and v_x as an input or state; as a state it is kept constant by the drive.
    steer : (n,) road-wheel angles [rad], in increasing order: each turn starts from the previous one.
    v_x : speed, m/s.

    Returns
    -------
    None if the equations do not determine a steady turn: too few unknowns, or too many.
    """
    trace = MotionTrace(without_memory(model, ("yaw_rate",)))
    unknown = [state.name for state in model.states if state.name != "v_x"]
    unknown += ["drive"] if "v_x" in trace.names else []
    if len(unknown) != len(trace.names) or ("drive" in unknown and "drive" not in model.inputs):
        return None
    w, delta = cs.SX.sym("w", len(unknown)), cs.SX.sym("delta")
    variables = dict(zip(unknown, cs.vertsplit(w), strict=True)) | {"v_x": v_x, "steer": delta}
    x = cs.vertcat(*[variables[name] for name in trace.names])
    rates = trace.rates(x, _segment(trace, variables), model.values)
    newton = cs.Function("newton", [w, delta], [rates, cs.jacobian(rates, w)])
    scales = {state.name: state.scale for state in model.states}
    scale = np.array([scales.get(name, 1.0) for name in unknown])
    per_second = np.array([state.scale for state in model.states])
    result, at = np.full(len(steer), np.nan), np.zeros(len(unknown))
    for k, angle in enumerate(steer):
        settled = _settle(newton, at, float(angle), scale, per_second)
        if settled is None:
            break
        at = settled
        result[k] = at[unknown.index("yaw_rate")]
    return result


def _settle(newton: cs.Function, at: Array, steer: float, scale: Array, per_second: Array) -> Array | None:
    for _ in range(ROUNDS):
        rates, J = (np.asarray(value.full()) for value in newton(at, steer))
        residual = rates.ravel() / per_second
        if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(J))):
            return None
        if np.max(np.abs(residual)) < SETTLED:
            return at
        try:
            step = np.linalg.solve(J, -rates.ravel())
        except np.linalg.LinAlgError:
            return None
        at = at + step * min(1.0, LONGEST_STEP / max(float(np.max(np.abs(step / scale))), 1e-300))
    return None


def _segment(trace: MotionTrace, known: Mapping[str, object]) -> cs.SX:
    """A segment of zero length with inputs at the given values, or at their defaults."""
    model = trace.model
    values = [known.get(name, model.defaults.get(name, 0.0)) for name in model.inputs]
    rest = [0.0] * (trace.segment_size - 1 - len(values))
    return cs.vertcat(0.0, *values, *rest)


_SLIP = "slip_of_both_axles"
