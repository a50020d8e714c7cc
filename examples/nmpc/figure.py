"""Figures of a race: where the vehicle went, and how far off its path, with each model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from lap import Lap
from track import Track

from greybox_id.files import write_atomically
from greybox_id.reports.plot.figure import Figure, Panel
from greybox_id.reports.plot.marks import Curve
from greybox_id.reports.plot.palette import BLUE, DASHED, INK, ORANGE, PALE, Line
from greybox_id.reports.plot.scale import Axis

LINES = {
    "true": Line(INK, width=2.2, words="true effects"),
    "closed": Line(BLUE, DASHED, 1.4, "closed"),
    "nominal": Line(ORANGE, width=1.1, words="nominal"),
}
WANTED, EDGE = Line(PALE, width=1.6, words="wanted"), Line(PALE, width=0.7)


def draw(track: Track, laps: Mapping[str, Lap], folder: Path) -> None:
    """Write `map.svg` and `race.svg`: laps on a track, and along it."""
    sides = [side * track.half_width for side in (-1, 1)]
    edges = [Curve(track.x - e * np.sin(track.yaw), track.y + e * np.cos(track.yaw), EDGE) for e in sides]
    paths = [Curve(laps[name].x, laps[name].y, line) for name, line in LINES.items()]
    seen = Panel((*edges, *paths), Axis("x [m]"), Axis("y [m]"), equal=True)
    write_atomically(folder / "map.svg", Figure(((seen,),), (260.0,)).svg("laps on the track"))

    off = [Curve(own.s, 1e3 * own.e_y, LINES[name]) for name, own in _in_order(laps)]
    off += [Curve(track.s, np.full(len(track.s), 1e3 * e), EDGE) for e in sides]
    speed = [
        Curve(own.s, track.line("speed", own.s)[0] + own.speed_error, LINES[name]) for name, own in _in_order(laps)
    ]
    use = [Curve(own.s, own.use, LINES[name]) for name, own in _in_order(laps)]
    along = Axis("along the track [m]")
    rows = (
        (Panel(tuple(off), along, Axis("lateral error [mm]")),),
        (Panel((Curve(track.s, track.speed, WANTED), *speed), along, Axis("speed [m/s]")),),
        (Panel(tuple(use), along, Axis("grip used [1]")),),
    )
    figure = Figure(rows, (90.0, 90.0, 90.0), joined=True)
    write_atomically(folder / "race.svg", figure.svg("lateral error, speed and use of grip along the track"))


def _in_order(laps: Mapping[str, Lap]) -> list[tuple[str, Lap]]:
    return [(name, laps[name]) for name in LINES]
