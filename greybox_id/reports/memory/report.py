"""The report of a map with memory, part by part."""

from __future__ import annotations

from collections.abc import Sequence

from ...fit import Fit
from ...recording import Recording
from ..content import OBJECTIVE, opening, provenance, told_together
from ..data import data_parts, limits
from ..document import Document, Formulas, Part, Text, titled
from ..drawing import Drawing
from ..equations.memory import memory_equations
from ..equations.shared import readable
from ..noise import noise
from .content import memory_content
from .drawings import memory_drawings
from .seen import memory_model, seen

INTERVALS = (
    "Standard deviations and intervals allow for the residuals' correlation in time and include what priors told; "
    "intervals end at a parameter's bounds. A note says where the recording told little."
)
ERRORS = (
    "RMSE is given with its standard error, from blocks of one second; FVU is the fraction of the measured signal's "
    "variance that the error has."
)
EQUATIONS = (
    "Written down from the model itself: next is one sample, T, after the newest input, w an abbreviation for what "
    "stands in several places. A bracket is taken at the time below it, so that a sum over n is a window of past "
    "samples. Of long sums the first terms and the last are shown."
)


def memory_report(fit: Fit, recordings: Sequence[Recording]) -> Document:
    """The report of a fit. Raises `BadInput` where a recording that it saw is missing or is another file."""
    drives = seen(fit, recordings)
    heard = noise([one.recording for one in drives])
    said = memory_content(fit, drives, heard)
    made = {one.name: one for one in memory_drawings(fit, drives, heard)}
    signals = tuple(dict.fromkeys((*fit.model.inputs, *fit.model.outputs)))
    protocols = tuple(Text(meaning, lead=f"{name[0].upper()}{name[1:]}:") for name, meaning in said.error_notes)
    strengths = f" Factors on the strength of priors: {' '.join(said.strengths)}" if said.strengths else ""
    parts: tuple[Part, ...] = (
        *opening(fit, said, ("How good", "Against what", "How chosen")),
        *provenance(said),
        *titled("Errors", said.errors, Text(ERRORS), *_of(made, "errors"), *protocols),
        *titled("Measured and predicted", *_of(made, "traces", "traces_training")),
        *titled("Residual analysis", *_of(made, "residuals", "spectrum"), Text(said.noise)),
        *titled("What the model has learned", *_of(made, "steering", "impulse_responses")),
        *titled("Parameters", said.parameters, Text(INTERVALS if said.parameters.rows else ""), said.arrays),
        *told_together(said),
        *_equations(fit),
        *data_parts(drives, signals),
        *limits(drives, signals),
        *titled("How it was fitted", said.stages, Text(OBJECTIVE + strengths)),
    )
    return Document(said.model, said.about, "a fit", f"greybox-id {fit.version}", parts)


def _of(made: dict[str, Drawing], *names: str) -> tuple[Drawing, ...]:
    return tuple(made[name] for name in names if name in made)


def _equations(fit: Fit) -> tuple[Part, ...]:
    found, left_out = readable(memory_equations(memory_model(fit)))
    more = f" {left_out} abbreviations are left out for their number." if left_out else ""
    return titled("Equations of the model", Text(EQUATIONS + more), Formulas(found))
