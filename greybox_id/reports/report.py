"""The report of a fit, whatever its model, as PDF or HTML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..base.errors import BadInput
from ..datasets.recording import Recording
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior
from ..fitting.posterior.verb import must_suit_sampling
from ..models.model import Model
from .content import can_be_used, noise_words, recorded
from .data import data_parts, limits
from .document import Document, Pairs, Text, VerdictBox, titled
from .figures_of import residual_drawings, spectrum_drawings, trace_drawings
from .html import write_html
from .noise import noise
from .pdf import write_pdf
from .recordings import Seen, shown_first
from .sections import sections

FORMATS = {"pdf": write_pdf, "html": write_html}
"""Kind of file -> what writes it."""


def report(fit: Fit, recordings: Sequence[Recording], out: str | Path) -> Path:
    """Write the report of a fit, atomically; as HTML where the file's name ends so, else as PDF.

    Parameters
    ----------
    fit : the fit.
    recordings : what it saw, in any order; each is checked against the fit's record of it.
    out : file to write.

    Raises
    ------
    BadInput : a recording is missing or is another file, or `out` cannot be written.
    """
    return write(prepared(fit, recordings), out)


def prepared(fit: Fit, recordings: Sequence[Recording], posterior: Posterior | None = None) -> Document:
    """What the report of a fit says and shows, of equations of motion with draws of its posterior.

    Raises
    ------
    BadInput : as `report` does, or the posterior is of another fit, or the fit can have none.
    """
    if not fit.data:
        raise BadInput(
            f"This fit of {fit.model.name} was imported and has seen no recording that a report could tell of. See how "
            "far it is from one with greybox validate."
        )
    if posterior is not None:
        must_suit_sampling(fit)
    model, value = fit.model, sections(fit.model, fit, recordings, posterior)
    runs, heard = value.runs, noise([one.recording for one in value.runs])
    signals = tuple(dict.fromkeys(name for one in runs for name in (*_recorded_inputs(model, one), *model.outputs)))
    inputs = _recorded_inputs(model, shown_first(runs))
    outputs = [name for name in model.outputs if any(name in one.outputs for one in runs)]
    parts = (
        VerdictBox((*can_be_used(fit), *value.verdict)),
        *titled("Provenance", recorded(fit), Pairs(value.provenance)),
        *value.judged,
        *titled("Measured and predicted", *trace_drawings(runs, value.beside)),
        *titled(
            "Residual analysis", *residual_drawings(runs, inputs), *spectrum_drawings(runs, heard),
            Text(noise_words(outputs, heard)),
        ),
        *value.learned,
        *data_parts(runs, signals),
        *limits(runs, signals),
        *value.fitted,
    )  # fmt: skip
    return Document(model.name, model.about, "a fit", f"greybox-id {fit.version}", parts)


def _recorded_inputs(model: Model, one: Seen) -> list[str]:
    """The signals of a recording that are the model's inputs, by their own names or by aliases."""
    names = [(name, *model.aliases.get(name, ())) for name in model.inputs]
    return [next((item for item in each if item in one.recording), each[0]) for each in names]


def kind_of(out: str | Path, kind: str | None = None) -> str:
    """Kind of file, pdf or html: as asked for, else as the file's name says.

    Raises
    ------
    BadInput : the name says something else than what is asked for.
    """
    suffix = {"htm": "html"}.get(value := Path(out).suffix.lower().lstrip("."), value)
    if suffix not in FORMATS:
        raise BadInput(f"{out}: a report is a .pdf or a .html file; name it so with ‹out›.")
    if kind not in (None, suffix):
        raise BadInput(f"{out} is named as {suffix.upper()}, but ‹format› says {kind}; omit one of them.")
    return suffix


def write(document: Document, out: str | Path, kind: str | None = None) -> Path:
    """Write a report as PDF or HTML, as `kind` or the file's name says, atomically."""
    return FORMATS[kind or kind_of(out)](document, out)
