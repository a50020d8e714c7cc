"""What came of the loop, as a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from greybox_id.base.numbers import percent, quantity
from greybox_id.base.version import __version__
from greybox_id.reports.document import Document, Drawing, Table, Text, titled
from greybox_id.reports.figures.sheet import BLUE, INK, ORANGE, PALE, PURPLE, Sheet, look

from .scene import effect_words

HEIGHT = 150.0
"""Of the figure's axes, points."""
COLOURS = (PALE, ORANGE, BLUE, PURPLE, INK)
"""Of cycles, in turn."""


def demo_report(demo: Mapping[str, Any]) -> Document:
    """The report of a demo, of what came of it with traces."""
    parts = (
        Text(
            "A 1:10 car in simulation has effects that its vehicle file does not state: "
            f"{effect_words(demo['withheld'])}. Neither the diagnosis nor the driver knows these effects. The "
            "simulated car "
            "shares no code with the models of the diagnosis and the driver.",
            small=False,
        ),
        *titled("Cycles", _cycles(demo["cycles"])),
        *titled("Path error along the track", _path_errors(demo["cycles"])),
        *titled("Arms", Text(
            "How each driver performs at the end. base: before any data. nominal: after as many steps of learning "
            f"as the loop took, on the vehicle file alone. {demo['scene']['arm']}: after the loop. oracle: after "
            "learning with the true effects; absent if no model has them."
        ), _arms(demo["arms"])),
    )  # fmt: skip
    about = "Drive, identify, diagnose, learn, swap."
    return Document("The loop", about, "the loop", f"greybox-id {__version__}", parts)


def _cycles(cycles: Sequence[Mapping[str, Any]]) -> Table:
    rows = []
    for k, one in enumerate(cycles, 1):
        named = "; ".join(
            f"{cause['effect']} {quantity(cause['magnitude'], cause['unit'])} ({cause['probability']:.2f})"
            + ("" if cause["effect"] in one["applied"] else ", not applied")
            for cause in one["named"]
        )
        swapped = "swapped" if one["swapped"] else f"kept: {one['reason']}"
        driven = (
            _mm(one["path_error_rms"]),
            _mm(one["path_error_foretold"]),
            lap_words(one["lap_time"]),
            str(one["crashes"]),
        )
        cap, seconds = percent(one["cap"]), f"{one['seconds']:.0f}"
        rows.append((str(k), str(one["rows"]), cap, *driven, named or "nothing", swapped, seconds))
    heads = (
        "cycle",
        "rows",
        "grip used",
        "path error",
        "foretold",
        "lap",
        "crashes",
        "named (probability)",
        "policy",
        "time, s",
    )
    return Table(heads, tuple(rows), "rrrrrrrLLr")


def _path_errors(cycles: Sequence[Mapping[str, Any]]) -> Drawing | Text:
    """Lateral error over distance."""
    if not any(len(one["trace"]["s"]) > 1 for one in cycles):
        return Text("Nothing was driven.")
    sheet = Sheet((HEIGHT,))
    ax = sheet.first()
    for k, one in enumerate(cycles):
        errors = 1e3 * np.array(one["trace"]["e_y"])
        ax.plot(one["trace"]["s"], errors, **look(COLOURS[k % len(COLOURS)], label=f"cycle {k + 1}"))
    ax.set(xlabel="distance along the track [m]", ylabel="lateral error [mm]")
    caption = "Distance of the car from its path, to the left, in the last episode of each cycle."
    return Drawing("path_errors", sheet, caption, "Lateral error along the track, cycle by cycle.")


def _arms(arms: Mapping[str, Mapping[str, Any]]) -> Table:
    heads = ("arm", "path error at the first cap", "lap", "crashes", "at the last cap", "lap", "crashes")
    rows = tuple(
        (name, *(part for when in ("first", "last") for part in
                 (_mm(arm[when]["path_error_rms"]), lap_words(arm[when]["lap_time"]), str(arm[when]["crashes"]))))
        for name, arm in arms.items()
    )  # fmt: skip
    return Table(heads, rows, "lrrrrrr")


def _mm(metres: float | None) -> str:
    return f"{1e3 * metres:.1f} mm" if metres is not None and np.isfinite(metres) else "–"


def lap_words(seconds: float | None) -> str:
    """A time of a lap, for people."""
    return f"{seconds:.2f} s" if seconds is not None and np.isfinite(seconds) else "–"
