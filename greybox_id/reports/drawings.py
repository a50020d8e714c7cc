"""All figures of a fit, with captions, and their writing as SVG files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from matplotlib.figure import Figure

from ..files import write_atomically
from ..fit import Fit
from ..recording import Recording
from .figures.errors import errors
from .figures.impulse_responses import MOST_PANELS, impulse_responses
from .figures.spectrum import spectrum
from .figures.steering import steering
from .figures.style import svg
from .figures.traces import traces, typical_stretch
from .noise import Noise, noise
from .numbers import listed
from .recordings import Seen, seen, shown_first
from .verdict import signal_words


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
    figure: Figure
    caption: str
    alt: str

    @cached_property
    def svg(self) -> bytes:
        """The figure as SVG."""
        return svg(self.figure)


def drawings(fit: Fit, recordings: Sequence[Seen], heard: Noise | None) -> tuple[Drawing, ...]:
    """The figures that have a meaning for this model, in the order of the report."""
    one = shown_first(recordings)
    outputs = listed([signal_words(name) for name in fit.model.outputs])
    kind = "validation" if one.role == "validate" else "training"
    start, stop = typical_stretch(one)
    run = 1 + next(k for k, (a, b) in enumerate(one.recording.runs) if a <= start < b)
    where = f"{one.recording.name} ({kind} data)"
    seconds = (stop - start) * one.recording.sample_time
    found = [
        Drawing(
            "traces",
            traces(fit, one),
            f"Measured and predicted {outputs} in run {run} of {where}, and prediction minus measurement below each. "
            f"Of all stretches of {seconds:.0f} s this is the one whose error is nearest to the whole recording's.",
            f"Time traces of measured and predicted {outputs} with residuals.",
        ),
        Drawing(
            "errors",
            errors(fit, recordings),
            "Prediction minus measurement by recording and run. Boxes hold the middle half of the samples, whiskers "
            "the middle 95 %, bars are medians; protocols stand from left to right as in the legend.",
            f"Box plots of the errors of {outputs} per recording, run and protocol.",
        ),
        Drawing("spectrum", spectrum(fit, one, heard), _spectrum_words(where, heard), f"Power spectra of {outputs}."),
    ]
    curve = steering(fit, recordings)
    if curve is not None:
        found.append(
            Drawing(
                "steering",
                curve,
                "Steering characteristic: curvature over steering angle in the model's quasi steady state (inputs held "
                "over the whole window, no longitudinal acceleration) at three speeds, thin where no angle was driven "
                "at that speed, over the density of measured samples of all speeds, which hold transients too. The "
                "fit keeps no covariance between parameters, so the curves carry no band.",
                "Curvature over steering angle at three speeds, over the density of measurements.",
            )
        )
    weights = impulse_responses(fit)
    if weights is not None:
        found.append(
            Drawing(
                "impulse_responses",
                weights,
                "Finite impulse responses: weight over the age of the sample at the time of the prediction, with a "
                "band of one standard deviation; titles give the centre of the local model. A parameter of more than "
                f"{MOST_PANELS} responses has them in one panel, without bands.",
                "Weights of the model's finite impulse responses over age.",
            )
        )
    return tuple(found)


def write_figures(fit: Fit, train: Sequence[Recording], validate: Recording | None, folder: str | Path) -> list[Path]:
    """Write the figures of a fit as SVG files, each atomically.

    Parameters
    ----------
    fit : the fit.
    train, validate : the recordings it saw.
    folder : where to; made where it does not exist.

    Raises
    ------
    BadInput : a recording is not the one the fit saw, or the folder cannot be written.
    """
    recordings = seen(fit, [*train, *([validate] if validate is not None else [])])
    made = drawings(fit, recordings, noise([one.recording for one in recordings]))
    return write_drawings(made, folder)


def write_drawings(made: Sequence[Drawing], folder: str | Path) -> list[Path]:
    """Write figures as SVG files, each atomically."""
    return [write_atomically(Path(folder) / f"{one.name}.svg", one.svg.decode()) for one in made]


def _spectrum_words(where: str, heard: Noise | None) -> str:
    method = f"Power spectral densities over {where}: Welch's method within runs, Hamming windows overlapping by half."
    if heard is None:
        return f"{method} No stretch lets the sensors' noise be heard alone, so it is left out."
    caveat = ", where motor and road do not shake the sensors" if heard.where == "at rest" else ""
    return f"{method} Noise is heard {heard.where}{caveat}, in all recordings of the fit ({heard.seconds:.1f} s)."
