"""The figures of a report of a map with memory, with captions."""

from __future__ import annotations

from collections.abc import Sequence

from ...fit import Fit
from ..drawing import Drawing, spectrum_words
from ..figures.errors import errors
from ..figures.impulse_responses import MOST_PANELS, impulse_responses
from ..figures.spectrum import spectrum
from ..figures.steering import steering
from ..figures_of import residual_drawings, trace_drawings
from ..noise import Noise
from ..numbers import listed, signal_words
from ..recordings import Seen, shown_first


def memory_drawings(fit: Fit, recordings: Sequence[Seen], heard: Noise | None) -> tuple[Drawing, ...]:
    """The figures that have a meaning for this model, in the order of the report."""
    one = shown_first(recordings)
    outputs = listed([signal_words(name) for name in fit.model.outputs])
    found = [
        *trace_drawings(recordings),
        Drawing(
            "errors",
            errors(fit, recordings),
            "Prediction minus measurement by recording and run. Boxes hold the middle half of the samples, whiskers "
            "the middle 95 %, bars are medians; protocols stand from left to right as in the legend.",
            f"Box plots of the errors of {outputs} per recording, run and protocol.",
        ),
    ]
    found += residual_drawings(recordings, fit.model.inputs)
    spectra = spectrum(one, heard)
    if spectra is not None:
        found.append(Drawing("spectrum", spectra, spectrum_words(one, heard), f"Power spectra of {outputs}."))
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
