"""Random points at which an export is compared with its equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..base.shorthands import Array
from .equations import Equations, Named

FAST, AT_REST = 25.0, 0.1
"""Highest speed, m/s, and the share of points at standstill."""
SHORTEST, LONGEST = 1e-3, 0.05
"""Range of steps, s."""
SPREAD = 0.1
"""Standard deviation of the logarithm of parameters about their values."""
USUAL = {
    "v_y": 0.5, "yaw_rate": 0.5, "steer": 0.15, "ax_cmd": 3.0, "motor_current": 10.0, "road_slope": 0.05, "roll": 0.05,
}  # fmt: skip
"""Standard deviations of states and inputs by name, SI."""
BY_UNIT = {"N": 2000.0, "m/s": 0.5, "rad": 0.1, "rad/s": 0.5, "m/s^2": 3.0}
ACCELERATION = 3.0
"""Standard deviation of the acceleration by the drive, m/s^2."""


def points(equations: Equations, count: int, seed: int = 0) -> Mapping[str, Array]:
    """Random states, inputs, parameters and steps.

    Returns
    -------
    x (count, states), u (count, inputs), p (count, parameters), dt (count,).
    """
    rng = np.random.default_rng(seed)
    x, u = _random(equations.states, count, rng), _random(equations.inputs, count, rng)
    for k, item in enumerate(equations.inputs):
        if item.name == "drive" and "force_per_unit" in equations.model and "m" in equations.model:
            per_unit = float(equations.model["force_per_unit"].array / equations.model["m"].array)
            u[:, k] = ACCELERATION / max(per_unit, 1e-9) * rng.standard_normal(count)
    rest = rng.random(count) < AT_REST
    x[rest], u[rest] = 0.0, 0.0  # also tests limits and signs at zero
    p = equations.values * np.exp(SPREAD * rng.standard_normal((count, len(equations.parameters))))
    return {"x": x, "u": u, "p": p, "dt": rng.uniform(SHORTEST, LONGEST, count)}


def _random(entries: Sequence[Named], count: int, rng: np.random.Generator) -> Array:
    columns = [
        rng.uniform(0.0, FAST, count)
        if entry.name == "v_x"
        else USUAL.get(entry.name, BY_UNIT.get(entry.unit, 1.0)) * rng.standard_normal(count)
        for entry in entries
    ]
    return np.column_stack(columns) if columns else np.empty((count, 0))
