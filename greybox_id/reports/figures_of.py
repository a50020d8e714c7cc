"""Drawings that reports of all models share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from .drawing import Drawing, stretch_words, where_from
from .figures.residuals import residual_correlations
from .figures.traces import traces
from .numbers import listed, signal_words
from .recordings import Seen, of_role, shown_first

TALL, LOW = 335.0, 250.0
"""Height of the traces of the recording that is judged, and of the training data beside it, points."""


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
            f"Correlation of the residuals over {where_from(one)} with themselves over lags and, of the longest "
            "prediction, with inputs: right of zero residuals come after the input. What leaves the band is "
            "something the model could still learn, or a delay that is not right; predictions over a horizon "
            "correlate for as long as the horizon even where the model is.",
            "Auto-correlations of the residuals and cross-correlations with inputs, with bands of 95 %.",
        )
