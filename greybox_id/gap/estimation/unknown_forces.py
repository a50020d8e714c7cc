"""Unknown forces: the inputs by which model error acts on a motion model."""

from __future__ import annotations

from collections.abc import Callable

from ...models.model import Model, Symbol
from ...models.motion_model import MotionModel, Quantities
from ...models.parameter import Parameter

FORCES = {"F_yf": ("error_F_yf", "y"), "F_yr": ("error_F_yr", "y"), "F_drag": ("error_F_drag", "x")}
"""Quantity -> name of the unknown force that is added to it, and the direction whose amplitude it has."""
SCALES = {"F_yf": ("F_yf",), "F_yr": ("F_yr",), "F_drag": ("drive_force", "F_drag")}
"""Unknown force's quantity -> quantities whose sizes add up to the force that it is a share of."""


def knows_unknown_forces(model: Model) -> bool:
    """Whether a model has unknown forces."""
    return any(name in model for name, _ in FORCES.values())


def with_unknown_forces(model: MotionModel) -> MotionModel:
    """The model with an unknown force, zero for now, added to each of its forces in `FORCES`."""
    there = {force: name for force, (name, _) in FORCES.items() if force in model.quantities}
    if not there or "m" not in model:
        return model

    def added(name: str) -> Callable[[Symbol, Quantities], Symbol]:
        return lambda force, q: force + getattr(q.p, name)

    parameters = [
        Parameter(name, "N", 0.0, fixed=True, about=f"unknown part of {force}") for force, name in there.items()
    ]
    return model.with_parameters(*parameters).altered(**{force: added(name) for force, name in there.items()})
