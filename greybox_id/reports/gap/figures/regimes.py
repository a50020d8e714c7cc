"""Where in speed and lateral acceleration a gap lies."""

from __future__ import annotations

import numpy as np
from matplotlib.patches import Patch

from ....gap import Strip
from .looks import EXCESS, NEVER, Sheet, nothing


def regimes(sheet: Sheet, strip: Strip) -> None:
    """A map of the share of the gap over v_x and a_y; hatched where nothing was driven."""
    axes = sheet.subplots()
    if not {"v_x", "a_y", "gap"} <= strip.map.keys():
        nothing(axes, "speed and lateral acceleration are not recorded")
        return
    share = 100.0 * np.asarray(strip.map["gap"], dtype=float)
    if not np.any(np.isfinite(share)) or not np.nanmax(share) > 0:
        nothing(axes, "no gap to be placed in a map of\nspeed and lateral acceleration")
        return
    axes.set_facecolor(NEVER)
    axes.patch.set_hatch("////")
    axes.patch.set_edgecolor("#c8c8c8")
    axes.grid(visible=False)
    drawn = axes.pcolormesh(
        strip.map["v_x"], strip.map["a_y"], np.ma.masked_invalid(share).T, cmap=EXCESS, vmin=0.0, linewidth=0,
        edgecolor="face",
    )  # fmt: skip
    axes.set_xlabel("$v_x$ [m/s]")
    axes.set_ylabel("$a_y$ [m/s²], left positive")
    bar = sheet.colorbar(drawn, ax=axes, aspect=25, pad=0.02)
    bar.set_label("share of the gap [%]")
    bar.outline.set_linewidth(0.4)
    if not np.all(np.isfinite(share)):
        never = Patch(facecolor=NEVER, edgecolor="#c8c8c8", hatch="////", label="never driven")
        axes.legend(handles=[never], loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
