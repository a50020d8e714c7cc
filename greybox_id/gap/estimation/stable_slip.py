"""Slip angles with which integration steps stay stable, however slow or stiff a simulated vehicle becomes.

Sideslip and yaw rate settle at a rate in proportion to stiffness over inertia and speed. Runs are cut into steps by
measured speeds and stated parameters; a simulation that is slower or stiffer would need shorter ones: the explicit
method becomes unstable, tyres saturate, and the result is noise that any change redraws. So slip angles are those of a
vehicle that is no slower than its steps are stable for. It settles within about a step instead of less; where it
settles stays the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import casadi as cs
import numpy as np

from ...base.shorthands import Array
from ...engine.motion.schedule import STABLE, MotionRun, segments_of_rows
from ...models.model import Combination, Symbol
from ...models.motion_model import MotionModel, Quantities
from ...models.smooth import forward_speed

STEP = "step_length"
"""Name of the input that carries how long the steps of a row are, s."""
SLIPS = ("alpha_f", "alpha_r")
NEEDED = ("stiffness_f", "stiffness_r", "grip_f", "grip_r", "C_alpha_f", "C_alpha_r", "m", "I_z", "l_f", "l_r")
"""What determines how fast a vehicle settles: quantities, combinations and parameters."""


def with_stable_slip(model: MotionModel) -> MotionModel:
    """The model with stable slip angles; unchanged where it has no slip angles, or its stiffnesses are unknown.

    Steps of no length, as in recordings without `STEP`, change nothing.
    """
    combinations = {item.name: item for item in model.combinations}
    known = {*model.quantities, *combinations, *(parameter.name for parameter in model.parameters)}
    if not {*SLIPS, *NEEDED} <= known:
        return model

    def followed(alpha: Symbol, q: Quantities) -> Symbol:
        speed = forward_speed(q.x.v_x if hasattr(q.x, "v_x") else q.u.v_x)
        return alpha * speed / cs.fmax(speed, _rate(combinations, q) * getattr(q.u, STEP) / STABLE)

    result = model.altered(**dict.fromkeys(SLIPS, followed))
    defaults = MappingProxyType({**result.defaults, STEP: 0.0})
    return replace(result, inputs=(*result.inputs, STEP), defaults=defaults)


def _rate(combinations: Mapping[str, Combination], q: Quantities) -> Symbol:
    """Rate at which the faster mode of sideslip and yaw rate settles, times the speed, m/s^2."""
    p = q.p
    front, rear = (
        combinations[f"C_alpha_{axle}"].of(p)
        * cs.fmax(getattr(q.before, f"stiffness_{axle}"), 1)
        * cs.fmax(getattr(q.before, f"grip_{axle}"), 1)  # with some tyres grip raises the slope, too
        for axle in "fr"
    )
    slides, turns = (front + rear) / p.m, (p.l_f**2 * front + p.l_r**2 * rear) / p.I_z
    coupled = (p.l_f * front - p.l_r * rear) ** 2 / (p.m * p.I_z)
    return (slides + turns) / 2 + cs.sqrt(((slides - turns) / 2) ** 2 + coupled)


def with_step_lengths(model: MotionModel, run: MotionRun, longest: float | Array) -> MotionRun:
    """The run with the length of the steps that each of its rows is cut into as an input, at most `longest`, s."""
    if STEP not in model.inputs:
        return run
    at, inputs, held = model.inputs.index(STEP), run.inputs.copy(), run.held.copy()
    steps = np.append(np.diff(run.time), run.sample_time)
    inputs[:, at], held[at] = steps / segments_of_rows(run, longest), True
    return replace(run, inputs=inputs, held=held)
