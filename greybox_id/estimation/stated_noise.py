"""How large sensor noise is: as the vehicle's file says, or as readings tell that are smoother than what they read."""

from __future__ import annotations

import numpy as np

from ..engine.simulation import FreeRuns
from ..shorthands import Array
from ..statistics import robust_sd, white_noise_sd
from ..vehicle import Vehicle
from .calibration import CAL


def stated_noise(bench: FreeRuns, vehicle: Vehicle | None, residuals: Array) -> tuple[Array, bool]:
    """Standard deviation of each channel's noise, (channels,), and whether all of them were stated.

    Parameters
    ----------
    bench : whose channels.
    vehicle : what is stated of its sensors; of a map with memory, what its training left, which holds in any case.
    residuals : (N, channels) of any model: a slow misfit does not count as noise.
    """
    stated = vehicle.noise if vehicle is not None else {}
    found, told = [], True
    for c, channel in enumerate(bench.channels):
        own = bench.counted[:, c]
        if not np.any(own):
            found.append(1.0)
            continue
        e = residuals[own, c]
        spread = robust_sd(e - np.median(e))
        held = bench.learnt or spread > CAL.too_large * stated.get(channel, 0.0)
        if channel in stated and held:
            found.append(stated[channel])
            continue
        told = told and channel in stated
        fast = white_noise_sd([bench.measured[rows, c] for rows in bench.rows])
        least = max(1e-9 * float(np.max(np.abs(bench.measured[own, c]))), 1e-12)
        found.append(1.0 if np.isnan(fast) else max(fast, least))
    return np.array(found), told
