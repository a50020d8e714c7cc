"""Where in speed and lateral acceleration the data lie."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameter import Array
from ...recording import Recording
from ..plot.figure import Figure, Panel
from ..plot.marks import Mark, Rule
from ..plot.scale import Axis
from ..recordings import Seen, of_role
from .density import counts_of, density

WITHIN = (0.001, 0.999)
"""Quantiles of the samples at which the map ends."""
CELLS = (40, 26)
TITLES = {"train": "training", "validate": "validation"}


def excitation(recordings: Sequence[Seen]) -> Figure | None:
    """Densities of samples over v_x and a_y, a panel for each role; None where speed or turning are not recorded."""
    points = {role: driven_points([one.recording for one in of_role(recordings, role)]) for role in TITLES}
    points = {role: own for role, own in points.items() if len(own)}
    if not points:
        return None
    every = np.vstack(list(points.values()))
    v_x, a_y = ((float(low), float(high)) for low, high in np.quantile(every, WITHIN, axis=0).T)
    most = max(points.values(), key=len)
    shades = counts_of(most[:, 0], most[:, 1], v_x, a_y, CELLS)
    panels = []
    for number, (role, own) in enumerate(points.items()):
        marks: tuple[Mark, ...] = (density(own[:, 0], own[:, 1], v_x, a_y, CELLS), Rule(0.0))
        last = number == len(points) - 1
        panels.append(
            Panel(
                marks, Axis("v_x [m/s]", *v_x), Axis("a_y [m/s²], left positive" if not number else "", *a_y),
                TITLES[role], shades if last else None,
            )
        )  # fmt: skip
    return Figure((tuple(panels),), (120.0,))


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
