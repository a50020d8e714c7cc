"""The picture of a gap: drawings for a report, and one page that stands alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ... import __version__
from ...gap import Gap
from ..document import Document, VerdictBox
from ..drawing import Drawing
from ..numbers import listed
from ..pdf import write_pdf, write_png
from .figures.bars import bars
from .figures.limits import limits
from .figures.ranking import ranking
from .figures.spectra import spectra
from .figures.strips import strips
from .words import judged, verdict


def drawings(gap: Gap) -> tuple[Drawing, ...]:
    """How far, which and where, each with its words."""
    closure, held_out = judged(gap)
    applied = bool(gap.applied)
    on = f"{listed([*(closure.recordings or gap.recordings)])}{' (held out)' if held_out else ''}"
    found = [
        Drawing(
            "gap_errors", bars(closure, applied),
            f"How far: errors of every channel by horizon of prediction, on {on}.",
            "Bars of errors over horizons, before and after, with the floor.",
        ),
        *_causes(gap),
    ]  # fmt: skip
    if gap.strip is not None:
        stretch = gap.where.time if gap.gap_detected else {}
        found += [
            Drawing(
                "gap_along", strips(gap.strip, stretch, applied),
                "Where: mean square errors of all channels over those of the noise, along time and along the path.",
                "Errors over time and along the path.",
            ),
            Drawing(
                "gap_spectra", spectra(gap.strip, applied),
                "Where: spectral density of the errors over that of the noise, which is one everywhere.",
                "Spectra of the errors over the noise's.",
            ),
        ]  # fmt: skip
    return tuple(found)


def _causes(gap: Gap) -> tuple[Drawing, ...]:
    """Which effects there may be; without a gap, which there could be unseen."""
    if gap.gap_detected or not gap.limits:
        caption = (
            "Which: how probable each effect is, its magnitude with its 95 % interval over the estimate (0 is not "
            "there)" + ("; where: share of the gap over speed and lateral acceleration." if gap.strip else ".")
        )
        return (
            Drawing(
                "gap_ranking", ranking(gap), caption,
                "Bars of probabilities of effects with their intervals; map of the gap.",
            ),
        )  # fmt: skip
    figure = limits(gap)
    assert figure is not None
    caption = (
        "Unseen: the effects that would show least, by the size from which on they would, over their usual size; and "
        "where in speed and lateral acceleration the recordings were driven (blank: never)."
    )
    return (Drawing("gap_limits", figure, caption, "Bars of sizes that would show; map of what was driven."),)


def page(gap: Gap) -> Document:
    """One page, as long as it takes: what the diagnosis says, above its pictures."""
    shown = tuple(replace(one, caption="") for one in drawings(gap))
    about = f"on {listed([*gap.recordings])}"
    return Document(
        gap.model, about, "a gap", f"greybox-id {__version__}", (VerdictBox(tuple(verdict(gap))), *shown), endless=True
    )


def write_picture(gap: Gap, path: str | Path) -> Path:
    """Write the page as the file's name says, PNG or PDF, atomically."""
    write = write_pdf if Path(path).suffix.lower() == ".pdf" else write_png
    return write(page(gap), path)
