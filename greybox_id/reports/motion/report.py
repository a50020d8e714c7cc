"""The report of equations of motion, part by part."""

from __future__ import annotations

from collections.abc import Sequence

from ...fit import Fit
from ...posterior.posterior import Posterior
from ...recording import Recording
from ...scores.metrics import HORIZONS
from ..content import OBJECTIVE, opening, provenance, told_together
from ..convergence import starts
from ..data import data_parts, limits
from ..document import Document, Formulas, Part, Points, Text, Together, titled
from ..drawing import Drawing
from ..driven import driven, motion_model
from ..equations.motion import motion_equations
from ..equations.shared import readable
from ..figures.style import NEAR
from ..noise import noise
from .content import MotionContent, motion_content
from .drawings import motion_drawings, recorded_inputs
from .posterior import posterior_parts

DRAWN = (HORIZONS[0], NEAR)
"""Horizons, s, that figures show; errors over all of them are in the fit."""
INTERVALS = (
    "Standard deviations and intervals allow for the residuals' correlation in time and include what priors told; "
    "intervals are those of Student's t with the degrees of freedom that the recordings leave, and end at a "
    "parameter's bounds."
)
ERRORS = (
    "RMSE with its standard error, from blocks of one second, beside that of persistence. Residual sd is "
    "the standard deviation of the residuals of the fit over the horizon that it was solved over: what the model "
    "leaves, sensors' noise and all that it lacks."
)
EQUATIONS = (
    "Written down from the model itself, with the effects added to it. A dot is a derivative by time, w an "
    "abbreviation; a prime marks what an effect alters, late what a delay leaves, read what a sensor reads where that "
    "is not the quantity itself. Quantities that are constant or lead to nothing that is predicted are left out."
)


def motion_report(fit: Fit, recordings: Sequence[Recording], posterior: Posterior | None = None) -> Document:
    """The report of a fit, with draws of its posterior.

    Raises
    ------
    BadInput : a recording that it saw is missing or is another file, or the posterior is of another fit.
    """
    if posterior is not None:
        posterior.must_be_of(fit)
    drives = driven(fit, recordings, DRAWN)
    heard = noise([one.recording for one in drives])
    said = motion_content(fit, drives, heard)
    made = {one.name: one for one in motion_drawings(fit, drives, heard)}
    signals = tuple(dict.fromkeys(name for one in drives for name in (*recorded_inputs(fit, one), *fit.model.outputs)))
    parts = (
        *opening(fit, said, ("How good", "Against what", "How sure")),
        *provenance(said),
        *_parameters(said, made),
        *(() if posterior is None else posterior_parts(fit, posterior, drives)),
        *titled("Errors by horizon", *_of(made, "horizons"), said.errors, Text(ERRORS)),
        *titled("Measured and predicted", *_of(made, "traces", "traces_training")),
        *titled("Residual analysis", *_of(made, "residuals", "spectrum"), Text(said.noise)),
        *titled("What the model has learned", *_of(made, "tyres", "handling")),
        *_equations(fit),
        *data_parts(drives, signals),
        *limits(drives, signals),
        *titled(
            "How it was fitted", said.stages, Text(OBJECTIVE), *_of(made, "convergence"), starts(fit, fit.stages[-1]),
            *_of(made, "starts"),
        ),
    )  # fmt: skip
    return Document(said.model, said.about, "a fit", f"greybox-id {fit.version}", parts)


def _of(made: dict[str, Drawing], *names: str) -> tuple[Drawing, ...]:
    return tuple(made[name] for name in names if name in made)


def _parameters(said: MotionContent, made: dict[str, Drawing]) -> tuple[Part, ...]:
    return (
        *titled("Parameters", said.parameters, Text(f"{INTERVALS} {' '.join(said.held)}")),
        *titled("Effects", said.effects, level=2),
        *titled("Determined together", said.combinations, level=2),
        *((Together((Text("by these recordings:", lead="Left open"), Points(said.open))),) if said.open else ()),
        *told_together(said),
        *_of(made, "correlation"),
    )


def _equations(fit: Fit) -> tuple[Part, ...]:
    found, left_out = readable(motion_equations(motion_model(fit)))
    more = f" {left_out} abbreviations are left out for their number." if left_out else ""
    effects = tuple(f"{name}: {fit.model[name].about}." for name in fit.model.effects)
    added = (Text("to these equations:", lead="Effects added"), Points(effects)) if effects else ()
    return titled("Equations of the model", Text(EQUATIONS + more), *added, Formulas(found))
