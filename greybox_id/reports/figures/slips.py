"""Lateral force of each axle over its slip angle, as a density of samples."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...parameter import Array
from ..plot.figure import Figure, Panel
from ..plot.marks import Curve
from ..plot.palette import ORANGE, Line
from ..plot.scale import Axis
from .density import density

AXLES = {"f": "front", "r": "rear"}
BINS = 60
REACH = 0.998
"""Of the samples, in both directions."""
KILO = 1000.0
"""Forces from here on, N, are drawn in kN."""


def forces_over_slip(values: Mapping[str, Array]) -> Figure | None:
    """One panel for each axle; None for models without axle forces and slip angles."""
    wanted = [f"{kind}{axle}" for kind in ("alpha_", "F_y") for axle in AXLES]
    if not all(name in values for name in wanted):
        return None
    panels = []
    largest = max(float(np.nanquantile(np.abs(values[f"F_y{axle}"]), REACH)) for axle in AXLES)
    scale, unit = (1000.0, "kN") if largest >= KILO else (1.0, "N")
    for axle, where in AXLES.items():
        pairs = np.column_stack([values[f"alpha_{axle}"], values[f"F_y{axle}"] / scale])
        slip, force = pairs[np.all(np.isfinite(pairs), axis=1)].T
        ends = [max(float(np.quantile(np.abs(a), REACH)), 1e-6) * 1.1 for a in (slip, force)]
        area = ((-ends[0], ends[0]), (-ends[1], ends[1]))
        middle, median = _medians(slip, force, ends[0])
        marks = (
            density(slip, force, *area, (BINS, BINS)),
            Curve(middle, median, Line(ORANGE, width=1.2, words="median")),
        )
        panels.append(
            Panel(
                marks, Axis(f"slip angle alpha_{axle} [rad]", *area[0]),
                Axis(f"lateral force F_y{axle} [{unit}]", *area[1]), f"{where} axle",
            )
        )  # fmt: skip
    return Figure((tuple(panels),), (150.0,))


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
