"""Content that reports of fits of all models share.

Sentences and tables; drawings of traces, residuals and spectra.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import PurePath

import numpy as np

from ..base.numbers import capital, counted, interval, listed, number, percent, pretty_unit, signal_words, with_sd
from ..base.signals import unit_of
from ..fitting.fit import Fit
from ..fitting.provenance import DataRecord, Stage
from ..models.parameter import Parameter
from .document import Drawing, Formulas, Part, Points, Table, Text
from .equations.expression import Equation, readable
from .figures.estimates import same_as_best, spread_of
from .figures.predictions import residual_correlations, spectrum, traces
from .recordings import Noise, Seen, of_role, shown_first, typical_stretch

ROLE_WORDS = {"train": "training", "validate": "validation"}
HEAD = ("parameter", "meaning", "estimate ± sd", "95 % interval", "unit", "prior", "note")
MOST_FILES = 3
"""Most files of recordings that are named in a title."""
OBJECTIVE = (
    "The objective is half the sum of squares of residuals and of deviations from the priors, each divided by its "
    "standard deviation."
)


def heading(what: str, subject: str, data: Sequence[DataRecord]) -> str:
    """Title of a report: its kind, the vehicle or model, and the files of the recordings."""
    files = [PurePath(one.path).name or one.name for one in data]
    more = len(files) - MOST_FILES
    named = [*files[:MOST_FILES], f"{more} more"] if more > 1 else files
    return f"{what} of {subject}: {listed(named)}" if named else f"{what} of {subject}"


def circumstances(fit: Fit, recordings: Sequence[Seen], role: str, *, chose: str = "") -> str:
    """Which recordings a fit is scored on, their duration, and whether they were held out.

    Parameters
    ----------
    fit, recordings : the fit and its recordings.
    role : "train" or "validate".
    chose : what was selected on the validation recording, if anything.
    """
    data = of_role(recordings, role)
    seconds = sum(one.recording.duration for one in data)
    where = f"{listed([one.recording.name for one in data])} ({seconds:.1f} s)"
    kind = f"recording{'' if len(data) == 1 else 's'} {where}"
    if role == "train":
        return f"On the training {kind} (no recording was held out)"
    if chose:
        return f"On the {kind}, which was not fitted but determined {chose}"
    return f"On the held-out {kind}"


def noise_words(outputs: Sequence[str], noise: Noise | None) -> str:
    """Standard deviation of the sensors' noise and where it was measured, in words."""
    if noise is None:
        return (
            "The recordings hold no stretch at rest or straight at constant speed that is long enough to measure the "
            "sensors' noise alone, so the noise is not shown."
        )
    each = [
        f"{number(noise.sd(name))} {pretty_unit(unit_of(name))} in {signal_words(name)}"
        for name in outputs
        if np.isfinite(noise.sd(name))
    ]
    caveat = (
        " This was measured at rest, without vibrations: while driving, the noise is at least as large."
        if noise.where == "at rest"
        else ""
    )
    return (
        f"The noise of the sensors, measured {noise.where} ({noise.seconds:.1f} s in "
        f"{counted(len(noise.stretches), 'stretch', 'stretches')}), has a standard deviation of "
        f"{' and '.join(each) or 'unknown size'}.{caveat}"
    )


def recorded(fit: Fit) -> Table:
    """A table of the recordings of a fit."""
    return recorded_in(fit.data, ROLE_WORDS)


def recorded_in(data: Sequence[DataRecord], roles: Mapping[str, str]) -> Table:
    """A table of recordings with role, in words, and size."""
    head = ("role", "recording", "sha256", "column map", "runs", "samples", "duration")
    rows = tuple(
        (
            roles.get(d.role, d.role), d.path.replace("\\", "/").rsplit("/", 1)[-1] or d.name,
            d.sha256[:12] or "in memory", d.columns or "–", str(d.runs), str(d.samples), f"{d.duration:.2f} s",
        )
        for d in data
    )  # fmt: skip
    return Table(head, rows, "lLllrrr")


def made_with(fit: Fit, *more: tuple[str, str]) -> tuple[tuple[str, str], ...]:
    """Provenance of a fit and the command that reproduces it, as (name, value) pairs."""
    return (
        ("version", f"greybox-id {fit.version}"),
        ("command", fit.command or "not recorded (fitted from Python)"),
        ("seed", str(fit.seed)),
        *more,
        ("effects added", ", ".join(fit.model.effects) or "none"),
    )


def can_be_used(fit: Fit) -> tuple[tuple[str, str], ...]:
    """The verdict on a fit with its reasons, as a pair with its lead; empty if the fit was not judged."""
    if fit.verdict is None:
        return ()
    return (("Verdict", " ".join([f"{capital(fit.verdict.usability)}.", *fit.verdict.reasons])),)


def indistinguishable(sentences: Iterable[str]) -> tuple[Part, ...]:
    """Parameters that no recording can distinguish."""
    items = tuple(sentences)
    if not items:
        return ()
    lead = Text("by any recording, since only their combination enters the equations:", lead="Cannot be distinguished")
    return (lead, Points(items))


def scalars(fit: Fit, parameters: Sequence[Parameter] | None = None, notes: dict[str, str] | None = None) -> Table:
    """Table of the estimates of scalar parameters.

    Parameters
    ----------
    fit : the fit.
    parameters : which parameters; all by default.
    notes : name -> note in addition to those of the fit.
    """
    chosen = fit.model.parameters if parameters is None else parameters
    fit_notes = fit.notes()
    rows = [
        _row(fit, p, [words[p.name] for words in (fit_notes, notes or {}) if p.name in words])
        for p in chosen
        if not p.shape
    ]
    return Table(HEAD, tuple(rows), "lLrrllL")


def _row(fit: Fit, parameter: Parameter, notes: list[str]) -> tuple[str, ...]:
    value = float(parameter.array)
    sd = 0.0 if parameter.fixed else float(np.ravel(fit.sd.get(parameter.name, 0.0))[0])
    low, high = (float(end) for end in fit.interval(parameter.name))
    if parameter.scope == "run" and parameter.name in fit.per_run:
        runs = ", ".join(number(float(value)) for value in np.ravel(fit.per_run[parameter.name]))
        notes = [*notes, f"estimated for each training run: {runs}; a new run uses the estimate in this row"]
    return (
        parameter.name, parameter.about, with_sd(value, sd), interval(low, high, sd),
        pretty_unit(parameter.unit), "held" if parameter.fixed else _believed(parameter), "; ".join(notes),
    )  # fmt: skip


def _believed(parameter: Parameter) -> str:
    """Prior of a parameter: mean and standard deviation."""
    prior = parameter.prior
    if prior is None:
        return "none"
    mean = parameter.array if prior.mean is None else np.asarray(prior.mean, dtype=float)
    return with_sd(float(np.ravel(mean)[0]), float(np.max(np.asarray(prior.sd, dtype=float))))


MOST_STARTS, LEAST_OFF = 12, 0.01
"""Most starts with a row; least distance of an end from the estimate, in standard deviations, that is shown."""
NOTHING = 1e-6
"""Relative differences of objectives below this count as zero."""


def stages(fit: Fit, name: Callable[[Stage], str]) -> Table:
    """A table of the stages, named by `name`, and how each ended."""
    head = ("stage", "how it ended", "steps", "CPU", "objective", "starts", "Ipopt")
    rows = tuple(
        (
            name(stage), stage.status, str(stage.steps),
            f"{stage.cpu_seconds:.1f} s" + (f" + {stage.cross_validation_seconds:.1f} s" if stage.tried else ""),
            number(stage.certificate.objective_after if stage.certificate else stage.starts[0], 6),
            _starts(stage), _ipopt(stage),
        )
        for stage in fit.stages
    )  # fmt: skip
    return Table(head, rows, "LLrrrLL")


def starts_table(fit: Fit, stage: Stage) -> Table:
    """A table of the starts: objective of each, and the parameter that ended furthest from the estimate."""
    spread = spread_of(fit, stage)
    if not spread:
        return Table((), ())
    best, rows = min(stage.starts), []
    for k, objective in enumerate(stage.starts[:MOST_STARTS]):
        name = max(spread, key=lambda item: abs(spread[item][k][0]))
        above = (objective - best) / abs(best) if best else float("nan")
        distance = spread[name][k][0]
        where = (name, f"{number(distance, 2)} sd") if abs(distance) >= LEAST_OFF else ("–", "–")
        rows.append((str(k + 1), number(objective, 6), percent(above) if above > NOTHING else "–", *where))
    head = ("start", "objective", "above the best", "furthest off", "by")
    return Table(head, tuple(rows), "lrrlr")


def ended(stage: Stage) -> str:
    """Whether the solver converged, as a clause."""
    steps = f"after {stage.steps} step{'s' if stage.steps != 1 else ''}"
    if stage.converged:
        return f"the solver converged {steps}"
    return f"the solver did not converge {steps} ({stage.status.rstrip('.')})"


def ipopt_words(stage: Stage) -> str:
    """Whether Ipopt confirmed the optimum, as a clause."""
    verdict = stage.certificate
    if verdict is None:
        return "Ipopt was not asked to confirm the optimum"
    if verdict.confirmed:
        corner = verdict.status.partition("; ")[2]
        return f"Ipopt confirmed the optimum{': ' if corner else ''}{corner}"
    better = (
        f"with an objective {percent(verdict.gained)} lower than before"
        if verdict.gained > NOTHING
        else "and found nothing better"
    )
    return f"Ipopt did not confirm the optimum: it ended with “{verdict.status}” {better}"


def _starts(stage: Stage) -> str:
    if len(stage.starts) < 2:
        return "1"
    best, same = min(stage.starts), sum(same_as_best(stage))
    spread = (max(stage.starts) - best) / abs(best) if best else float("nan")
    words = f"{same} of {len(stage.starts)} with the same objective"
    return f"{words}; the worst is {percent(spread)} above" if spread > NOTHING else words


def _ipopt(stage: Stage) -> str:
    certificate = stage.certificate
    if certificate is None:
        return "not asked"
    word = "confirmed" if certificate.confirmed else "not confirmed"
    gain = (certificate.objective_before - certificate.objective_after) / certificate.objective_before
    return (
        f"{word}: {certificate.status}, {counted(certificate.iterations, 'iteration')}, objective "
        f"{'−' + percent(gain) if gain > NOTHING else 'unchanged'}, gradient {number(certificate.gradient, 2)}, "
        f"{certificate.cpu_seconds:.1f} s"
    )


def written_down(equations: Sequence[Equation], words: str, *between: Part) -> tuple[Part, ...]:
    """Equations below their description; it says how many abbreviations are left out."""
    shown, left_out = readable(equations)
    more = f" {left_out} further abbreviations are not shown." if left_out else ""
    return (Text(words + more), *between, Formulas(shown))


TALL, LOW = 335.0, 250.0
"""Height of the traces of the recording that is scored, and of the training data, points."""


def _where_from(one: Seen) -> str:
    """Name and role of a recording, in words."""
    return f"{one.recording.name} ({'validation' if one.role == 'validate' else 'training'} data)"


def stretch_words(one: Seen) -> tuple[str, str]:
    """Position and duration of the typical stretch of a recording: "run 2 of lap7 (training data)", "15 s"."""
    start, stop = typical_stretch(one)
    run = 1 + next(k for k, (a, b) in enumerate(one.recording.runs) if a <= start < b)
    seconds = (stop - start) * one.recording.sample_time
    return f"run {run} of {_where_from(one)}", f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.2g} s"


def trace_drawings(recordings: Sequence[Seen], more: str = "") -> Iterator[Drawing]:
    """Traces of a typical stretch of held-out data, then of one of training data.

    Parameters
    ----------
    recordings : with predictions.
    more : what the caption says about the predictions in addition.
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
            f"Measured and predicted {outputs} in {where}; prediction minus measurement below each. The stretch shown "
            f"lasts {seconds}. It was chosen because its error is nearest to that of the whole recording{more}.",
            f"Time traces of measured and predicted {outputs} with residuals.",
        )


def residual_drawing(recordings: Sequence[Seen], inputs: Sequence[str]) -> Drawing:
    """Correlations of the residuals."""
    one = shown_first(recordings)
    return Drawing(
        "residuals",
        residual_correlations(one, inputs),
        f"Auto-correlations of the residuals over {_where_from(one)}. For the longest horizon, also their "
        "cross-correlations with the inputs; at positive lags, the residual follows the input. Correlations outside "
        "the "
        "band mean that the model lacks an effect or has a wrong delay. Errors of predictions over a horizon correlate "
        "over lags up to that horizon, even if the model is right.",
        "Auto-correlations of the residuals and cross-correlations with inputs, with bands of 95 %.",
    )


def spectrum_drawing(recordings: Sequence[Seen], heard: Noise | None) -> Drawing:
    """Power spectra of the measured signals, of the errors, and of the noise where it could be measured."""
    one = shown_first(recordings)
    method = (
        f"Power spectral densities over {_where_from(one)}: Welch's method within runs, Hamming windows overlapping by "
        "half."
    )
    if heard is None:
        words = "No stretch of the recordings shows the sensors' noise alone, so the noise is not drawn."
    else:
        caveat = ", without the vibrations of driving" if heard.where == "at rest" else ""
        words = f"Noise is measured {heard.where}{caveat}, in all recordings of the fit ({heard.seconds:.1f} s)."
    outputs = listed([signal_words(name) for name in one.outputs])
    return Drawing("spectrum", spectrum(one, heard), f"{method} {words}", f"Power spectra of {outputs}.")
