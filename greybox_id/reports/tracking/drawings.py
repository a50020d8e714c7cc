"""The pictures of a track with their words."""

from __future__ import annotations

from ...filters import Track
from ...recording import Recording
from ..drawing import Drawing
from ..figures.slips import forces_over_slip
from .bands import over_time
from .consistency import innovations


def drawings(found: Track, recording: Recording) -> list[Drawing]:
    """Estimates over time, forces over slip angle where a model has them, and the innovations.

    Parameters
    ----------
    recording : as read; what it measures of the estimates is drawn beside them, whether the filter read it or not.
    """
    how = "filter and smoother" if found.smoothed else "filter"
    name = f"{found.kind.upper()} {how}" if found.smoothed else f"{found.kind.upper()}"
    made = [
        Drawing(
            "estimates",
            over_time(found, recording),
            f"Estimates over time ({name}), with bands of two standard deviations. What was measured of them is drawn "
            "beside them; only the readings named in the text entered the filter.",
            "Sideslip, stiffness and forces over time with bands.",
        )
    ]
    slips = forces_over_slip(found.values)
    if slips is not None:
        made.append(
            Drawing(
                "forces_over_slip",
                slips,
                "Lateral force of each axle over its slip angle, as estimated: darker where more samples lie.",
                "Lateral force over slip angle, front and rear, as a density of samples.",
            )
        )
    made.append(
        Drawing(
            "innovations",
            innovations(found),
            "Normalised innovations squared (NIS), means over 2 s, and within which bounds 95 % of them lie if the "
            "filter knows how wrong it is.",
            "NIS of each reading over time with its bounds.",
        )
    )
    return made
