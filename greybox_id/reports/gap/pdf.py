"""The report of a diagnosis as a PDF: the same diagnosis gives the same bytes; every font is embedded."""

from __future__ import annotations

import json
import tempfile
from importlib import resources
from pathlib import Path

import typst

from ... import reports
from ...files import replacing
from ...gap import Gap
from ..drawing import Drawing
from ..pdf import LAYOUT
from .content import GapContent, Made, gap_content
from .page import picture

TEMPLATE = "gap.typ"


def write_report(gap: Gap, made: Made, out: str | Path) -> Path:
    """Write the report of a diagnosis as a PDF, atomically.

    Parameters
    ----------
    gap : the diagnosis.
    made : what it was made with.
    out : file to write.

    Raises
    ------
    BadInput : `out` cannot be written.
    """
    target = Path(out)
    pdf = render(gap_content(gap, made), drawing(gap))
    with replacing(target) as beside:
        beside.write_bytes(pdf)
    return target


def drawing(gap: Gap) -> Drawing:
    """The picture of a diagnosis with its words."""
    caption = (
        "Errors of every channel before and after, with the floor; the ranked effects, dark where they are applied, "
        "joined where they cannot be told apart"
    )
    where = "; the gap over speed and lateral acceleration, along time and path, and in frequency."
    if gap.gap_detected and gap.where.time:
        where += " Half of the gap lies in the shaded stretch."
    return Drawing(
        "gap",
        picture(gap),
        caption + (where if gap.strip is not None else "."),
        "Bars of errors over horizons and of probabilities of effects, with their intervals; maps of the gap.",
    )


def render(said: GapContent, drawn: Drawing) -> bytes:
    """The bytes of the PDF. The document carries no date: they depend on nothing but what it shows."""
    words = said.as_dict()
    words["figures"] = {drawn.name: {"caption": drawn.caption, "alt": drawn.alt}}
    words["written_by"] = next(value for what, value in said.provenance if what == "version")
    with tempfile.TemporaryDirectory(prefix="greybox-") as name:
        folder = Path(name)
        here = resources.files(__package__)
        shared = resources.files(reports)
        for place, template in ((shared, LAYOUT), (here, TEMPLATE)):
            text = place.joinpath(template).read_text("utf-8")
            (folder / template).write_text(text, encoding="utf-8")
        (folder / "content.json").write_text(json.dumps(words, ensure_ascii=False), encoding="utf-8")
        (folder / f"{drawn.name}.svg").write_bytes(drawn.svg)
        # The machine's own fonts are left aside: the same report everywhere.
        pdf = typst.compile(
            str(folder / TEMPLATE), root=str(folder), format="pdf", ignore_system_fonts=True, timestamp=0
        )
    assert isinstance(pdf, bytes)
    return pdf
