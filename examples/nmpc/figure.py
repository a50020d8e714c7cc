"""A figure of a race: where the vehicle went, and how far off its path, with each model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from lap import Lap
from track import Track

from greybox_id.files import replacing

COLOURS = {"nominal": "tab:red", "closed": "tab:blue", "true": "0.6"}


def draw(track: Track, laps: Mapping[str, Lap], file: Path) -> None:
    """Write a figure of laps on a track."""
    figure = plt.figure(figsize=(12, 7), layout="constrained")
    panels = figure.subplot_mosaic([["map", "path"], ["map", "speed"], ["map", "use"]], width_ratios=[1, 1.2])
    for side in (-1, 1):
        edge = side * track.half_width
        panels["map"].plot(track.x - edge * np.sin(track.yaw), track.y + edge * np.cos(track.yaw), "0.8", lw=0.8)
        panels["path"].axhline(1e3 * edge, color="0.8", lw=0.8)
    panels["speed"].plot(track.s, track.speed, "0.8", lw=2, label="wanted")
    for name, own in reversed(laps.items()):
        style = {"color": COLOURS[name], "lw": 3 if name == "true" else 1, "label": name}
        panels["map"].plot(own.x, own.y, **style)
        panels["path"].plot(own.s, 1e3 * own.e_y, **style)
        panels["speed"].plot(own.s, track.line("speed", own.s)[0] + own.speed_error, **style)
        panels["use"].plot(own.s, own.use, **style)
    panels["map"].set(aspect="equal", xlabel="x, m", ylabel="y, m")
    panels["path"].set(ylabel="lateral error, mm")
    panels["speed"].set(ylabel="speed, m/s")
    panels["use"].set(ylabel="grip used, 1", xlabel="along the track, m")
    panels["speed"].legend(fontsize="small")
    with replacing(file) as beside:
        figure.savefig(beside, dpi=150)
    plt.close(figure)
