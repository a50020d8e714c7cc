"""Time along several recordings, one after the other."""

from __future__ import annotations

import numpy as np

from ..shorthands import Array


def running(time: Array) -> Array:
    """Time that goes on where it starts again, as it does between recordings."""
    steps = np.diff(time, prepend=time[0] if len(time) else 0.0)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 1.0
    if np.all(steps >= 0):
        return time
    return np.asarray(time[0] + np.cumsum(np.where(steps < 0, usual, steps)))
