"""The report of a fit of equations of motion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ..base.numbers import (
    capital,
    counted,
    interval,
    listed,
    number,
    percent,
    pretty_unit,
    quantity,
    raised,
    short_with_sd,
    signal_words,
    with_sd,
)
from ..datasets.recording import Recording
from ..fitting.fit import SURPRISING, Fit
from ..fitting.posterior.posterior import Posterior
from ..fitting.provenance import Stage
from ..fitting.scores.metrics import FREE_RUN, HORIZONS, ahead
from ..fitting.uncertainty.identifiability import absent, combination_sentences, left_open
from ..models.model import Model
from ..models.motion_model import MotionModel
from ..models.parameter import Parameter
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
    starts_table,
    written_down,
)
from .document import Drawing, Part, Points, Table, Text, Together, there, titled
from .equations.motion import motion_equations
from .figures.characteristics import handling, tyres
from .figures.estimates import convergence, correlation, starts
from .figures.predictions import DRAWN_HORIZON, horizons
from .posterior import posterior_parts
from .recordings import Driven, Errors, Seen, driven, held_errors, shown_first
from .report import Sections, sections, seen

LEADS = ("How good", "Compared", "How sure")
DRAWN = (HORIZONS[0], DRAWN_HORIZON)
"""Horizons, s, in figures; the fit has errors over all of them."""
MOST_NAMED = 5
"""Most parameters that are named in a sentence; the table marks all."""
MOST_PAIRS = 3
"""Most pairs that are named of parameters identifiable only in combination."""
INTERVALS = (
    "Standard deviations and intervals allow for the residuals' correlation in time and include the priors. "
    "Intervals follow Student's t distribution, with the degrees of freedom that the recordings leave. They end at "
    "the bounds of the parameter."
)
ERRORS = (
    "The table gives the RMSE with its standard error, from blocks of one second, and the RMSE of persistence. "
    "Residual sd is the standard deviation of the residuals that the fit minimised. It includes sensor noise and all "
    "that the model lacks."
)
EQUATIONS = (
    "The equations include the added effects. A dot is a time derivative; w1, w2 and so on stand for repeated "
    "terms. A prime marks a quantity that an effect alters; “late” marks a delayed quantity, and “read” the reading "
    "of a sensor that differs from the quantity itself. Constants and quantities that do not influence an output are "
    "left out."
)


@sections.register(MotionModel)
def _sections(
    model: MotionModel, fit: Fit, recordings: Sequence[Recording], posterior: Posterior | None = None
) -> Sections:
    if posterior is not None:
        posterior.must_be_of(fit)
    drives = driven(model, fit, recordings, DRAWN)
    held, last = held_errors(drives), fit.stages[-1]
    return Sections(
        runs=drives,
        verdict=tuple(zip(LEADS, verdict(fit, drives, held), strict=True)),
        provenance=_provenance(fit),
        judged=(
            *estimates(fit),
            *(() if posterior is None else posterior_parts(fit, posterior, drives)),
            *titled("Errors by horizon", _over_horizons(fit, drives, held), errors_by_horizon(fit, held), Text(ERRORS)),
        ),
        learned=(*titled("What the model has learned", *_learned(model, fit, drives)), *_equations(model)),
        fitted=titled(
            "How it was fitted", stages(fit, lambda stage: f"{stage.model}, {_horizon(fit)}"), Text(OBJECTIVE),
            _convergence(last), starts_table(fit, last), _starts(fit, last),
        ),
        beside="; the free run starts at the start of the run, before this stretch",
    )  # fmt: skip


@seen.register(MotionModel)
def _seen(model: MotionModel, fit: Fit, recordings: Sequence[Recording]) -> Sequence[Seen]:
    """Predictions over every horizon, too."""
    return driven(model, fit, recordings)


def verdict(fit: Fit, recordings: Sequence[Driven], held: Mapping[str, Errors]) -> tuple[str, ...]:
    """Three sentences: accuracy, comparisons, uncertainty.

    Parameters
    ----------
    fit, recordings : the fit and its recordings.
    held : role -> errors of persistence.
    """
    role = "validate" if "validate" in fit.metrics else "train"
    scores, near = fit.metrics[role], _near(fit.metrics[role])
    return (
        f"{circumstances(fit, recordings, role)}, the RMSE of {fit.model.name} {_how_good(fit.model, scores, near)}.",
        f"{_against_hold(scores, held[role], near)}. {_against_noise(scores, fit.stages[-1].noise)}."
        f"{_against_training(fit) if role == 'validate' else ''}",
        f"{capital(ended(fit.stages[-1]))}, and {ipopt_words(fit.stages[-1])}. {_not_determined(fit)}.",
    )


def _near(scores: Mapping[str, Any]) -> str | None:
    """The horizon to name in addition to the free run; None if runs are too short for any."""
    horizons = [protocol for protocol in scores if protocol != FREE_RUN]
    return ahead(DRAWN_HORIZON) if ahead(DRAWN_HORIZON) in horizons else next(reversed(horizons), None)


def _how_good(model: Model, scores: Mapping[str, Any], near: str | None) -> str:
    each = []
    for name, error in scores[FREE_RUN].items():
        soon = scores[near].get(name) if near else None
        unit = pretty_unit(model.unit(name))
        beside = f" ({_rmse(soon)})" if soon else ""
        each.append(f"{_rmse(error)}{beside} {unit} in {signal_words(name)}")
    return f"in free run{f' (and {near}, in brackets)' if near else ''} is {listed(each)}"


def _against_hold(scores: Mapping[str, Any], held: Errors, near: str | None) -> str:
    protocol = near or FREE_RUN
    ratios = {
        name: _ratio(held[protocol][name].rmse, error["rmse"])
        for name, error in scores[protocol].items()
        if name in held.get(protocol, {})
    }
    what = f"Over {protocol.removesuffix(' ahead')}" if near else "From a run's first row"
    return (
        f"{what}, the RMSE of persistence (which holds the first reading constant) is "
        f"{_times(ratios, 'that of the model')}"
    )


def _against_noise(scores: Mapping[str, Any], noise: Mapping[str, float]) -> str:
    ratios = {name: _ratio(error["rmse"], noise[name]) for name, error in scores[FREE_RUN].items() if name in noise}
    return "The RMSE of the model in free run is " + _times(ratios, "the standard deviation of the fit's residuals")


def _against_training(fit: Fit) -> str:
    validated, train = fit.metrics["validate"][FREE_RUN], fit.metrics["train"][FREE_RUN]
    ratios = {name: _ratio(validated[name]["rmse"], train[name]["rmse"]) for name in validated if name in train}
    return f" It is {_times(ratios, 'the RMSE in free run on the training data')}." if ratios else ""


def _times(ratios: Mapping[str, str], of: str) -> str:
    """Ratios in words: "1.6 times as much in v_x, 3.1 times in yaw rate and 2.3 times in a_y"."""
    return listed(
        [
            f"{ratio} times{f' {of}' if k == 0 else ''} in {signal_words(name)}"
            for k, (name, ratio) in enumerate(ratios.items())
        ]
    )


def _ratio(value: float, reference: float) -> str:
    return number(value / reference, 2) if reference > 0 else "infinite"


def _not_determined(fit: Fit) -> str:
    """Free parameters that are not identifiable, as sentences without the last full stop."""
    free = [p for p in fit.model.parameters if p.shape == () and not p.fixed]
    if not free:
        return "No parameter was free"
    bound = [p.name for p in free if not p.bounds[0] < float(p.array) < p.bounds[1]]
    identifiability = left_open(fit)
    if identifiability is None:
        return "How well the parameters are determined is not known, because the fit kept no covariance"
    weak = [name for name in identifiability.undetermined if name not in bound]
    pairs = [f"{pair.first} with {pair.second}" for pair in identifiability.pairs[:MOST_PAIRS]]
    far = [p.name for p in free if _far(p)]
    although = ", and model errors widen its interval" if len(far) == 1 and far[0] in weak else ""
    count = counted(len(free), "free parameter")
    sentences = [
        f"{len(weak)} of {count} {'is' if len(weak) == 1 else 'are'} weakly identifiable: {_first(weak)}"
        if weak
        else "",
        f"Identifiable only in combination: {listed(pairs)}" if pairs else "",
        f"{_first(bound)} {'is at a bound' if len(bound) == 1 else 'are at bounds'}" if bound else "",
        f"{_first(far)} {'lies' if len(far) == 1 else 'lie'} far from the prior{although}" if far else "",
    ]
    clauses = [sentence for sentence in sentences if sentence]
    if not clauses:
        return f"{'Each of the ' if len(free) > 1 else 'Its '}{count} is determined"
    return ". ".join(clauses)


def _first(names: Sequence[str]) -> str:
    """The first names of a list that may be long; the table of parameters marks all."""
    more = len(names) - MOST_NAMED
    return listed(names) if more <= 0 else f"{', '.join(names[:MOST_NAMED])} and {more} more (see the table)"


def _far(parameter: Parameter) -> bool:
    prior = parameter.prior
    if prior is None or prior.mean is None:
        return False
    away = abs(float(parameter.array) - float(np.asarray(prior.mean)))
    return away > SURPRISING * float(np.asarray(prior.sd))


def _provenance(fit: Fit) -> tuple[tuple[str, str], ...]:
    model = fit.model
    free = sum(p.size for p in model.parameters if not p.fixed)
    settings = (
        (name.replace("_", " "), ("no", "yes")[value] if isinstance(value, bool) else str(value))
        for name, value in model.settings.items()
    )
    return made_with(
        fit,
        ("horizon of the fit", _horizon(fit)),
        ("initial states of predictions", _starts_from(fit.how)),
        *settings,
        ("size", f"{counted(model.size, 'parameter')}, {free} free"),
    )


def _horizon(fit: Fit) -> str:
    horizon = fit.how.get("horizon")
    return "whole runs" if horizon is None else f"{horizon:g} s from each start"


def _starts_from(how: Mapping[str, Any]) -> str:
    words = {"free": "free to deviate from their readings", "measured": "at their readings"}
    robust = how.get("robust")
    loss = f"; residuals beyond {robust:g} standard deviations count linearly" if robust else ""
    return f"{words.get(how.get('start_from', ''), 'not recorded')}{loss}"


def estimates(fit: Fit) -> tuple[Part, ...]:
    """Parameters, effects, combinations, and what is not identifiable."""
    model = fit.model
    free = [p for p in model.parameters if not p.fixed and p.name not in model.effects]
    open_ = tuple(_printed(sentence) for sentence in combination_sentences(fit))
    return (
        *titled("Parameters", scalars(fit, free), Text(f"{INTERVALS} {' '.join(_held(fit))}")),
        *titled("Effects", scalars(fit, [model[name] for name in model.effects], absent(fit)), level=2),
        *titled("Identifiable in combination", _combinations(fit), level=2),
        *((Together((Text("by these recordings:", lead="Not determined"), Points(open_))),) if open_ else ()),
        *indistinguishable(raised(sentence) for sentence in model.together),
        *there(_correlation(fit)),
    )


def _held(fit: Fit) -> tuple[str, ...]:
    """Sentences on parameters that were fixed."""
    fixed = [p for p in fit.model.parameters if p.fixed and p.shape == () and p.name not in fit.model.effects]
    nonzero = [f"{p.name} = {quantity(float(p.array), p.unit)}" for p in fixed if float(p.array)]
    zero = [p.name for p in fixed if not float(p.array)]
    sentences = [f"Fixed: {', '.join(nonzero)}."] if nonzero else []
    return (*sentences, f"Fixed at zero: {', '.join(zero)}.") if zero else tuple(sentences)


def _printed(sentence: str) -> str:
    """A sentence with true minus signs and a space before percent signs."""
    return re.sub(r"(?<=\d)%", " %", re.sub(r"-(?=\d)", "−", sentence))


def _combinations(fit: Fit) -> Table:
    estimated = [one for one in fit.combined() if np.isfinite(one.sd) and one.sd > 0]
    rows = tuple(
        (
            one.name, one.about, with_sd(one.value, one.sd), interval(one.low, one.high, one.sd), pretty_unit(one.unit),
            percent(one.sd / abs(one.value)) if one.value else "–",
        )
        for one in estimated
    )  # fmt: skip
    return Table(("combination", "meaning", "estimate ± sd", "95 % interval", "unit", "sd"), rows, "lLrrlr")


def _correlation(fit: Fit) -> Drawing:
    return Drawing(
        "correlation",
        correlation(fit),
        "Correlations between the estimates, from the fit's covariance, which allows for correlated residuals and "
        "includes priors. Parameters whose correlation is near +1 or −1 are identifiable only in combination; "
        "correlations smaller than 0.1 are not printed.",
        "Correlations between the estimated parameters, as a lower triangle of coloured cells with numbers.",
    )


def _over_horizons(fit: Fit, drives: Sequence[Driven], held: Mapping[str, Errors]) -> Drawing:
    scored = [name for name in fit.model.outputs if any(name in e for of in fit.metrics.values() for e in of.values())]
    plain = {
        role: {protocol: {name: asdict(error) for name, error in of.items()} for protocol, of in errors.items()}
        for role, errors in held.items()
    }
    outputs = listed([signal_words(name) for name in shown_first(drives).outputs])
    return Drawing(
        "horizons",
        horizons(fit.model, scored, fit.metrics, plain, fit.stages[-1].noise),
        "RMSE by horizon of prediction, with its standard error. Predictions over a horizon start from the readings "
        "of every row; the free run starts at the first row of each run and lasts to the run's end. In free run, "
        "persistence is the reading of the run's first row.",
        f"Errors of {outputs} over the horizon of prediction, of the model and of persistence.",
    )


def errors_by_horizon(fit: Fit, held: Mapping[str, Errors]) -> Table:
    """A row per output and role, and one for persistence below it if it is known."""
    roles = [role for role in ROLE_WORDS if role in fit.metrics]
    protocols = list(dict.fromkeys(protocol for role in roles for protocol in fit.metrics[role]))
    noise = fit.stages[-1].noise
    head = ("output", "prediction", *(p.removesuffix(" ahead") for p in protocols))
    rows = []
    for name in fit.model.outputs:
        output = f"{signal_words(name)} [{pretty_unit(fit.model.unit(name))}]"
        for role in roles:
            metric = fit.metrics[role]
            if not any(name in of for of in metric.values()):
                continue
            errors = [metric.get(p, {}).get(name) for p in protocols]
            rows.append((output, f"model, {ROLE_WORDS[role]}", *(_rmse(error) if error else "–" for error in errors)))
            output = f"residual sd {number(noise[name], 2)}" if name in noise and role == roles[0] else ""
            still = [held.get(role, {}).get(p, {}).get(name) for p in protocols]
            if any(still):
                rows.append(
                    (output, f"persistence, {ROLE_WORDS[role]}", *(number(e.rmse) if e else "–" for e in still))
                )
                output = ""
    return Table(head, tuple(rows), "ll" + "R" * len(protocols))


def _rmse(error: Mapping[str, Any]) -> str:
    return short_with_sd(error["rmse"], error["rmse_sd"])


def _learned(model: MotionModel, fit: Fit, recordings: Sequence[Driven]) -> tuple[Drawing, ...]:
    """The drawings that are meaningful for this model."""
    return (
        Drawing(
            "tyres",
            tyres(model, fit, recordings),
            "Lateral force divided by load, over the slip angle, for both axles and with all effects on them. Curves "
            "are thick where 99 % of the slip angles driven lie; bands of 95 % follow from the covariance to first "
            "order. Below, the density of "
            "the slip angles driven in all recordings, as predicted a tenth of a second after each reading.",
            "Tyre curves of front and rear axle with bands, over histograms of slip angles.",
        ),
        Drawing(
            "handling",
            handling(model, recordings),
            "Handling diagram: steering angle minus wheelbase times curvature, over lateral acceleration. The curve "
            "holds for the model's steady turns at the typical speed, and is thick where such turns were driven. "
            "Behind it: the density of measured samples at all speeds, transients included. A curve that rises to "
            "the right of zero means understeer.",
            "Steering angle minus wheelbase times curvature, over lateral acceleration.",
        ),
    )


def _equations(model: MotionModel) -> tuple[Part, ...]:
    effects = tuple(f"{name}: {model[name].about}." for name in model.effects)
    added = (Text("to these equations:", lead="Effects added"), Points(effects)) if effects else ()
    return titled("Equations of the model", *written_down(motion_equations(model), EQUATIONS, *added))


def _convergence(stage: Stage) -> Drawing:
    several = len(stage.starts) > 1
    return Drawing(
        "convergence",
        convergence(stage),
        "The objective minus its best value, over the steps of the last solve"
        + ("; beside it, where each start ended." if several else "."),
        "The objective over the solver's steps.",
    )


def _starts(fit: Fit, stage: Stage) -> Drawing:
    return Drawing(
        "starts",
        starts(fit, stage),
        "Where each start ended, in standard deviations from the estimate. Starts that end on the line reached "
        "the estimate. A start with the best objective that ends elsewhere is a second solution, which the "
        "recordings do not distinguish from the first.",
        "Ends of the starts, parameter by parameter, in standard deviations.",
    )
