"""Drawings that reports of all models share: traces, residuals, spectra."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..base.numbers import listed, signal_words
from .document import Drawing
from .figures.predictions import residual_correlations, spectrum, traces
from .noise import Noise
from .recordings import Seen, of_role, shown_first, typical_stretch

TALL, LOW = 335.0, 250.0
"""Height of the traces of the recording that is judged, and of the training data beside it, points."""


def _where_from(one: Seen) -> str:
    """A recording and what it was for."""
    return f"{one.recording.name} ({'validation' if one.role == 'validate' else 'training'} data)"


def stretch_words(one: Seen) -> tuple[str, str]:
    """Where the typical stretch of a recording lies, and how long it is: "run 2 of lap7 (training data)", "15 s"."""
    start, stop = typical_stretch(one)
    run = 1 + next(k for k, (a, b) in enumerate(one.recording.runs) if a <= start < b)
    seconds = (stop - start) * one.recording.sample_time
    return f"run {run} of {_where_from(one)}", f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.2g} s"


def trace_drawings(recordings: Sequence[Seen], more: str = "") -> Iterator[Drawing]:
    """A typical stretch of what was held out, then one of what trained.

    Parameters
    ----------
    recordings : with predictions.
    more : said of the predictions in the caption.
    """
    first = shown_first(recordings)
    trained = [one for one in of_role(recordings, "train") if one is not first]
    shown = [("traces", first, TALL)]
    if trained:
        shown.append(("traces_training", max(trained, key=lambda one: len(one.recording)), LOW))
    for name, one, height in shown:
        where, seconds = stretch_words(one)
        outputs = listed([signal_words(output) for output in one.outputs])
        yield Drawing(
            name,
            traces(one, height),
            f"Measured and predicted {outputs} in {where}, and prediction minus measurement below each. Of all "
            f"stretches of {seconds} this is the one whose error is nearest to the whole recording's{more}.",
            f"Time traces of measured and predicted {outputs} with residuals.",
        )


def residual_drawings(recordings: Sequence[Seen], inputs: Sequence[str]) -> Iterator[Drawing]:
    """Residual analysis."""
    one = shown_first(recordings)
    figure = residual_correlations(one, inputs)
    if figure is not None:
        yield Drawing(
            "residuals",
            figure,
            f"Correlation of the residuals over {_where_from(one)} with themselves over lags and, of the longest "
            "prediction, with inputs. At positive lags the residual comes after the input. Correlations outside the "
            "band show what the model could still learn, or a wrong delay. Predictions over a horizon correlate for as "
            "long as the horizon even where the model is right.",
            "Auto-correlations of the residuals and cross-correlations with inputs, with bands of 95 %.",
        )


def spectrum_drawings(recordings: Sequence[Seen], heard: Noise | None) -> Iterator[Drawing]:
    """Spectra of what was measured, of errors, and of noise where it is heard."""
    one = shown_first(recordings)
    figure = spectrum(one, heard)
    if figure is None:
        return
    method = (
        f"Power spectral densities over {_where_from(one)}: Welch's method within runs, Hamming windows overlapping by "
        "half."
    )
    if heard is None:
        words = "No stretch of the recordings shows the sensors' noise alone, so it is left out."
    else:
        caveat = ", where motor and road do not shake the sensors" if heard.where == "at rest" else ""
        words = f"Noise is measured {heard.where}{caveat}, in all recordings of the fit ({heard.seconds:.1f} s)."
    outputs = listed([signal_words(name) for name in one.outputs])
    yield Drawing("spectrum", figure, f"{method} {words}", f"Power spectra of {outputs}.")
