"""Where in speed and lateral acceleration the data lie."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameter import Array
from ...recording import Recording
from ..recordings import Seen, of_role
from .density import density, scale_of_counts
from .sheet import Sheet
from .style import ZERO

WITHIN = (0.001, 0.999)
"""Quantiles of the samples at which the map ends."""
CELLS = (40, 26)
TITLES = {"train": "training", "validate": "validation"}


def excitation(recordings: Sequence[Seen]) -> Sheet | None:
    """Densities of samples over v_x and a_y, a panel for each role; None where speed or turning are not recorded."""
    points = {role: driven_points([one.recording for one in of_role(recordings, role)]) for role in TITLES}
    points = {role: own for role, own in points.items() if len(own)}
    if not points:
        return None
    every = np.vstack(list(points.values()))
    v_x, a_y = ((float(low), float(high)) for low, high in np.quantile(every, WITHIN, axis=0).T)
    sheet, counts = Sheet((120.0,), len(points)), []
    for ax, (role, own) in zip(sheet.grid[0], points.items(), strict=True):
        counts.append(density(ax, own[:, 0], own[:, 1], v_x, a_y, CELLS))
        ax.axhline(0.0, **ZERO)
        ax.set(title=TITLES[role], xlabel="v_x [m/s]", xlim=v_x, ylim=a_y)
    scale_of_counts(ax, max(counts))
    sheet.first().set_ylabel("a_y [m/s²], left positive")
    return sheet


def driven_points(recordings: Sequence[Recording]) -> Array:
    """(n, 2) speed and lateral acceleration of all samples that hold both; v_x times yaw rate stands for an a_y."""
    parts = [np.empty((0, 2))]
    for recording in recordings:
        if "v_x" not in recording:
            continue
        if "a_y" in recording:
            parts.append(np.column_stack([recording["v_x"], recording["a_y"]]))
        elif "yaw_rate" in recording:
            parts.append(np.column_stack([recording["v_x"], recording["v_x"] * recording["yaw_rate"]]))
    whole = np.vstack(parts)
    return whole[np.all(np.isfinite(whole), axis=1)]
