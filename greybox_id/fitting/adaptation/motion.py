"""Adapt equations of motion to the first seconds of a changed vehicle, with the old fit as prior.

A parameter's standard deviation in the fit is the information of the old recordings; its weight relative to the new
recording is chosen as for models with memory, by blocked cross-validation on the new seconds, and so is whether
anything changes. For hybrid models, the factors by which tyres differ are free, each with its own prior; they are
compared in free run.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.errors import BadInput, near_or_all
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.motion.simulator import Predictor, Simulator
from ...engine.simulation import Prediction
from ...models.hybrid_model import HybridModel
from ...models.motion_model import MotionModel
from ...models.parameter import Parameter, Prior
from ..fit import Fit
from ..how import FitOptions, quiet
from ..requested_model import must_be_recorded
from ..scores.metrics import Error, prediction_errors, simulate
from ..training import update_hybrid
from ..verb import fit as fit_model
from .choosing import FOLD, GAP, SHORT, STRENGTHS, AdaptedCandidate, chosen, foretold
from .verb import Adaptation, AdaptTask, Outcome, adapted, moved_from, parted

Equations = MotionModel | HybridModel
"""Models that are adapted here."""
AHEAD = 0.5
"""Horizon, s, for comparing the old and the adapted model."""
LEAST_SECONDS = 2.0
"""Shortest unbroken stretch, s, that is fitted to."""
ESTIMATED = "estimated parameters"
"""Name of the default set of free parameters."""


def adapted_motion(model: Equations, task: AdaptTask) -> Adaptation:
    """Adapt a fit of equations of motion, or of a hybrid model with `carried_on` parameters.

    `free`: "auto" or "all", the parameters that the fit estimated, or names of some, with commas.

    Raises
    ------
    BadInput : a signal is missing, the recording is too short, a name is unknown, or no standard deviation is known.
    """
    clock = time.process_time()
    fit, recording, seconds, free, validate, say = (
        task.fit, task.recording, task.seconds, task.free, task.validate, task.say
    )  # fmt: skip
    names = _free(fit, free)
    new, rest = parted(recording, seconds)
    rest = rest if validate is None else validate
    must_be_recorded(model, [new] if rest is None else [new, rest])
    if isinstance(model, MotionModel) and new.sample_time > AHEAD:
        raise BadInput(
            f"{recording.name} has a row every {new.sample_time:.3g} s, but errors of predictions over {AHEAD:g} s "
            f"are compared. Is its time in another unit? Check it with greybox data check."
        )
    folds = _folds(new)
    if len(folds) < 2:
        raise BadInput(
            f"{recording.name} is too short to choose by cross-validation: one run of {2 * FOLD:g} s is needed "
            "(‹seconds›)."
        )
    how = _how(fit)
    unchanged = _errors_in_folds(folds, [model] * len(folds))
    scale = {name: max(float(np.sqrt(np.mean(item))), 1e-12) for name, item in unchanged.items()}
    if not scale:
        raise BadInput(f"{recording.name} has no stretch of {AHEAD:g} s with readings of an output of {model.name}.")
    words = ESTIMATED if free in ("auto", "all") else free
    candidates = [AdaptedCandidate("", np.inf, False, _pieces(unchanged, scale))]
    squares = [unchanged]
    for strength in STRENGTHS if isinstance(model, MotionModel) else STRENGTHS[:1]:
        model_with_prior, fitted = _about(model, fit, names, strength), []
        for number, (train, _) in enumerate(folds, 1):
            say(f"cross-validation with prior strength {strength:g}: part {number} of {len(folds)} held out")
            fitted.append(_fitted(model_with_prior, train, how))
        squares_of_candidate = _errors_in_folds(folds, fitted)
        candidates.append(AdaptedCandidate(words, strength, False, _pieces(squares_of_candidate, scale)))
        squares.append(squares_of_candidate)
    best = chosen(candidates)
    other = chosen(candidates[1:])
    say(f"fitted to {seconds:g} s, and scored on the rest")
    made = {id(item): _adapted(model, fit, names, item, new, how) for item in (candidates[0], best, other)}
    role_of = {"chosen": best, "zero_shot": candidates[0], "adapted": other if best is candidates[0] else best}
    length = 0.0 if rest is None else rest.duration
    outcomes = {}
    for role, item in role_of.items():
        expected = {
            name: foretold(squares[candidates.index(item)][name] / scale[name] ** 2, length, scale[name])
            for name in scale
        }
        scored = {} if rest is None else _ahead(model.with_values(made[id(item)].model.values), rest)
        outcomes[role] = Outcome(item.words, scored, expected)
    result = made[id(best)]
    in_sample = _ahead(model.with_values(result.model.values), new)
    return Adaptation(
        fit=result, chosen=outcomes["chosen"], zero_shot=outcomes["zero_shot"], adapted=outcomes["adapted"],
        choices=dict.fromkeys(scale, best.words),
        tried={
            name: [(item.words, float(np.sqrt(np.mean(square[name]))) / scale[name])
                   for item, square in zip(candidates, squares, strict=True)]
            for name in scale
        },
        delays={}, calibrated={}, moved=moved_from(fit, result.model), seconds=seconds,
        in_sample={name: {"rmse": item.rmse, "fvu_pooled": item.fvu} for name, item in in_sample.items()},
        cpu_seconds=time.process_time() - clock,
    )  # fmt: skip


adapted.register(MotionModel)(adapted_motion)


def _free(fit: Fit, free: str) -> tuple[str, ...]:
    """Names of the free parameters."""
    if isinstance(fit.model, HybridModel):
        adaptable = list(fit.model.carried_on)
    else:
        estimated = [
            parameter.name for parameter in fit.model.parameters if not parameter.fixed and parameter.scope == "model"
        ]
        adaptable = [name for name in estimated if np.all(np.isfinite(fit.sd.get(name, np.nan)))]
    if not adaptable:
        raise BadInput(
            f"No parameter of this fit of {fit.model.name} has a standard deviation, so nothing keeps the parameters "
            "near their estimates. Fit it again until its optimum is confirmed."
        )
    if free in ("auto", "all"):
        return tuple(adaptable)
    names = [word.strip() for word in free.split(",")]
    for name in names:
        if name not in adaptable:
            raise BadInput(
                f"‹free›: {name!r:.40} is not a parameter of this fit of {fit.model.name} that may change."
                f"{near_or_all(name, ['auto', 'all', *adaptable])}"
            )
    return tuple(dict.fromkeys(names))


def _how(fit: Fit) -> FitOptions:
    """Options of the fit, without its certificate and its further starts."""
    options: Mapping[str, Any] = fit.how
    if isinstance(fit.model, HybridModel):
        return FitOptions(
            noise={name: sd for name, sd in fit.stages[0].noise.items() if np.isfinite(sd)}, seed=fit.seed
        )
    counted = {name: float(sd) for name, sd in (options.get("counted") or {}).items() if name in fit.model.outputs}
    return FitOptions(
        solver="gauss-newton", horizon=min(LEAST_SECONDS, options.get("horizon") or LEAST_SECONDS),
        robust=options.get("robust"), start_from=options.get("start_from") or "free", noise=counted, seed=fit.seed,
    )  # fmt: skip


def _about(model: Equations, fit: Fit, names: Sequence[str], strength: float) -> Equations:
    """The model with the old fit as prior of the free parameters; the others are fixed."""
    if isinstance(model, HybridModel):
        return replace(model, carried_on=tuple(names))
    return model.with_parameters(*(_prior(parameter, fit, names, strength) for parameter in model.parameters))


def _prior(parameter: Parameter, fit: Fit, names: Sequence[str], strength: float) -> Parameter:
    if parameter.name not in names:
        return parameter if parameter.scope == "run" else replace(parameter, fixed=True)
    sd = (
        np.maximum(np.asarray(fit.sd[parameter.name], dtype=float), 1e-9 * np.maximum(1.0, np.abs(parameter.array)))
        / strength
    )
    return replace(
        parameter,
        prior=Prior(
            sd if parameter.shape else float(sd), mean=parameter.array if parameter.shape else float(parameter.array)
        ),
    )


Folds = Sequence[tuple[list[Recording], Recording]]


def _folds(new: Recording) -> Folds:
    """Recordings to fit to and the held-out one, for every stretch of some seconds."""
    rows_per_fold, gap = round(FOLD / new.sample_time), round(GAP / new.sample_time)
    result = []
    for first, last in new.runs:
        for start in range(first, last - rows_per_fold + 1, rows_per_fold):
            stop = start + rows_per_fold if last - (start + rows_per_fold) >= rows_per_fold else last
            around = [new.rows(0, max(0, start - gap)), new.rows(min(len(new), stop + gap), len(new))]
            long = [one for item in around for one in _unbroken(item)]
            if long:
                result.append((long, new.rows(start, stop)))
            if stop == last:
                break
    return result


def _unbroken(recording: Recording) -> list[Recording]:
    """The recording's runs that are long enough."""
    if len(recording) < 2:
        return []
    least = round(LEAST_SECONDS / recording.sample_time) + 1
    return [recording.rows(a, b) for a, b in recording.runs if b - a >= least]


def _fitted(held: Equations, train: Sequence[Recording], how: FitOptions) -> Equations:
    if isinstance(held, HybridModel):
        return update_hybrid(held, train, how, quiet).model
    return held.with_values(fit_model(held, train, how=how).model.values)


def _seen(model: Equations, recording: Recording) -> Any:
    """Predictions of a model's outputs over the horizon; for a hybrid model in free run."""
    if isinstance(model, HybridModel):
        return simulate(model, recording)
    predictor = Predictor(Simulator(model), recording, model.values)
    return predictor.ahead(AHEAD)


def _ahead(model: Equations, recording: Recording) -> dict[str, Error]:
    prediction, horizon = _seen(model, recording), AHEAD if isinstance(model, MotionModel) else None
    return prediction_errors(model.outputs, prediction, recording.sample_time, horizon) if len(prediction.rows) else {}


def _errors_in_folds(folds: Folds, models: Sequence[Equations]) -> dict[str, Array]:
    """Output -> mean square error over short pieces of the held-out data."""
    result: dict[str, list[float]] = {}
    for (_, held_out), model in zip(folds, models, strict=True):
        prediction: Prediction = _seen(model, held_out)
        piece = np.asarray(prediction.rows, dtype=int) // max(1, round(SHORT / held_out.sample_time))
        for k, name in enumerate(model.outputs):
            square = (prediction.predicted[:, k] - prediction.measured[:, k]) ** 2
            for number in np.unique(piece):
                finite = square[piece == number]
                finite = finite[np.isfinite(finite)]
                if len(finite):
                    result.setdefault(name, []).append(float(np.mean(finite)))
    return {name: np.array(item) for name, item in result.items()}


def _pieces(squares: Mapping[str, Array], scale: Mapping[str, float]) -> Array:
    """Mean square over the outputs, relative to the unchanged fit's; cut to the pieces that all outputs have."""
    count = min(len(squares[name]) for name in scale)
    return np.asarray(np.mean([squares[name][:count] / scale[name] ** 2 for name in scale], axis=0))


def _adapted(
    model: Equations,
    fit: Fit,
    names: Sequence[str],
    adapted_candidate: AdaptedCandidate,
    new: Recording,
    how: FitOptions,
) -> Fit:
    if not adapted_candidate.free:
        return replace(fit, how={**fit.how, "adapted": adapted_candidate.words})
    model_with_prior = _about(model, fit, names, adapted_candidate.strength)
    if isinstance(model_with_prior, HybridModel):
        trained = update_hybrid(model_with_prior, [new], how, quiet)
        whole = model.with_values(trained.model.values)
        return replace(
            fit, model=whole, stages=(*fit.stages, trained.stage), how={**fit.how, "adapted": adapted_candidate.words}
        )
    result = fit_model(model_with_prior, [new], how=how)
    estimated = {p.name: p.fixed for p in fit.model.parameters}
    freed = result.model.with_parameters(*(replace(p, fixed=estimated[p.name]) for p in result.model.parameters))
    sd = {p.name: result.sd[p.name] if p.name in names else fit.sd.get(p.name, result.sd[p.name])
          for p in freed.parameters}  # fmt: skip
    return replace(
        result,
        model=freed,
        sd=sd,
        stages=(*fit.stages, *result.stages),
        how={**result.how, "adapted": adapted_candidate.words},
    )
