"""The drawing of a designed manoeuvre: its path in the arena and its commands over time."""

from __future__ import annotations

import numpy as np

from ..gap.design.plan import Design
from .figures.sheet import BLUE, DASHED, INK, ORANGE, PALE, Sheet, band, look

TALL, LOW = 210.0, 62.0
"""Height of the path's panel and of the others, points."""
ABREAST = 9
"""Number of cross-sections of the path's corridor that are drawn; at most one per second."""


def manoeuvre(design: Design) -> Sheet:
    """Path in the arena with its 95 % corridor; steering, speed and yaw rate over time."""
    table = design.table()
    outline = np.vstack([design.arena.outline, design.arena.outline[:1]])
    x, y = table["x"].to_numpy(), table["y"].to_numpy()
    back = np.array([0.0, design.run_up])
    c, s = np.cos(design.placement.yaw), np.sin(design.placement.yaw)
    rows = np.unique(np.linspace(0, len(x) - 1, 4 * ABREAST).astype(int))
    sheet = Sheet((TALL, LOW, LOW, LOW))
    path, steering, *others = sheet.grid[:, 0]
    path.plot(*outline.T, **look(INK, 1.0, "arena"))
    ends = zip(*(table[name].to_numpy()[rows] for name in ("x_low", "x_high", "y_low", "y_high")), strict=True)
    for k, (left, right, low, high) in enumerate(ends):
        words = "95 % corridor" if k == 0 else None
        path.plot([left, right, right, left, left], [low, low, high, high, low], **look(ORANGE, 0.6, words))
    path.plot(x[0] - back * c, y[0] - back * s, **look(PALE, label="run-up", dashes=DASHED))
    path.plot(x, y, **look(BLUE, 1.4, "planned path"))
    path.plot(x[:1], y[:1], **look(BLUE, dots=2.5))
    path.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", adjustable="datalim")
    time = table["time"].to_numpy()
    steering.plot(time, table["steer"].to_numpy(), **look(BLUE))
    steering.set(xlabel="time [s]", ylabel="steer [rad]")
    for ax, (name, label) in zip(others, (("v_x", "v_x [m/s]"), ("yaw_rate", "yaw rate [rad/s]")), strict=True):
        band(ax, time, table[f"{name}_low"].to_numpy(), table[f"{name}_high"].to_numpy(), ORANGE)
        ax.plot(time, table[name].to_numpy(), **look(BLUE))
        ax.set(xlabel="time [s]", ylabel=label)
    return sheet
