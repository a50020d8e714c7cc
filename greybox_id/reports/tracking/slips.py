"""Lateral force of each axle over its slip angle, as a density of samples."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ...filters import Track
from ...parameter import Array
from ..figures.style import DENSITY, ORANGE, canvas, look

AXLES = {"f": "front", "r": "rear"}
BINS = 60
REACH = 0.998
"""Of the samples, in both directions."""


def forces_over_slip(found: Track) -> Figure | None:
    """One panel for each axle; None for models without axle forces and slip angles."""
    wanted = [f"{kind}{axle}" for kind in ("alpha_", "F_y") for axle in AXLES]
    if not all(name in found.values for name in wanted):
        return None
    with look():
        figure = canvas(2.9)
        panels = figure.subplots(1, 2, sharey=True)
        for axes, (axle, where) in zip(panels, AXLES.items(), strict=True):
            slip, force = found.values[f"alpha_{axle}"], found.values[f"F_y{axle}"] / 1000.0
            ends = [max(float(np.quantile(np.abs(a), REACH)), 1e-6) * 1.1 for a in (slip, force)]
            axes.hist2d(
                slip, force, bins=BINS, range=[(-ends[0], ends[0]), (-ends[1], ends[1])], cmap=DENSITY, norm=LogNorm(),
                rasterized=True,
            )  # fmt: skip
            middle, median = _medians(slip, force, ends[0])
            axes.plot(middle, median, color=ORANGE, linewidth=1.2, label="median")
            axes.set_title(f"{where} axle")
            axes.set_xlabel(f"slip angle $\\alpha_{axle}$ [rad]")
        panels[0].set_ylabel("lateral force $F_y$ [kN]")
        panels[0].legend(loc="upper left")
    return figure


def _medians(slip: Array, force: Array, reach: float) -> tuple[Array, Array]:
    """Median force in bins of slip that hold enough samples."""
    edges = np.linspace(-reach, reach, BINS // 2 + 1)
    number = np.digitize(slip, edges) - 1
    middle, median = [], []
    for k in range(len(edges) - 1):
        own = force[number == k]
        if len(own) >= 10:
            middle.append((edges[k] + edges[k + 1]) / 2)
            median.append(np.median(own))
    return np.array(middle), np.array(median)
