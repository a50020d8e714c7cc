"""The report of a fit, whatever its model, as PDF or HTML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..errors import BadInput
from ..fit import Fit
from ..hybrid_model import HybridModel
from ..memory_model import MemoryModel
from ..motion_model import MotionModel
from ..posterior.posterior import Posterior
from ..posterior.verb import must_suit_sampling
from ..recording import Recording
from .document import Document
from .html import write_html
from .hybrid import hybrid_report
from .memory import memory_report
from .motion import motion_report
from .pdf import write_pdf

FORMATS = {"pdf": write_pdf, "html": write_html}
"""Kind of file -> what writes it."""
KINDS = {MotionModel: motion_report, MemoryModel: memory_report, HybridModel: hybrid_report}
"""Kind of model -> what makes its report."""


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
        return motion_report(fit, recordings, posterior)
    for kind, made in KINDS.items():
        if isinstance(fit.model, kind):
            return made(fit, recordings)
    raise BadInput(f"There is no report of {fit.model.name}.")


def kind_of(out: str | Path, kind: str | None = None) -> str:
    """Kind of file, pdf or html: as asked for, else as the file's name says.

    Raises
    ------
    BadInput : the name says something else than what is asked for.
    """
    suffix = {"htm": "html"}.get(own := Path(out).suffix.lower().lstrip("."), own)
    if suffix not in FORMATS:
        raise BadInput(f"{out}: a report is a .pdf or a .html file; name it so with ‹out›.")
    if kind not in (None, suffix):
        raise BadInput(f"{out} is named as {suffix.upper()}, but ‹format› says {kind}; omit one of them.")
    return suffix


def write(document: Document, out: str | Path, kind: str | None = None) -> Path:
    """Write a report as PDF or HTML, as `kind` or the file's name says, atomically."""
    return FORMATS[kind or kind_of(out)](document, out)
