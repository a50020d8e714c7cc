"""What a report says, as plain data: sentences and tables of words, made from a fit and its recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..fit import Fit
from ..model import Model
from ..parameter import Parameter
from ..provenance import Stage
from .noise import Noise
from .numbers import counted, interval, number, percent, pretty_unit, raised, with_sd
from .recordings import Seen
from .verdict import Yardstick, signal_words, unit_of, verdict, yardsticks

PROTOCOL_WORDS = {
    "honest": "one sample ahead",
    "published": "as published",
    "closed_loop": "closed loop",
}
PROTOCOL_MEANING = {
    "honest": "every input is measured, no window crosses a join between runs, and all samples are pooled.",
    "published": "as in the papers on model-structured networks: windows are laid across joins as if the recording "
    "were one run, and the figure is the mean of the RMSE of batches of 100 windows. It is given for comparison "
    "with published tables only.",
    "closed_loop": "the model runs on its own predictions from the first window of each run to the run's end; no "
    "window crosses a join, and all samples are pooled.",
}
ROLE_WORDS = {"train": "training", "validate": "validation"}
NORMAL_95 = 1.959964
"""Standard deviations on each side of the mean that hold 95 % of a Gaussian."""
FAR = 3.0
"""An estimate this many prior standard deviations from its prior mean is remarked upon."""
SAME_OBJECTIVE = 1e-3
"""Starts whose objective is within this share of the best count as having found the same."""


@dataclass(frozen=True)
class Table:
    """A table of words.

    Attributes
    ----------
    head : titles of the columns.
    rows : as many words per row.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Content:
    """Everything a report says.

    Attributes
    ----------
    model, about : name of the model and one sentence on it.
    verdict : three sentences.
    errors, error_notes : errors by output and protocol, and what the protocols are.
    noise : a sentence on the sensors' noise.
    recordings, provenance : files seen, and (what, value) pairs.
    parameters : physical (scalar) parameters; arrays: the others; together: what cannot be told apart.
    stages, strengths : how it was fitted.
    """

    model: str
    about: str
    verdict: tuple[str, ...]
    errors: Table
    error_notes: tuple[tuple[str, str], ...]
    noise: str
    recordings: Table
    provenance: tuple[tuple[str, str], ...]
    parameters: Table
    arrays: Table
    together: tuple[str, ...]
    stages: Table
    strengths: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """As plain data for the template."""
        return asdict(self)


def content(fit: Fit, recordings: Sequence[Seen], noise: Noise | None, nominal: Model | None = None) -> Content:
    """What a report of a fit says.

    Parameters
    ----------
    fit : the fit.
    recordings : what it saw, with predictions.
    noise : where the sensors' noise can be heard, if anywhere.
    nominal : the model before fitting, whose values are the means of priors that name none.
    """
    measures = yardsticks(fit, recordings)
    return Content(
        model=fit.model.name,
        about=fit.model.about,
        verdict=verdict(fit, recordings, measures),
        errors=_errors(fit, measures),
        error_notes=tuple((PROTOCOL_WORDS[p], PROTOCOL_MEANING[p]) for p in fit.metrics["train"]),
        noise=_noise_words(fit, noise),
        recordings=_recordings(fit),
        provenance=_provenance(fit),
        parameters=_scalars(fit, nominal),
        arrays=_arrays(fit),
        together=tuple(raised(sentence) for sentence in fit.model.together),
        stages=_stages(fit),
        strengths=_strengths(fit),
    )


def _errors(fit: Fit, measures: Mapping[str, Mapping[str, Yardstick]]) -> Table:
    roles = [role for role in ROLE_WORDS if role in fit.metrics]
    head = ["output", "protocol", *(f"{ROLE_WORDS[r]}: {what}" for r in roles for what in ("RMSE", "FVU"))]
    rows = []
    for name in fit.model.outputs:
        output = f"{signal_words(name)} [{pretty_unit(unit_of(name))}]"
        for protocol in fit.metrics["train"]:
            cells = [fit.metrics[role][protocol][name] for role in roles]
            words = [w for e in cells for w in (with_sd(e["rmse"], e["rmse_sd"]), percent(e["fvu"]))]
            rows.append((output, PROTOCOL_WORDS[protocol], *words))
            output = ""
        held = [measures[role][name] for role in roles]
        words = [w for m in held for w in (number(m.held), percent(m.held_fvu))]
        rows.append(("", "last measured value held", *words))
    return Table(tuple(head), tuple(rows))


def _noise_words(fit: Fit, noise: Noise | None) -> str:
    if noise is None:
        return (
            "The recordings hold no stretch at rest or straight at constant speed that is long enough to hear the "
            "sensors' noise alone; it is left out."
        )
    each = [
        f"{number(noise.sd(name))} {pretty_unit(unit_of(name))} in {signal_words(name)}"
        for name in fit.model.outputs
        if np.isfinite(noise.sd(name))
    ]
    caveat = (
        " At rest there is no vibration of motor and road: it is a lower bound." if noise.where == "at rest" else ""
    )
    return (
        f"The sensors' noise, heard {noise.where} ({noise.seconds:.1f} s in "
        f"{counted(len(noise.stretches), 'stretch', 'stretches')}), has a standard deviation of "
        f"{' and '.join(each) or 'unknown size'}.{caveat}"
    )


def _recordings(fit: Fit) -> Table:
    head = ("role", "recording", "sha256", "column map", "runs", "samples", "duration")
    rows = tuple(
        (
            ROLE_WORDS.get(d.role, d.role), d.path.replace("\\", "/").rsplit("/", 1)[-1] or d.name,
            d.sha256[:12] or "in memory", d.columns or "–", str(d.runs), str(d.samples), f"{d.duration:.2f} s",
        )
        for d in fit.data
    )  # fmt: skip
    return Table(head, rows)


def _provenance(fit: Fit) -> tuple[tuple[str, str], ...]:
    strength = {"given": "given"}.get(fit.mode, f"by {fit.mode}")
    return (
        ("version", f"greybox-id {fit.version}"),
        ("command", fit.command or "not recorded (fitted from Python)"),
        ("seed", str(fit.seed)),
        ("strength of regularisation", strength),
        ("sample time", f"{fit.model.sample_time * 1e3:.4g} ms"),
        ("size", counted(fit.model.size, "parameter")),
        ("effects added", ", ".join(fit.model.effects) or "none"),
    )


def _scalars(fit: Fit, nominal: Model | None) -> Table:
    """Estimates of single numbers: these have a physical meaning."""
    head = ("parameter", "meaning", "estimate ± sd", "95 % interval", "unit", "prior", "note")
    notes, rows = fit.notes(), []
    for parameter in fit.model.parameters:
        if parameter.shape != ():
            continue
        value, sd = float(parameter.array.ravel()[0]), float(np.ravel(fit.sd.get(parameter.name, 0.0))[0])
        sd = 0.0 if parameter.fixed else sd
        mean = _prior_mean(parameter, nominal)
        note = [notes[parameter.name]] if parameter.name in notes else []
        prior = "none"
        if parameter.prior is not None:
            spread = float(np.max(np.asarray(parameter.prior.sd, dtype=float)))
            prior = f"± {number(spread, 2)}" if mean is None else with_sd(mean, spread)
            if mean is not None and not parameter.fixed and abs(value - mean) > FAR * spread > 0:
                note.append(f"{abs(value - mean) / spread:.1f} prior sd from its prior mean")
        if parameter.scope == "run" and parameter.name in fit.per_run:
            values = np.ravel(fit.per_run[parameter.name])
            runs = ", ".join(number(float(value)) for value in values)
            note.append(f"one per training run: {runs}; the estimate is what new runs get")
        low, high = (np.clip(value + side * NORMAL_95 * sd, *parameter.bounds) for side in (-1, 1))
        rows.append(
            (
                parameter.name, parameter.about, with_sd(value, sd), interval(float(low), float(high), sd),
                pretty_unit(parameter.unit), "held" if parameter.fixed else prior, "; ".join(note),
            )
        )  # fmt: skip
    return Table(head, tuple(rows))


def _prior_mean(parameter: Parameter, nominal: Model | None) -> float | None:
    """Mean of a scalar's prior; None where it was the nominal value and the model before fitting is not at hand."""
    if parameter.prior is None:
        return None
    if parameter.prior.mean is not None:
        return float(np.ravel(np.asarray(parameter.prior.mean, dtype=float))[0])
    return float(nominal[parameter.name].array.ravel()[0]) if nominal is not None else None


def _arrays(fit: Fit) -> Table:
    head = ("parameter", "meaning", "entries", "rms value", "rms sd", "unit", "strength")
    rows = []
    for parameter in fit.model.parameters:
        if parameter.shape == ():
            continue
        sd = np.asarray(fit.sd.get(parameter.name, np.zeros(parameter.shape)))
        strength = parameter.prior.strength.replace("_", " ") if parameter.prior is not None else ""
        rows.append(
            (
                parameter.name, parameter.about, " × ".join(str(n) for n in parameter.shape),
                number(float(np.sqrt(np.mean(parameter.array**2)))),
                "held" if parameter.fixed else number(float(np.sqrt(np.mean(sd**2))), 2),
                pretty_unit(parameter.unit), strength or "–",
            )
        )  # fmt: skip
    return Table(head, tuple(rows))


def _stages(fit: Fit) -> Table:
    head = ("stage", "how it ended", "steps", "CPU", "objective", "starts", "Ipopt")
    rows = tuple(
        (
            f"{stage.model}, {'on its own predictions' if stage.closed_loop else 'on measured inputs'}",
            stage.status, str(stage.steps),
            f"{stage.cpu_seconds:.1f} s" + (f" + {stage.cross_validation_seconds:.1f} s" if stage.tried else ""),
            number(stage.certificate.objective_after if stage.certificate else stage.starts[0], 6),
            _starts(stage), _ipopt(stage),
        )
        for stage in fit.stages
    )  # fmt: skip
    return Table(head, rows)


def _starts(stage: Stage) -> str:
    if len(stage.starts) < 2:
        return "1"
    best = min(stage.starts)
    same = sum(abs(s - best) <= SAME_OBJECTIVE * abs(best) for s in stage.starts)
    spread = (max(stage.starts) - best) / abs(best) if best else float("nan")
    return f"{same} of {len(stage.starts)} the same; worst {percent(spread)} above"


def _ipopt(stage: Stage) -> str:
    certificate = stage.certificate
    if certificate is None:
        return "not asked"
    word = "confirmed" if certificate.confirmed else "not confirmed"
    gain = (certificate.objective_before - certificate.objective_after) / certificate.objective_before
    return (
        f"{word}: {certificate.status}, {counted(certificate.iterations, 'iteration')}, objective "
        f"{'−' + percent(gain) if gain > 0 else 'unchanged'}, gradient {number(certificate.gradient, 2)}, "
        f"{certificate.cpu_seconds:.1f} s"
    )


def _strengths(fit: Fit) -> tuple[str, ...]:
    """One sentence per stage on the factors on its priors; stages that share the last one's are not repeated."""
    sentences = []
    for stage in fit.stages:
        if not stage.strengths or (stage.closed_loop and len(fit.stages) > 1):
            continue
        factors = ", ".join(f"{name.replace('_', ' ')} × {number(f, 2)}" for name, f in stage.strengths.items())
        tried = f"; {counted(len(stage.tried), 'choice')} tried by cross-validation" if stage.tried else ""
        sentences.append(f"{stage.model}: {factors} ({stage.strengths_from}{tried}).")
    return tuple(sentences)
