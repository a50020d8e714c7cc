"""Lateral force of each axle over its slip angle, as a density of samples."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...parameter import Array
from .density import density
from .sheet import Sheet
from .style import ORANGE, look

AXLES = {"f": "front", "r": "rear"}
BINS = 60
REACH = 0.998
"""Of the samples, in both directions."""
KILO = 1000.0
"""Forces from here on, N, are drawn in kN."""


def forces_over_slip(values: Mapping[str, Array]) -> Sheet | None:
    """One panel for each axle; None for models without axle forces and slip angles."""
    wanted = [f"{kind}{axle}" for kind in ("alpha_", "F_y") for axle in AXLES]
    if not all(name in values for name in wanted):
        return None
    sheet = Sheet((150.0,), len(AXLES))
    largest = max(float(np.nanquantile(np.abs(values[f"F_y{axle}"]), REACH)) for axle in AXLES)
    scale, unit = (1000.0, "kN") if largest >= KILO else (1.0, "N")
    for ax, (axle, where) in zip(sheet.grid[0], AXLES.items(), strict=True):
        pairs = np.column_stack([values[f"alpha_{axle}"], values[f"F_y{axle}"] / scale])
        slip, force = pairs[np.all(np.isfinite(pairs), axis=1)].T
        ends = [max(float(np.quantile(np.abs(a), REACH)), 1e-6) * 1.1 for a in (slip, force)]
        area = ((-ends[0], ends[0]), (-ends[1], ends[1]))
        density(ax, slip, force, *area, (BINS, BINS))
        ax.plot(*_medians(slip, force, ends[0]), **look(ORANGE, 1.2, "median"))
        ax.set(xlabel=f"slip angle alpha_{axle} [rad]", xlim=area[0], ylabel=f"lateral force F_y{axle} [{unit}]",
               ylim=area[1], title=f"{where} axle")  # fmt: skip
    return sheet


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
