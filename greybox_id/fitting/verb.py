"""The verb `fit`: from recordings and a model to a `Fit`.

A model with parts is fitted in two steps, as in the papers on model-structured networks: each part alone, on
measured inputs (step 1), then everything together with its own predictions fed back (step 2).
The result is judged on training and held-out data: by errors compared with persistence, and by a verdict.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ..base.errors import BadInput
from ..base.numbers import number
from ..datasets.checks.consistency import standing
from ..datasets.checks.finding import Finding, FoundAt, Severity
from ..datasets.checks.repeats import check_repeats, seen
from ..datasets.recording import Recording, join
from ..engine.motion.simulator import Simulator
from ..engine.motion.traced import traced_once
from ..models.model import Model, by_kind
from ..models.motion_model import MotionModel
from .attempt import refitted
from .fit import NOT_USABLE, USABLE, WITH_CARE, Fit, Reason, Verdict, with_reason
from .holding import IN_MOTION, WORDS, Holding, as_fitted, in_doubt, other_than, reason, weighed, with_hold
from .how import FitOptions, Say, Solver, quiet
from .pretraining import Pretraining
from .provenance import DataRecord, data_record
from .scores.metrics import Scores, as_dict, score, score_with_persistence, unfitted_scores
from .scores.timing import calibrated_errors, calibrated_seconds, calibrated_timing, calibration_words, must_have_timing
from .scores.verdict import (
    HELD_OUT,
    TRAINED,
    WORSE,
    conditional,
    distrust,
    fitted_to,
    judged,
    times_as_large,
    used_signals,
)  # fmt: skip
from .training import TrainedBefore

UNCOMPARED = Reason(WITH_CARE, "Interrupted before the fit was compared with other fits to the same data.")
"""Reason against a fit whose judgement was interrupted."""


@dataclass(frozen=True)
class Judgement:
    """Scores of a fit and its verdict.

    Attributes
    ----------
    scores : role or recording -> protocol -> output -> its error.
    persistence : the same for persistence, for kinds of models that are compared with it.
    verdict : the verdict on the fit.
    """

    scores: Mapping[str, Scores]
    persistence: Mapping[str, Scores]
    verdict: Verdict


@by_kind
def carried(model: Model, fit: Fit, recording: Recording, name: str = "") -> list[Reason]:
    """A reason against a fit whose parameters do not carry over to a recording; empty if they do, or without a test.

    Parameters
    ----------
    model : the fit's model.
    fit : the fit.
    recording : a held-out recording.
    name : its name in the sentence.
    """
    return []


@by_kind
def refuted(model: Model, fit: Fit, recording: Recording) -> Iterable[Reason]:
    """Reasons against a fit from other fits to its training data; empty if there are none, or without a test.

    Parameters
    ----------
    model : the fit's model.
    fit : the fit.
    recording : its training data.
    """
    return []


def judgement(
    fit: Fit,
    recordings: Mapping[str, Recording],
    findings: Mapping[str, Sequence[Finding]],
    data: Sequence[DataRecord] | None = None,
    compared: bool = True,
) -> Judgement:
    """Score a fit, and judge it.

    Parameters
    ----------
    fit : the fit.
    recordings : by role or name; "train" is the training data, all others were held out.
    findings, data : as in `judged`.
    compared : whether other fits to the same data, and to held-out data, may contradict it.
    """
    recordings = {name: as_fitted(fit, recording) for name, recording in recordings.items()}
    both = {name: score_with_persistence(fit.model, recording) for name, recording in recordings.items()}
    scores_by_role = {name: scores for name, (scores, _) in both.items()}
    persistence = {name: of_persistence for name, (_, of_persistence) in both.items() if of_persistence}
    unseen = {name: recording for name, recording in recordings.items() if name != TRAINED}
    before = {name: unfitted_scores(fit, recording) for name, recording in (unseen or recordings).items()}
    verdict, against = (
        judged(fit, scores_by_role, persistence=persistence, unfitted=before, findings=findings, data=data),
        list[Reason](),
    )
    if compared and verdict.usability == USABLE:
        for name, recording in unseen.items():
            against += carried(fit.model, fit, recording, "" if name == HELD_OUT else name)
    if compared and verdict.usability != NOT_USABLE and TRAINED in recordings:
        against += refuted(fit.model, fit, recordings[TRAINED])
    if against:
        verdict = judged(
            fit, scores_by_role, persistence=persistence, unfitted=before, findings=findings, data=data, more=against
        )
    return Judgement(scores_by_role, persistence, conditional(fit, verdict))


__all__ = ["FitOptions", "FitTask", "Say", "Solver", "estimated", "fit"]


@dataclass(frozen=True)
class FitTask:
    """A task of fitting: data, options and candidate structures.

    Attributes
    ----------
    recordings, validate, how, say, pretraining : as in `fit`.
    structures : models for cross-validation to choose from; a single one if there is no choice.
    """

    recordings: Sequence[Recording]
    validate: Recording | None
    how: FitOptions
    say: Say
    structures: Sequence[Model]
    pretraining: Pretraining | TrainedBefore | None = None


@by_kind
def estimated(model: Model, task: FitTask) -> Fit:
    """Fit by the method of the model's kind; errors, verdict and provenance are added afterwards.

    Raises
    ------
    BadInput : as `fit`; faults of the validation recording are reported before the work.
    """
    raise BadInput(f"{model.name} is {model.called}, which cannot be fitted.")


def fit(
    model: Model | Sequence[Model],
    recordings: Sequence[Recording],
    *,
    validate: Recording | None = None,
    how: FitOptions | None = None,
    say: Say | None = None,
    command: str = "",
    pretraining: Pretraining | TrainedBefore | None = None,
    sensors: Mapping[str, float] | None = None,
) -> Fit:
    """Fit a model to recordings.

    Parameters
    ----------
    model : its nominal values are the starting point. Of several structures, blocked cross-validation on the training
        data chooses one.
    recordings : training data, in SI units.
    validate : held-out recording, only scored, except under early stopping, where it chooses when to stop.
    how : strengths, solver, starts, seed.
    say : called with one line of progress at a time.
    command : command that reproduces the fit, for the record.
    pretraining : a known vehicle on which a feed-forward network is pretrained; or a trained hybrid model with a
        memory, whose training is continued instead of the model's.
    sensors : output -> standard deviation of its sensor, from the vehicle's file, against which residuals are judged.

    Returns
    -------
    Fit. Ctrl-C keeps the best point so far and is recorded in the stage's status; after the last stage, in the verdict.

    Raises
    ------
    BadInput : the recordings lack a signal, differ in sample time, are too short, or their time does not increase.
    """
    how, say = how or FitOptions(), say or quiet
    for recording in [*recordings, *([] if validate is None else [validate])]:
        recording.must_run()
    models = [model] if isinstance(model, Model) else list(model)
    with traced_once(), threadpool_limits(1):  # matrices are small: a second BLAS thread only spins
        task = FitTask(recordings, validate, how, say, models, pretraining)
        task, stood = _moving(models[0], task)
        result, task, holding = _between_rows(estimated(models[0], task), task)
        recordings, validate = task.recordings, task.validate
        sensor_sd = {name: sd for name, sd in (sensors or {}).items() if name in result.model.outputs}
        extra: dict[str, Any] = {"sensors": sensor_sd} if sensor_sd else {}
        extra |= {"stood": stood} if stood else {}
        result = replace(result, data=_records(recordings, validate), command=command, how={**result.how, **extra})
        try:
            return _judged(result, task, holding)
        except KeyboardInterrupt:
            say(f"{result.model.name}: interrupted while it was judged; computing its errors")
            return _judged(result, task, holding, UNCOMPARED)


def _judged(result: Fit, task: FitTask, holding: Holding | None, uncompared: Reason | None = None) -> Fit:
    """The fit with its errors on the task's recordings and a verdict, without refits if a reason for that is given."""
    recordings, validate = task.recordings, task.validate
    by_role = {"train": join(recordings, "training data"), **({} if validate is None else {"validate": validate})}
    scores = judgement(result, by_role, _findings(result, recordings, validate), compared=uncompared is None)
    metrics = {role: as_dict(of_role) for role, of_role in scores.scores.items()}
    verdict = with_reason(scores.verdict, reason(result, holding) if holding else None)
    verdict = with_reason(verdict, uncompared or _without_last(result, task, scores.scores))
    result = replace(result, metrics=metrics, verdict=conditional(result, verdict))
    seconds = calibrated_seconds(task.how.calibrate)
    return result if seconds is None or validate is None else _calibrated(result, validate, seconds)


def _moving(model: Model, task: FitTask) -> tuple[FitTask, float]:
    """The task without rows in which the vehicle stands under its brake, and how long it stood, s.

    The drive's force is invisible there: the brake holds whatever force is needed.
    """
    if not isinstance(model, MotionModel) or "drive" not in model.inputs or "v_x" not in model.outputs:
        return task, 0.0
    result, stood = [], 0.0
    for recording in task.recordings:
        moving = ~standing(recording)
        if not moving.all() and moving.any():
            stood += float(np.count_nonzero(~moving)) * recording.sample_time
            recording = recording.keep(moving, IN_MOTION)
        result.append(recording)
    if not stood:
        return task, 0.0
    task.say(
        f"{model.name}: {number(stood, 3)} s in which the vehicle stood still with its brake on are left out of "
        f"the fit: no force can be seen there"
    )
    return replace(task, recordings=result), stood


def _between_rows(fit: Fit, task: FitTask) -> tuple[Fit, FitTask, Holding | None]:
    """The fit with commands held or interpolated between rows, the likelier if no map says; and the comparison."""
    holding = weighed(fit, task.recordings, task.how)
    if holding is None:
        return fit, task, None
    step = min(recording.sample_time for recording in task.recordings)
    if not holding.stated and holding.gain < 0:
        task.say(
            f"{fit.model.name}: the column map does not state hold, that is, whether commands are held or interpolated "
            f"between rows; fitting again with commands {WORDS[other_than(holding.taken)]}, to keep the fit with the "
            "higher likelihood"
        )
        hold = other_than(holding.taken)
        recordings = [with_hold(recording, hold) for recording in task.recordings]
        validate = None if task.validate is None else with_hold(task.validate, hold)
        task = replace(task, recordings=recordings, validate=validate)
        first, nominal = fit, task.structures[0]
        fit = estimated(nominal if holding.values is None else nominal.with_values(holding.values), task)
        fit = replace(fit, how={**fit.how, "unfitted": first.how.get("unfitted", {})})
        holding = weighed(fit, task.recordings, task.how) or holding
    return in_doubt(fit, holding, step), task, holding


def _without_last(fit: Fit, task: FitTask, scores: Mapping[str, Scores]) -> Reason | None:
    """A reason against a fit that predicts the held-out recording worse than a refit without its last effect."""
    free = [name for name in fit.model.effects if name in fit.model and not fit.model[name].fixed]
    if task.validate is None or not isinstance(fit.model, MotionModel) or not fit.confirmed or not free:
        return None
    last = fit.model[free[-1]]
    if last.null is None:
        return None
    without = fit.model.with_parameters(replace(last.with_value(last.null), fixed=True, prior=None))
    task.say(f"{fit.model.name}: refitting without {last.name}, for comparison")
    once = replace(task.how, starts=1, solver="gauss-newton")
    p = refitted(Simulator(without), task.recordings, without.values, once)
    if p is None:
        return None
    times = times_as_large(scores["validate"], score(without.with_values(p), task.validate))
    if not times > WORSE:
        return None
    return Reason(
        NOT_USABLE,
        f"On the held-out recording, errors are {number(times, 2)} times those of the same fit without {last.name}: "
        f"leave this effect out.",
    )


def _calibrated(fit: Fit, validate: Recording, seconds: float) -> Fit:
    """The fit with scores on the validation recording after calibrating each run's delay."""
    timing = calibrated_timing(fit, validate, seconds)
    calibrated = as_dict({calibration_words(seconds): calibrated_errors(must_have_timing(fit.model), validate, timing)})
    metrics = {**fit.metrics, "validate": {**fit.metrics["validate"], **calibrated}}
    return replace(fit, metrics=metrics, how={**fit.how, "timing": {**fit.how["timing"], "validate": timing.as_dict()}})


def _findings(fit: Fit, recordings: Sequence[Recording], validate: Recording | None) -> dict[str, list[Finding]]:
    """Findings of the checks on a fit's data, by role."""
    used = used_signals(fit.model)
    trained = join(recordings, "training data")
    result = {"train": [item for recording in recordings for item in distrust(used, recording, faults=True)]}
    result["train"] += check_repeats(trained)
    if validate is None:
        return result
    return result | {"validate": [*distrust(used, validate, faults=True), *_seen(fit, validate, trained)]}


def _seen(fit: Fit, validate: Recording, trained: Recording) -> Iterator[Finding]:
    """A finding if held-out rows are rows of the training data, under another name or on another clock."""
    share = seen(validate, trained)
    if share > 0.0 and not any(fitted_to(fit, fit.data)):  # which reports the same file itself
        sentence = (
            f"{100 * share:.0f} % of its rows are rows to which the model was fitted: errors on them prove nothing. "
            f"Hold "
            "out another recording."
        )
        yield Finding("seen", Severity.WARNING, FoundAt("time"), sentence, share)


def _records(recordings: Sequence[Recording], validate: Recording | None) -> tuple[DataRecord, ...]:
    return (
        *(data_record(recording, "train") for recording in recordings),
        *((data_record(validate, "validate"),) if validate is not None else ()),
    )
