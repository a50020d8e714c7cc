"""Speed profile of a closed line."""

from __future__ import annotations

import numpy as np

from greybox_id.base.shorthands import Array


def speed_profile(
    curvature: Array, spacing: float, *, grip: float, drive: float, brake: float, top_speed: float
) -> Array:
    """Largest speeds, m/s, on a closed line, (n,): limited by the drive in a forward pass, by brakes in a backward
    pass.

    The grip limits the speed at each point; changes of speed are limited by what the friction ellipse leaves.

    Parameters
    ----------
    curvature : (n,) 1/m, at equidistant points.
    spacing : m, between them.
    grip, drive, brake : largest lateral, forward and backward accelerations, m/s^2.
    top_speed : m/s.
    """
    v = np.minimum(top_speed, np.sqrt(grip / np.maximum(np.abs(curvature), 1e-9)))
    n = len(v)
    for direction, a_x in ((1, drive), (-1, brake)):
        for k in range(2 * n):  # twice around, so that the limits hold across the start
            here, there = direction * k % n, direction * (k + 1) % n
            left = max(0.0, 1.0 - (v[here] ** 2 * curvature[here] / grip) ** 2) ** 0.5
            v[there] = min(v[there], (v[here] ** 2 + 2.0 * spacing * a_x * left) ** 0.5)
    return np.asarray(v, dtype=float)
