"""Figures of a race: where the vehicle went, and how far off its path, with each model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from lap import Lap

from greybox_id.base.files import write_atomically
from greybox_id.reports.figures.sheet import BLUE, DASHED, INK, ORANGE, PALE, Sheet, look
from greybox_lab.driving.racing.track import RaceTrack

LINES = {
    "true": look(INK, 2.2, "true effects"),
    "closed": look(BLUE, 1.4, "closed", dashes=DASHED),
    "nominal": look(ORANGE, 1.1, "nominal"),
}
WANTED, EDGE = look(PALE, 1.6, "wanted"), look(PALE, 0.7)


def draw(track: RaceTrack, laps: Mapping[str, Lap], folder: Path) -> None:
    """Write `map.svg` and `race.svg`: laps on a track, and along it."""
    seen = Sheet((260.0,))
    ax = seen.first()
    edges = [side * track.half_width for side in (-1, 1)]
    for e in edges:
        ax.plot(track.x - e * np.sin(track.yaw), track.y + e * np.cos(track.yaw), **EDGE)
    for name, line in LINES.items():
        ax.plot(laps[name].x, laps[name].y, **line)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", adjustable="datalim")
    write_atomically(folder / "map.svg", seen.svg("laps on the track"))

    along = Sheet((90.0, 90.0, 90.0), joined=True)
    off, speed, use = along.grid[:, 0]
    for e in edges:
        off.plot(track.s, np.full(len(track.s), 1e3 * e), **EDGE)
    speed.plot(track.s, track.speed, **WANTED)
    for name, line in LINES.items():
        own = laps[name]
        off.plot(own.s, 1e3 * own.e_y, **line)
        speed.plot(own.s, track.line("speed", own.s)[0] + own.speed_error, **line)
        use.plot(own.s, own.use, **line)
    off.set_ylabel("lateral error [mm]")
    speed.set_ylabel("speed [m/s]")
    use.set(xlabel="along the track [m]", ylabel="grip used [1]")
    write_atomically(folder / "race.svg", along.svg("lateral error, speed and use of grip along the track"))
