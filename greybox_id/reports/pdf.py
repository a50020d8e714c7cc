"""The report as a PDF: the same fit and recordings give the same bytes; nothing is fetched, every font is embedded."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import typst

from ..files import replacing
from ..fit import Fit
from ..model import Model
from ..recording import Recording
from .content import Content, content
from .drawings import Drawing, drawings
from .noise import noise
from .recordings import seen

TEMPLATE = "report.typ"


def report(fit: Fit, recordings: Sequence[Recording], out: str | Path, *, nominal: Model | None = None) -> Path:
    """Write the report of a fit as a PDF, atomically.

    Parameters
    ----------
    fit : the fit.
    recordings : what it saw, in any order; each is checked against the fit's record of it.
    out : file to write.
    nominal : the model before fitting, whose values are the means of priors that name none.

    Raises
    ------
    BadInput : a recording is missing or is another file, or `out` cannot be written.
    """
    found = seen(fit, recordings)
    heard = noise([one.recording for one in found])
    return write_pdf(content(fit, found, heard, nominal), drawings(fit, found, heard), out)


def write_pdf(said: Content, made: Sequence[Drawing], out: str | Path) -> Path:
    """Write content and figures as a PDF, atomically."""
    target = Path(out)
    pdf = render(said, made)
    with replacing(target) as beside:
        beside.write_bytes(pdf)
    return target


def render(said: Content, made: Sequence[Drawing]) -> bytes:
    """The bytes of the PDF. The document carries no date: they depend on nothing but what it shows."""
    words = said.as_dict()
    words["figures"] = {one.name: {"caption": one.caption, "alt": one.alt} for one in made}
    words["written_by"] = next(value for what, value in said.provenance if what == "version")
    with tempfile.TemporaryDirectory(prefix="greybox-") as name:
        folder = Path(name)
        template = resources.files(__package__).joinpath(TEMPLATE).read_text("utf-8")
        (folder / TEMPLATE).write_text(template, encoding="utf-8")
        (folder / "content.json").write_text(json.dumps(words, ensure_ascii=False), encoding="utf-8")
        for one in made:
            (folder / f"{one.name}.svg").write_bytes(one.svg)
        # The machine's own fonts are left aside: the same report everywhere.
        pdf = typst.compile(
            str(folder / TEMPLATE), root=str(folder), format="pdf", ignore_system_fonts=True, timestamp=0
        )
    assert isinstance(pdf, bytes)
    return pdf
