"""The report of a track, part by part."""

from __future__ import annotations

from ...filters.walking import walking
from ...models.effects import EFFECTS
from ...models.registry import build
from ...motion_model import MotionModel
from ..document import Document, Formulas, Pairs, Part, Points, Text, VerdictBox, titled
from ..equations.motion import motion_equations
from ..equations.shared import readable
from . import content
from .digest import Digest
from .drawings import drawings
from .verdict import LEADS, verdict

ESTIMATES = (
    "Quantiles over the rows, and the median of the standard deviations; row by row they are in the table that the "
    "track left. Told in: of what walks, the share of rows in which the recording tells more than was known before."
)
TRUTH = (
    "Estimate less measurement, over the rows that have both. The measurement has errors of its own, which are in "
    "these numbers. If the bands are right, 95 % of the rows lie within two standard deviations."
)
READINGS = (
    "An innovation is a reading less what the filter expected of it. NIS: its square over the variance that the filter "
    "expected, 1 on average if the filter knows how wrong it is; windows within: share of means over 2 s inside their "
    "95 % bounds; next to next: correlation with the one before, and what chance makes of it; gated: so far off that "
    "they counted as noisier."
)
NOISE = (
    "What walks and how noisy readings are decides how much the filter trusts what. Tuned: the size under which the "
    "readings are least surprising, and that says nothing of the sideslip."
)
BANDS = (
    "Bands are two standard deviations: of the filter, and of what is stated of the model with a standard deviation. A "
    "model of another form than the vehicle's is not in them."
)
RANGE = "Beyond the ranges given in What went in, this track says nothing of the vehicle."
EQUATIONS = (
    "Written down from the model itself, with what walks in its place. A dot is a derivative by time, w an "
    "abbreviation; a prime marks what an effect or a walking number alters, late what a delay leaves, read what a "
    "sensor reads."
)


def track_report(found: Digest) -> Document:
    """What the report of a track says and shows."""
    made = {one.name: one for one in drawings(found)}
    recorded, pairs = content.provenance(found)
    parts = (
        VerdictBox(tuple(zip(LEADS, verdict(found), strict=True))),
        *titled("Provenance", recorded, Pairs(pairs)),
        *titled("What was estimated", content.estimates(found), Text(ESTIMATES), made["estimates"]),
        *((made["forces_over_slip"],) if "forces_over_slip" in made else ()),
        *_truth(found),
        *titled(
            "Does the filter know how wrong it is",
            made["innovations"], made["whiteness"], content.readings(found), Text(READINGS),
        ),
        *titled("How large noise is taken", content.noises(found), Text(NOISE)),
        *titled("Calibrated along", content.calibrated(found)),
        *titled("What went in", content.signals(found)),
        *_equations(found),
        *titled("Limits", Points((*found.sentences, BANDS, *_about_tuning(found), RANGE))),
    )  # fmt: skip
    about = f"{found.model}: {found.about}"
    return Document(f"Track of {found.data.name}", about, "a track", f"greybox-id {found.made.version}", parts)


def _truth(found: Digest) -> tuple[Part, ...]:
    table = content.truth(found)
    return titled("Against what was measured", table, Text(TRUTH)) if table.rows else ()


def _about_tuning(found: Digest) -> tuple[str, ...]:
    made = found.made
    seconds = max(made.tuned_on, made.calibrated_on)
    if not seconds or not (found.calibrated or any(own.origin == "tuned" for own in found.noise.values())):
        return ()
    what = "Noise and parameters were" if found.calibrated else "Noise was"
    return (f"{what} tuned on the first {seconds:g} s: there innovations are smaller than they will be elsewhere.",)


def _equations(found: Digest) -> tuple[Part, ...]:
    model = build(found.model, found.settings, found.effects)
    assert isinstance(model, MotionModel)
    walked, _ = walking(model, found.parameters, found.disturbances, EFFECTS)
    shown, left_out = readable(motion_equations(walked))
    more = f" {left_out} abbreviations are left out for their number." if left_out else ""
    return titled("Equations of the model", Text(EQUATIONS + more), Formulas(shown))
