"""The report as a PDF: the same fit and recordings give the same bytes; nothing is fetched, every font is embedded."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import typst

from ..errors import BadInput
from ..files import replacing
from ..fit import Fit
from ..hybrid_model import HybridModel
from ..motion_model import MotionModel
from ..recording import Recording
from .content import Content
from .drawing import Drawing
from .memory.content import memory_content
from .memory.drawings import memory_drawings
from .memory.seen import seen
from .motion.content import motion_content
from .motion.drawings import motion_drawings
from .motion.driven import driven
from .noise import noise

LAYOUT = "layout.typ"
"""What all templates share."""


@dataclass(frozen=True)
class Report:
    """What a report says and shows."""

    said: Content
    made: tuple[Drawing, ...]


def report(fit: Fit, recordings: Sequence[Recording], out: str | Path) -> Path:
    """Write the report of a fit as a PDF, atomically.

    Parameters
    ----------
    fit : the fit.
    recordings : what it saw, in any order; each is checked against the fit's record of it.
    out : file to write.

    Raises
    ------
    BadInput : a recording is missing or is another file, or `out` cannot be written.
    """
    return write_pdf(prepared(fit, recordings), out)


def prepared(fit: Fit, recordings: Sequence[Recording]) -> Report:
    """What the report of a fit says and shows, before it is laid out. Raises `BadInput` as `report` does."""
    if not fit.data:
        raise BadInput(
            f"This fit of {fit.model.name} was imported and has seen no recording that a report could tell of. See how "
            "far it is from one with greybox validate."
        )
    if isinstance(fit.model, MotionModel):
        drives = driven(fit, recordings)
        heard = noise([one.recording for one in drives])
        return Report(motion_content(fit, drives, heard), motion_drawings(fit, drives, heard))
    if isinstance(fit.model, HybridModel):
        raise BadInput(
            f"There is no report of {fit.model.name} yet; greybox validate and greybox predict tell its errors."
        )
    found = seen(fit, recordings)
    heard = noise([one.recording for one in found])
    return Report(memory_content(fit, found, heard), memory_drawings(fit, found, heard))


def write_pdf(report: Report, out: str | Path) -> Path:
    """Write a report as a PDF, atomically."""
    target = Path(out)
    pdf = render(report)
    with replacing(target) as beside:
        beside.write_bytes(pdf)
    return target


def render(report: Report) -> bytes:
    """The bytes of the PDF. The document carries no date: they depend on nothing but what it shows."""
    said = report.said
    words = said.as_dict()
    words["figures"] = {one.name: {"caption": one.caption, "alt": one.alt} for one in report.made}
    words["written_by"] = next(value for what, value in said.provenance if what == "version")
    with tempfile.TemporaryDirectory(prefix="greybox-") as name:
        folder = Path(name)
        for template in (LAYOUT, said.template):
            text = resources.files(__package__).joinpath(template).read_text("utf-8")
            (folder / template).write_text(text, encoding="utf-8")
        (folder / "content.json").write_text(json.dumps(words, ensure_ascii=False), encoding="utf-8")
        for one in report.made:
            (folder / f"{one.name}.svg").write_bytes(one.svg)
        # The machine's own fonts are left aside: the same report everywhere.
        pdf = typst.compile(
            str(folder / said.template), root=str(folder), format="pdf", ignore_system_fonts=True, timestamp=0
        )
    assert isinstance(pdf, bytes)
    return pdf
