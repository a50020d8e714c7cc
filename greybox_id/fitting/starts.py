"""Where fits of motion models start from."""

from __future__ import annotations

import numpy as np

from ..motion_model import MotionModel
from ..parameter import Array
from .how import How

SPREAD = 0.7
"""Standard deviation of the logarithm of positive parameters over random starts."""


def starting_points(model: MotionModel, how: How) -> list[Array]:
    """Nominal values, and others drawn about them, (parameters,) each: positive parameters keep their sign."""
    random = np.random.default_rng(how.seed)
    low = np.concatenate([np.full(p.size, p.bounds[0]) for p in model.parameters])
    high = np.concatenate([np.full(p.size, p.bounds[1]) for p in model.parameters])
    free = np.concatenate([np.full(p.size, not p.fixed) for p in model.parameters])
    points = [model.values]
    for _ in range(how.starts - 1):
        draw = random.standard_normal(model.size)
        factor = np.exp(SPREAD * draw)
        with np.errstate(invalid="ignore"):
            moved = np.where(low >= 0, model.values * factor, model.values + SPREAD * np.abs(model.values) * draw)
        moved = np.where(np.isfinite(moved), moved, model.values)
        points.append(np.where(free, np.clip(moved, low, high), model.values))
    return points
