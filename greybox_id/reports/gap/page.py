"""The picture of a gap: panels for a report, and one A4 page that stands alone."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ...files import replacing
from ...gap import Gap
from ..figures.style import canvas, look
from ..numbers import counted, listed
from .figures.bars import bars
from .figures.looks import Sheet
from .figures.ranking import ranking
from .figures.regimes import regimes
from .figures.spectra import spectra
from .figures.strips import strips
from .words import judged, verdict

A4 = (8.27, 11.69)
"""Width and height, inches."""
LETTERS = 112
"""In a line of the page's sentences."""
LINE = 0.175
"""Height of a line, inches."""
INDENT = 0.09
"""Of sentences behind their leads, of the page's width."""
JOINED = "dark applied, joined not to be told apart"
HEADING = 60
"""Letters of recordings' names in a heading."""
DPI = 150
"""Of the page as PNG."""


def panels(sheet: Sheet, gap: Gap) -> None:
    """All panels, one row below the other."""
    strip, applied = gap.strip, bool(gap.applied)
    closure, held_out = judged(gap)
    if strip is None:
        far, which = _below(sheet, 1.0, 1.15)
    else:
        far, which, along, frequency = _below(sheet, 1.0, 1.15, 1.05, 0.95)
        which, place = which.subfigures(1, 2, width_ratios=[1.7, 1.0])
        _headed(place, "Where")
        regimes(place, strip)
        _headed(along, "Where", "along time and path")
        strips(along, strip, gap.where.time if gap.gap_detected else {}, applied)
        _headed(frequency, "Where", "in frequency")
        spectra(frequency, strip, applied)
    role = " (held out)" if held_out else ", which chose the effects" if applied else ""
    _headed(far, "How far", f"errors on {_short(closure.recordings or gap.recordings)}{role}")
    bars(far, closure, applied)
    _headed(which, "Which", JOINED)
    ranking(which, gap)


def _below(sheet: Sheet, *heights: float) -> list[Any]:
    """Rows of so many heights."""
    rows: Any = sheet.subfigures(len(heights), 1, height_ratios=heights)
    return list(rows)


def _short(names: Sequence[str]) -> str:
    """Names of recordings, counted where they are too long for a heading."""
    said = listed([*names])
    return said if len(said) <= HEADING else f"{counted(len(names), 'recording')}, {names[0][: HEADING - 20]} …"


def _headed(sheet: Sheet, lead: str, words: str = "") -> None:
    sheet.suptitle(f"{lead}: {words}" if words else lead, x=0.005, ha="left", fontsize=9.5, fontweight="bold")


def picture(gap: Gap) -> Figure:
    """The panels at the width of a report."""
    with look():
        figure = canvas(7.6 if gap.strip is not None else 3.8)
        panels(figure, gap)
    return figure


def page(gap: Gap) -> Figure:
    """One A4 page: what the diagnosis says, above its panels."""
    said = [(lead, textwrap.wrap(sentence, LETTERS)) for lead, sentence in verdict(gap)]
    above = LINE * (3.0 + sum(len(lines) for _, lines in said))
    with look():
        figure = Figure(figsize=A4, layout="constrained")
        figure.get_layout_engine().set(rect=(0.06, 0.03, 0.88, 0.94))  # type: ignore[union-attr,call-arg]
        words, below = _below(figure, above, 0.94 * A4[1] - above)
        _sentences(words, above, f"{gap.model} on {listed([*gap.recordings])}", said)
        panels(below, gap)
    return figure


def _sentences(sheet: Sheet, height: float, title: str, said: Sequence[tuple[str, Sequence[str]]]) -> None:
    """A title and sentences with their leads."""
    title, *more = textwrap.wrap(title, 2 * LETTERS // 3)
    sheet.text(0.0, 1.0, f"{title} …" if more else title, fontsize=14, fontweight="bold", va="top")
    down = 1.0 - 2.0 * LINE / height
    for lead, lines in said:
        sheet.text(0.0, down, lead, fontsize=9.5, fontweight="bold", va="top")
        for line in lines:
            sheet.text(INDENT, down, line, fontsize=9.5, va="top")
            down -= LINE / height


def write_picture(gap: Gap, path: str | Path) -> Path:
    """Write the page as the file's name says, PNG or PDF, atomically."""
    target = Path(path)
    with look(), replacing(target) as beside:
        page(gap).savefig(beside, dpi=DPI, metadata=_plain(target.suffix.lower()))
    return target


def _plain(suffix: str) -> dict[str, None]:
    """No date is written into it."""
    return {"CreationDate": None} if suffix == ".pdf" else {}
