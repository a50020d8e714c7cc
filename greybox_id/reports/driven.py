"""The recordings of a fit of equations of motion: what the model predicts of them, and what holding a reading would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..engine.motion.prediction import Predictor
from ..engine.motion.runs import MotionRun, recorded_outputs
from ..engine.motion.simulator import Simulator
from ..engine.simulation import Prediction
from ..fitting.fit import Fit
from ..fitting.provenance import DataRecord
from ..fitting.scores.metrics import FREE_RUN, HORIZONS, Error, ahead, prediction_errors
from ..fitting.scores.motion import hold
from ..models.motion_model import MotionModel
from .recordings import Seen, matched, of_role

SHOWN = ("alpha_f", "alpha_r")
"""Quantities whose values along the drive are shown."""

MOVING = 0.25
"""Samples count as moving when they are faster than this share of the top speed."""

Errors = Mapping[str, Mapping[str, Error]]
"""Protocol -> output -> error."""


@dataclass(frozen=True)
class Driven(Seen):
    """A recording that a fit saw, with predictions over every horizon and in free run.

    Attributes
    ----------
    held : protocol -> the same rows predicted by holding the reading they are predicted from.
    quantities : name -> values along the drive, as the model has them a little after each reading.
    """

    held: Mapping[str, Prediction]
    quantities: Mapping[str, Array]


def driven(
    model: MotionModel, fit: Fit, recordings: Sequence[Recording], horizons: Sequence[float] = HORIZONS
) -> tuple[Driven, ...]:
    """The recordings of a fit, in its order, with predictions.

    Parameters
    ----------
    model, fit, recordings : the fit, its model and what it saw.
    horizons : s, over which the model predicts, beside the free run; what is held is told over all of `HORIZONS`.

    Raises
    ------
    BadInput : one that the fit saw is missing, or is another file.
    """
    shown = tuple(name for name in SHOWN if name in model.quantities and name not in model.outputs)
    simulator = Simulator(replace(model, outputs=(*model.outputs, *shown)))
    return tuple(
        _driven(record, recording, model, simulator, horizons)
        for record, recording in zip(fit.data, matched(fit, recordings), strict=True)
    )


def held_errors(recordings: Sequence[Driven]) -> dict[str, Errors]:
    """Role -> protocol -> output -> the error of holding the reading that a prediction starts from."""
    result: dict[str, Errors] = {}
    for role in dict.fromkeys(one.role for one in recordings):
        value = of_role(recordings, role)
        outputs = tuple(name for name in value[0].outputs if all(name in one.outputs for one in value))
        protocols = dict.fromkeys(protocol for one in value for protocol in one.held)
        result[role] = {
            protocol: prediction_errors(outputs, _joined(value, protocol, outputs), value[0].recording.sample_time)
            for protocol in protocols
        }
    return result


def typical_speed(recordings: Sequence[Driven]) -> float:
    """The speed that half of the recorded samples are below, of those that move; 1 m/s where none was recorded."""
    speeds = [one.recording["v_x"] for one in recordings if "v_x" in one.recording]
    known = np.concatenate([np.empty(0), *speeds])
    moving = known[np.isfinite(known) & (known > MOVING * np.nanmax(known, initial=0.0))]
    return float(np.median(moving)) if len(moving) else 1.0


def _driven(
    record: DataRecord, recording: Recording, model: MotionModel, simulator: Simulator, horizons: Sequence[float]
) -> Driven:
    predictor = Predictor(simulator, recording, model.values)
    result = {ahead(horizon): (predictor.ahead(horizon), horizon) for horizon in horizons}
    every: dict[str, tuple[Prediction, float | None]] = {n: p for n, p in result.items() if len(p[0].rows)}
    every[FREE_RUN] = (predictor.free_run(), None)
    rows = {ahead(h): (_rows_of(*next(iter(result.values())), h, predictor.runs), h) for h in HORIZONS}
    kept = {n: p for n, p in rows.items() if len(p[0].rows)} | {FREE_RUN: every[FREE_RUN]}
    outputs = recorded_outputs(model, recording)
    columns = [model.outputs.index(name) for name in outputs]
    soon, _ = next(iter(every.values()))
    return Driven(
        role=record.role,
        recording=recording,
        outputs=outputs,
        predicted={name: _of(item, columns) for name, (item, _) in every.items()},
        held={name: _of(hold(item, predictor.runs, horizon), columns) for name, (item, horizon) in kept.items()},
        quantities={
            name: values[np.isfinite(values)]
            for name, values in zip(simulator.trace.model.outputs, soon.predicted.T, strict=True)
            if name in SHOWN
        },
    )


def _rows_of(prediction: Prediction, near: float, horizon: float, runs: Sequence[MotionRun]) -> Prediction:
    """The rows that would be predicted over a horizon, told by those that are over a nearer one."""
    rows, number, measured = [], [], []
    for k, run in enumerate(runs):
        first, later = (max(1, round(item / run.sample_time)) for item in (near, horizon))
        value = prediction.rows[prediction.run == k] - run.rows.start - first + later
        value = value[value < len(run)]
        rows.append(run.rows.start + value)
        number.append(np.full(len(value), k))
        measured.append(run.measured[value])
    read = np.vstack(measured)
    return Prediction(np.concatenate(rows), np.full(read.shape, np.nan), read, np.concatenate(number))


def _of(prediction: Prediction, columns: Sequence[int]) -> Prediction:
    """Some outputs of predictions, in the order of the recording's rows."""
    value = prediction.taken(np.argsort(prediction.rows, kind="stable")).of(columns)
    return replace(value, predicted=np.where(np.isinf(value.predicted), np.nan, value.predicted))


def _joined(recordings: Sequence[Driven], protocol: str, outputs: Sequence[str]) -> Prediction:
    """What holding predicts of several recordings, one after the other."""
    parts = [(one, one.held[protocol]) for one in recordings if protocol in one.held]
    places = [[one.outputs.index(name) for name in outputs] for one, _ in parts]
    return Prediction(
        rows=np.concatenate([part.rows for _, part in parts]),
        predicted=np.vstack([part.predicted[:, k] for (_, part), k in zip(parts, places, strict=True)]),
        measured=np.vstack([part.measured[:, k] for (_, part), k in zip(parts, places, strict=True)]),
        run=np.concatenate([part.run for _, part in parts]),
    )
