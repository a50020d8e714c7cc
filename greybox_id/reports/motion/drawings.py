"""The figures of a report of equations of motion, with captions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict

from ...fit import Fit
from ..drawing import Drawing, spectrum_words
from ..driven import Driven, held_errors, motion_model
from ..figures.convergence import convergence
from ..figures.correlation import correlation
from ..figures.handling import handling
from ..figures.horizons import horizons
from ..figures.spectrum import spectrum
from ..figures.starts import starts
from ..figures.tyres import tyres
from ..figures_of import residual_drawings, trace_drawings
from ..noise import Noise
from ..numbers import listed, signal_words
from ..recordings import shown_first


def motion_drawings(fit: Fit, recordings: Sequence[Driven], heard: Noise | None) -> tuple[Drawing, ...]:
    """The figures that have a meaning for this model, in the order of the report."""
    return (*_of_parameters(fit), *_of_errors(fit, recordings, heard), *_of_the_model(fit, recordings))


def _of_parameters(fit: Fit) -> Iterator[Drawing]:
    picture = correlation(fit)
    if picture is not None:
        yield Drawing(
            "correlation",
            picture,
            "Correlations between the estimates, from the fit's covariance, which allows for correlated residuals and "
            "includes priors. Parameters near +1 or −1 are identifiable only in combination; smaller correlations "
            "than 0.1 are left unwritten.",
            "Correlations between the estimated parameters, as a lower triangle of coloured cells with numbers.",
        )


def _of_errors(fit: Fit, recordings: Sequence[Driven], heard: Noise | None) -> Iterator[Drawing]:
    one = shown_first(recordings)
    scored = [name for name in fit.model.outputs if any(name in e for of in fit.metrics.values() for e in of.values())]
    outputs = listed([signal_words(name) for name in one.outputs])
    yield Drawing(
        "horizons",
        horizons(scored, fit.metrics, _plain(recordings), fit.stages[-1].noise),
        "RMSE by horizon of prediction, with its standard error: so many seconds ahead from the readings of every row, "
        "and in free run from the first row of each run to its end. In free run what is held is the reading of the "
        "run's first row.",
        f"Errors of {outputs} over the horizon of prediction, of the model and of persistence.",
    )
    yield from trace_drawings(recordings, "; the free run began with the run, not with the stretch")
    yield from residual_drawings(recordings, recorded_inputs(fit, one))
    spectra = spectrum(one, heard)
    if spectra is not None:
        yield Drawing("spectrum", spectra, spectrum_words(one, heard), f"Power spectra of {outputs}.")


def _of_the_model(fit: Fit, recordings: Sequence[Driven]) -> Iterator[Drawing]:
    curves = tyres(fit, recordings)
    if curves is not None:
        yield Drawing(
            "tyres",
            curves,
            "Lateral force over load by slip angle, both axles, with all effects on them, thick where 99 % of the slip "
            "angles driven lie; bands of 95 % follow from the covariance to first order. Below, the density of the "
            "slip angles driven, as the model has them a tenth of a second after each reading, in all recordings.",
            "Tyre curves of front and rear axle with bands, over histograms of slip angles.",
        )
    diagram = handling(fit, recordings)
    if diagram is not None:
        yield Drawing(
            "handling",
            diagram,
            "Handling diagram: steering angle less the wheelbase times the curvature, over lateral acceleration, in "
            "the model's steady turns at the typical speed, thick where it was driven, over the density of measured "
            "samples of all speeds, which hold transients too. A curve that rises to the right of zero understeers.",
            "Steering angle beyond what curvature needs over lateral acceleration.",
        )
    ends = convergence(fit.stages[-1])
    if ends is not None:
        several = len(fit.stages[-1].starts) > 1
        yield Drawing(
            "convergence",
            ends,
            "The objective over the steps of the last solve, above the best value found"
            + ("; beside it, where each start ended." if several else "."),
            "The objective over the solver's steps.",
        )

    others = starts(fit, fit.stages[-1])
    if others is not None:
        yield Drawing(
            "starts",
            others,
            "Where each start ended beside the estimate, in its standard deviations. Starts of the best objective "
            "found the same where they lie on the line; off it, the recordings do not tell the difference.",
            "Ends of the starts, parameter by parameter, in standard deviations.",
        )


def recorded_inputs(fit: Fit, one: Driven) -> list[str]:
    """The signals of a recording that are the model's inputs, by their own names or by aliases."""
    model = motion_model(fit)
    names = [(name, *model.aliases.get(name, ())) for name in model.inputs]
    return [next((own for own in each if own in one.recording), each[0]) for each in names]


def _plain(recordings: Sequence[Driven]) -> Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]:
    return {
        role: {protocol: {name: asdict(error) for name, error in of.items()} for protocol, of in errors.items()}
        for role, errors in held_errors(recordings).items()
    }
