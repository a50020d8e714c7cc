"""The report of a model with memory.

Its equations, in which windows of past samples are sums, its errors, and how it was fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import casadi as cs
import numpy as np

from ..base.numbers import capital, counted, listed, number, percent, pretty_unit, raised, signal_words, with_sd
from ..base.signals import unit_of
from ..datasets.recording import Recording
from ..engine.trace import Trace
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior
from ..fitting.provenance import Stage
from ..fitting.scores.memory import predictions, protocols
from ..models.memory_model import MemoryModel
from ..models.model import Symbol as Casadi
from .content import (
    OBJECTIVE,
    ROLE_WORDS,
    circumstances,
    ended,
    indistinguishable,
    ipopt_words,
    made_with,
    scalars,
    stages,
    written_down,
)
from .document import Drawing, Table, Text, titled
from .equations.expression import Equation, Expression, Symbol, Window
from .equations.tracing import Reader, traced
from .figures.characteristics import MOST_PANELS, impulse_responses, steering
from .figures.predictions import errors
from .recordings import Seen, matched, of_role
from .report import Sections, sections, seen

NEXT = "next"
"""Mark of an output one sample after the newest input."""


@traced.register(MemoryModel)
def memory_equations(model: MemoryModel) -> tuple[Equation, ...]:
    """The model's equations, and those of the inputs that follow from its outputs in closed loop."""
    read = Reader()

    def past(signal: Casadi, weights: Sequence[Casadi]) -> Casadi:
        window = Window(_weights(weights, read.known), read(cs.SX(signal)), len(weights))
        return read.named(window, f"window {len(read.known)}")

    u = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.inputs})
    p = SimpleNamespace()
    for parameter in model.parameters:
        if parameter.shape == ():
            setattr(p, parameter.name, read.named(Symbol(parameter.name)))
            continue
        entries = np.empty(parameter.shape, dtype=object)
        for index in np.ndindex(parameter.shape):
            entries[index] = read.named(Symbol(parameter.name, tuple(k + 1 for k in index)))
        setattr(p, parameter.name, entries)
    outputs = model.equations(u, p, past)
    result = [Equation(Symbol(name, mark=NEXT), read(cs.SX(outputs[name]))) for name in model.outputs]
    if model.feedback is not None:
        y = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.outputs})
        fed = {name: read(cs.SX(value)) for name, value in model.feedback(y, u).items()}
        result += [Equation(Symbol(name), value) for name, value in fed.items() if value != Symbol(name)]
    return tuple(result)


def _weights(weights: Sequence[Casadi], known: dict[str, Expression]) -> Symbol:
    """The parameter whose last index counts the weights, without that index; a letter if they are anything else."""
    result = [known.get(cs.SX(weight).name()) if cs.SX(weight).is_symbolic() else None for weight in weights]
    first = result[0]
    if isinstance(first, Symbol) and first.entry:
        expected = [Symbol(first.name, (*first.entry[:-1], k + 1)) for k in range(len(result))]
        if result == expected:
            return Symbol(first.name, first.entry[:-1])
    return Symbol("g")


LEADS = ("How good", "Compared", "How chosen")
EARLY = "early stopping"
INTERVALS = (
    "Standard deviations and intervals allow for the residuals' correlation in time and include the priors. Intervals "
    "end at the bounds of the parameter. Notes mark parameters on which the recording has little information."
)
ERRORS = (
    "RMSE is given with its standard error, from blocks of one second. FVU (fraction of variance unexplained) is the "
    "variance of the error divided by that of the measured signal."
)
EQUATIONS = (
    "“next” marks a value one sample, T, after the newest input. w stands for a repeated term. Below a bracket "
    "stands the time at which it is evaluated; a sum over n runs over a window of past samples. Of long sums, the "
    "first terms "
    "and the last are shown."
)
PROTOCOL_WORDS = {"honest": "one sample ahead", "published": "as published", "closed_loop": "closed loop"}
PROTOCOL_MEANING = {
    "honest": "all inputs are measured ones. No window extends over two runs, and all samples count equally.",
    "published": "as in the papers on model-structured networks. Windows may extend over two runs, and the value is "
    "the mean of the RMSE of batches of 100 windows. It is given only for comparison with published tables.",
    "closed_loop": "the model runs on its own predictions from the first window of each run to the run's end. No "
    "window "
    "extends over two runs, and all samples count equally.",
}


@dataclass(frozen=True)
class PersistenceErrors:
    """Errors of persistence for one output, on the recordings of one role.

    Attributes
    ----------
    held : RMSE of holding the last measured value for one sample, in the output's unit.
    held_fvu : fraction of variance unexplained of the same.
    """

    held: float
    held_fvu: float


@sections.register(MemoryModel)
def _sections(
    model: MemoryModel, fit: Fit, recordings: Sequence[Recording], posterior: Posterior | None = None
) -> Sections:
    drives = memory_seen(model, fit, recordings)
    persistence = persistence_errors(fit, drives)
    protocols = (Text(PROTOCOL_MEANING[p], lead=f"{capital(PROTOCOL_WORDS[p])}:") for p in fit.metrics["train"])
    parameters = scalars(fit)
    return Sections(
        runs=drives,
        verdict=tuple(zip(LEADS, verdict(model, fit, drives, persistence), strict=True)),
        provenance=_provenance(model, fit),
        judged=titled("Errors", _errors(fit, persistence), Text(ERRORS), _boxes(fit, drives), *protocols),
        learned=(
            *titled("What the model has learned", *_learned(model, fit, drives)),
            *titled("Parameters", parameters, Text(INTERVALS if parameters.rows else ""), _arrays(fit)),
            *indistinguishable(raised(sentence) for sentence in model.together),
            *titled("Equations of the model", *written_down(memory_equations(model), EQUATIONS)),
        ),
        fitted=titled("How it was fitted", stages(fit, _stage_name), Text(OBJECTIVE + _strengths(fit))),
    )


@seen.register(MemoryModel)
def memory_seen(model: MemoryModel, fit: Fit, recordings: Sequence[Recording]) -> Sequence[Seen]:
    """Predictions in every protocol that the model has."""
    trace, named = Trace(model), protocols(model)
    return tuple(
        Seen(record.role, recording, model.outputs, {p: predictions(model, recording, p, trace) for p in named})
        for record, recording in zip(fit.data, matched(fit, recordings), strict=True)
    )


def persistence_errors(fit: Fit, recordings: Sequence[Seen]) -> dict[str, dict[str, PersistenceErrors]]:
    """Role -> output -> errors of persistence."""
    result: dict[str, dict[str, PersistenceErrors]] = {}
    for role in dict.fromkeys(one.role for one in recordings):
        result[role] = {}
        for k, name in enumerate(fit.model.outputs):
            steps, values = [], []
            for one in of_role(recordings, role):
                scored = one.predicted["honest"]
                values.append(scored.measured[:, k])
                steps.append(one.recording[name][scored.rows] - one.recording[name][scored.rows - 1])
            moved, variance = np.concatenate(steps), float(np.var(np.concatenate(values)))
            fvu = float(np.var(moved)) / variance if variance > 0 else float("nan")
            result[role][name] = PersistenceErrors(float(np.sqrt(np.mean(moved**2))), fvu)
    return result


def verdict(
    model: MemoryModel, fit: Fit, recordings: Sequence[Seen], persistence: Mapping[str, Mapping[str, PersistenceErrors]]
) -> tuple[str, ...]:
    """Three sentences that hold for any numbers: accuracy, comparisons, choice of the regularisation."""
    role = "validate" if "validate" in fit.metrics else "train"
    main = "closed_loop" if model.feedback is not None else "honest"  # closed loop if the model has one
    return _how_good(fit, recordings, role, main), _against_what(fit, role, persistence[role], main), _how_chosen(fit)


def _how_good(fit: Fit, recordings: Sequence[Seen], role: str, main: str) -> str:
    where = circumstances(fit, recordings, role, chose="when to stop" if fit.mode == EARLY else "")
    how = "running on its own predictions" if main == "closed_loop" else "one sample ahead"
    each = [
        f"{with_sd(e['rmse'], e['rmse_sd'])} {pretty_unit(unit_of(name))} in {signal_words(name)} ({_unexplained(e)})"
        for name, e in fit.metrics[role][main].items()
    ]
    return f"{where}, the RMSE of {fit.model.name} {how} is {listed(each)}."


def _unexplained(error: Mapping[str, float]) -> str:
    fvu = error["fvu"]
    if not np.isfinite(fvu):
        return "a signal that does not vary"
    if fvu >= 1.0:
        return f"{percent(fvu)} of the variance: no better than the signal's mean"
    return f"{percent(fvu)} of the variance unexplained"


def _against_what(fit: Fit, role: str, persistence: Mapping[str, PersistenceErrors], main: str) -> str:
    to_persistence = [
        f"{_factor(fit.metrics[role]['honest'][name]['rmse'], of_output.held)} in {signal_words(name)}"
        for name, of_output in persistence.items()
    ]
    text = (
        "One sample ahead on measured inputs, the RMSE of the model divided by that of persistence, which keeps the "
        "last "
        f"reading, is {listed(to_persistence)}"
    )
    if role == "train":
        return f"{text}. The error on held-out recordings is not known."
    mode = "on its own predictions" if main == "closed_loop" else "one sample ahead"
    to_training = [
        f"{_factor(error['rmse'], fit.metrics['train'][main][name]['rmse'])} in {signal_words(name)}"
        for name, error in fit.metrics[role][main].items()
    ]
    return f"{text}. {capital(mode)}, the RMSE divided by that on the training data is {listed(to_training)}."


def _factor(value: float, reference: float) -> str:
    return number(value / reference, 3) if reference > 0 else "infinite"


def _how_chosen(fit: Fit) -> str:
    last = fit.stages[-1]
    strength = {
        "cross-validation": "chosen by blocked cross-validation on the training data",
        EARLY: "kept low, and fitting stopped where the error on the validation recording was smallest",
        "given": "given, not chosen by the data",
    }.get(fit.mode, fit.mode)
    return f"The strength of regularisation was {strength}; {ended(last)}, and {ipopt_words(last)}."


def _provenance(model: MemoryModel, fit: Fit) -> tuple[tuple[str, str], ...]:
    return made_with(
        fit,
        ("strength of regularisation", "given" if fit.mode == "given" else f"by {fit.mode}"),
        ("sample time", f"{model.sample_time * 1e3:.4g} ms"),
        ("size", counted(model.size, "parameter")),
    )


def _errors(fit: Fit, persistence: Mapping[str, Mapping[str, PersistenceErrors]]) -> Table:
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
        held = [persistence[role][name] for role in roles]
        words = [w for m in held for w in (number(m.held), percent(m.held_fvu))]
        rows.append(("", "persistence", *words))
    return Table(tuple(head), tuple(rows), "ll" + "R" * (len(head) - 2))


def _boxes(fit: Fit, drives: Sequence[Seen]) -> Drawing:
    outputs = listed([signal_words(name) for name in fit.model.outputs])
    return Drawing(
        "errors",
        errors(fit, drives),
        "Prediction minus measurement by recording and run. Boxes hold the middle half of the samples, whiskers "
        "the middle 95 %, bars are medians; protocols are in the order of the legend.",
        f"Box plots of the errors of {outputs} per recording, run and protocol.",
    )


def _learned(model: MemoryModel, fit: Fit, drives: Sequence[Seen]) -> tuple[Drawing, ...]:
    """The drawings that are meaningful for this model."""
    return (
        Drawing(
            "steering",
            steering(model, drives),
            "Steering characteristic at three speeds: curvature over steering angle in the model's quasi steady "
            "state (inputs constant over the whole window, no longitudinal acceleration). Curves are thin where no "
            "such angle was driven at that speed. Behind them: the density of measured samples at all speeds, "
            "transients included. The fit keeps no covariance between parameters, so the curves carry no band.",
            "Curvature over steering angle at three speeds, over the density of measurements.",
        ),
        Drawing(
            "impulse_responses",
            impulse_responses(model, fit),
            "Finite impulse responses: the weight of a sample over its age at the time of the prediction, with a "
            "band of one standard deviation. Titles give the centre of the local model. If a parameter has more "
            f"than {MOST_PANELS} responses, one panel shows them all, without bands.",
            "Weights of the model's finite impulse responses over age.",
        ),
    )


def _arrays(fit: Fit) -> Table:
    """Parameters that are arrays."""
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
    return Table(head, tuple(rows), "lLlrrll")


def _stage_name(stage: Stage) -> str:
    return f"{stage.model}, {'on its own predictions' if stage.closed_loop else 'on measured inputs'}"


def _strengths(fit: Fit) -> str:
    """Factors on the priors of each stage; stages that took over the previous one's are not repeated."""
    sentences = []
    for stage in fit.stages:
        if not stage.strengths or (stage.closed_loop and len(fit.stages) > 1):
            continue
        factors = ", ".join(f"{name.replace('_', ' ')} × {number(f, 2)}" for name, f in stage.strengths.items())
        tried = f"; {counted(len(stage.tried), 'choice')} tried by cross-validation" if stage.tried else ""
        sentences.append(f"{stage.model}: {factors} ({stage.strengths_from}{tried}).")
    return f" Factors on the strength of priors: {' '.join(sentences)}" if sentences else ""
