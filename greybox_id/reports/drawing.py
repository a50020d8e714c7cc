"""A figure of a report with its words, and its writing as an SVG file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..files import write_atomically
from .noise import Noise
from .recordings import Seen, typical_stretch

if TYPE_CHECKING:  # matplotlib is loaded where something is drawn
    from .figures.sheet import Sheet


@dataclass(frozen=True)
class Drawing:
    """A figure and its words.

    Attributes
    ----------
    name : of its file, without suffix.
    figure : the figure.
    caption : below it.
    alt : what it shows, for those who cannot see it.
    """

    name: str
    figure: Sheet
    caption: str
    alt: str

    @property
    def svg(self) -> str:
        """The figure as an SVG file, in the colours of light paper."""
        return self.figure.svg(self.alt)


def write_drawings(made: Sequence[Drawing], folder: str | Path) -> list[Path]:
    """Write figures as SVG files, each atomically.

    Raises
    ------
    BadInput : the folder cannot be written.
    """
    return [write_atomically(Path(folder) / f"{one.name}.svg", one.svg) for one in made]


def where_from(one: Seen) -> str:
    """A recording and what it was for."""
    return f"{one.recording.name} ({'validation' if one.role == 'validate' else 'training'} data)"


def stretch_words(one: Seen) -> tuple[str, str]:
    """Where the typical stretch of a recording lies, and how long it is: "run 2 of lap7 (training data)", "15 s"."""
    start, stop = typical_stretch(one)
    run = 1 + next(k for k, (a, b) in enumerate(one.recording.runs) if a <= start < b)
    seconds = (stop - start) * one.recording.sample_time
    return f"run {run} of {where_from(one)}", f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.2g} s"


def spectrum_words(one: Seen, heard: Noise | None) -> str:
    """How spectra were taken, and where noise is heard."""
    method = (
        f"Power spectral densities over {where_from(one)}: Welch's method within runs, Hamming windows overlapping by "
        "half."
    )
    if heard is None:
        return f"{method} No stretch lets the sensors' noise be heard alone, so it is left out."
    caveat = ", where motor and road do not shake the sensors" if heard.where == "at rest" else ""
    return f"{method} Noise is heard {heard.where}{caveat}, in all recordings of the fit ({heard.seconds:.1f} s)."
