"""The pictures of a track with their words."""

from __future__ import annotations

from ..drawing import Drawing
from ..figures.slips import forces_over_slip
from .bands import over_time
from .consistency import squares, whiteness
from .digest import Digest


def drawings(found: Digest) -> tuple[Drawing, ...]:
    """Estimates over time, forces over slip angle where a model has them, and the innovations over time and lags."""
    how = f"{found.filter.upper()} and smoother" if found.smoothed else found.filter.upper()
    more = " What was measured of them is drawn beside them." if found.course.measured else ""
    more += f" Of {found.course.every} rows one is drawn." if found.course.every > 1 else ""
    if found.runs > 1:
        more += " Runs begin at dotted lines; where their clocks begin anew they are laid one behind the other."
    made = [
        Drawing(
            "estimates",
            over_time(found),
            f"Estimates over time ({how}), with bands of two standard deviations.{more}",
            "Estimates over time with bands.",
        )
    ]
    slips = forces_over_slip(found.course.values)
    if slips is not None:
        made.append(
            Drawing(
                "forces_over_slip",
                slips,
                "Lateral force of each axle over its slip angle, as estimated: darker where more samples lie.",
                "Lateral force over slip angle, front and rear, as a density of samples.",
            )
        )
    made += [
        Drawing(
            "innovations",
            squares(found),
            "Normalised innovations squared (NIS), means over 2 s, and within which bounds 95 % of them lie if the "
            "filter knows how wrong it is.",
            "NIS of each reading over time with its bounds.",
        ),
        Drawing(
            "whiteness",
            whiteness(found),
            "Correlation of innovations with those a lag later. If the filter takes from the readings all that they "
            "tell, an innovation does not depend on those before; what stays outside the band is something the model "
            "lacks, or noise that has a memory of its own.",
            "Correlation of the innovations of each reading over lags, with its band.",
        ),
    ]
    return tuple(made)
