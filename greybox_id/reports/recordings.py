"""The recordings of a fit, matched with those given, and the model's predictions of them.

For equations of motion, also predictions over every horizon and by persistence.

Sensor noise, measured where the vehicle's motion does not vary: straight at constant speed, or at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..base.statistics import detrended
from ..datasets.recording import Recording
from ..engine.motion.schedule import MotionRun, recorded_outputs
from ..engine.motion.simulator import Predictor, Simulator
from ..engine.simulation import Prediction
from ..fitting.fit import Fit
from ..fitting.holding import as_seen
from ..fitting.provenance import DataRecord
from ..fitting.scores.metrics import FREE_RUN, HORIZONS, Error, ahead, prediction_errors
from ..fitting.scores.motion import persisted
from ..models.motion_model import MotionModel

SECONDS = 15.0
"""Length of a typical stretch, s."""


@dataclass(frozen=True)
class Seen:
    """A recording of a fit, with the model's predictions.

    Attributes
    ----------
    role : "train" or "validate".
    recording : the rows that the fit used.
    outputs : outputs of the model that are recorded.
    predicted : protocol -> predictions of them; simulations only if the model can run in closed loop.
    """

    role: str
    recording: Recording
    outputs: tuple[str, ...]
    predicted: Mapping[str, Prediction]

    @property
    def main(self) -> str:
        """The main protocol for scores: free run or closed loop if the model has it."""
        return next((name for name in (FREE_RUN, "closed_loop") if name in self.predicted), "honest")


AnySeen = TypeVar("AnySeen", bound=Seen)


def matched(fit: Fit, recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """The recordings of a fit, in its order. Raises `BadInput` if one is missing or is another file."""
    return tuple(as_seen(fit, _match(record, recordings)) for record in fit.data)


def of_role(recordings: Sequence[AnySeen], role: str) -> tuple[AnySeen, ...]:
    """The recordings of one role, train or validate."""
    return tuple(one for one in recordings if one.role == role)


def shown_first(recordings: Sequence[AnySeen]) -> AnySeen:
    """The recording to show: the longest held-out one, or the longest if none was held out."""
    choice = of_role(recordings, "validate") or tuple(recordings)
    return max(choice, key=lambda one: len(one.recording))


def run_rows(one: Seen, protocol: str) -> list[tuple[int, Prediction]]:
    """Predictions per run of a recording, with the run's number, from 1; runs without predictions are left out."""
    whole = one.predicted[protocol]
    result = []
    for number, ends in enumerate(one.recording.runs, 1):
        inside = slice(*np.searchsorted(whole.rows, ends).tolist())
        if inside.stop > inside.start:
            result.append((number, whole.taken(inside)))
    return result


def typical_stretch(one: Seen) -> tuple[int, int]:
    """The rows of the stretch whose error is nearest to that of the whole recording: neither its best nor its worst.

    The error is the mean over the outputs of the mean square, each divided by that over the whole recording.
    """
    whole = one.predicted[one.main]
    average = _mean_squares(whole, len(whole.rows))
    length = max(2, round(SECONDS / one.recording.sample_time))
    best, least = (int(whole.rows[0]), int(whole.rows[-1]) + 1), np.inf
    parts = [part for _, part in run_rows(one, one.main)]
    length = min(length, max(len(part.rows) for part in parts))
    for part in (part for part in parts if len(part.rows) >= length):
        means = _mean_squares(part, length)
        distance = np.abs(np.log(np.maximum(np.mean(means / np.maximum(average, 1e-300), axis=1), 1e-12)))
        k = int(np.argmin(distance))
        if distance[k] < least:
            best, least = (int(part.rows[k]), int(part.rows[k + length - 1]) + 1), float(distance[k])
    return best


def _mean_squares(part: Prediction, length: int) -> Array:
    """(windows, outputs) mean square of the residuals over every window of this length, without NaN."""
    residual = part.predicted - part.measured
    finite = np.isfinite(residual)

    def sums(values: Array) -> Array:
        total = np.cumsum(np.vstack([np.zeros(values.shape[1]), values]), axis=0)
        return np.asarray(total[length:] - total[:-length])

    squares = np.where(finite, residual, 0.0) ** 2
    return np.asarray(sums(squares) / np.maximum(sums(finite.astype(float)), 1.0))


def _match(record: DataRecord, recordings: Sequence[Recording]) -> Recording:
    if not recordings:
        raise BadInput(f"The {record.role} data of the fit are {_named(record)}, but no recording was given; name it.")
    same = [r for r in recordings if r.source.sha256 == record.sha256 and (record.sha256 or r.name == record.name)]
    if not same:
        near = [r for r in recordings if r.name == record.name]
        if near:
            raise BadInput(
                f"{_where(near[0])} is not the file the fit was made with: its sha256 begins with "
                f"{near[0].source.sha256[:12] or 'nothing'}, that of the fit's {record.role} data with "
                f"{record.sha256[:12] or 'nothing'}. Name the file the fit was made with, or fit again."
            )
        given = ", ".join(_where(r) for r in recordings)
        raise BadInput(
            f"The {record.role} data of the fit are {_named(record)}, and none of the recordings given ({given}) is "
            "that file. Name the file the fit was made with, or fit again."
        )
    alike = [
        r for r in same if (len(r), len(r.runs), r.source.columns) == (record.samples, record.runs, record.columns)
    ]
    if not alike:
        other = same[0]
        raise BadInput(
            f"{_where(other)} is the file the fit was made with, but read differently: {len(other)} rows in "
            f"{len(other.runs)} runs through column map {other.source.columns or 'none'}, where the fit had "
            f"{record.samples} rows in {record.runs} runs through {record.columns or 'none'}. "
            "Read it through that column map, or fit again."
        )
    return alike[0]


def _named(record: DataRecord) -> str:
    return record.path or record.name


def _where(recording: Recording) -> str:
    return recording.source.path or recording.name


SHOWN = ("alpha_f", "alpha_r")
"""Quantities whose values during driving are shown."""

MOVING = 0.25
"""Share of the top speed above which samples count as moving."""

Errors = Mapping[str, Mapping[str, Error]]
"""Protocol -> output -> error."""


@dataclass(frozen=True)
class Driven(Seen):
    """A recording of a fit, with predictions over every horizon and in free run.

    Attributes
    ----------
    held : protocol -> predictions of the same rows by persistence.
    quantities : name -> values during driving, as predicted shortly after each reading.
    """

    held: Mapping[str, Prediction]
    quantities: Mapping[str, Array]


def driven(
    model: MotionModel, fit: Fit, recordings: Sequence[Recording], horizons: Sequence[float] = HORIZONS
) -> tuple[Driven, ...]:
    """The recordings of a fit, in its order, with predictions.

    Parameters
    ----------
    model, fit, recordings : the fit, its model and its recordings.
    horizons : of the model's predictions besides the free run, s; persistence has all of `HORIZONS`.

    Raises
    ------
    BadInput : if a recording of the fit is missing, or is another file.
    """
    shown = tuple(name for name in SHOWN if name in model.quantities and name not in model.outputs)
    simulator = Simulator(replace(model, outputs=(*model.outputs, *shown)))
    return tuple(
        _driven(record, recording, model, simulator, horizons)
        for record, recording in zip(fit.data, matched(fit, recordings), strict=True)
    )


def held_errors(recordings: Sequence[Driven]) -> dict[str, Errors]:
    """Role -> protocol -> output -> error of persistence."""
    result: dict[str, Errors] = {}
    for role in dict.fromkeys(one.role for one in recordings):
        of_this_role = of_role(recordings, role)
        outputs = tuple(name for name in of_this_role[0].outputs if all(name in one.outputs for one in of_this_role))
        protocols = dict.fromkeys(protocol for one in of_this_role for protocol in one.held)
        result[role] = {
            protocol: prediction_errors(
                outputs, _joined(of_this_role, protocol, outputs), of_this_role[0].recording.sample_time
            )
            for protocol in protocols
        }
    return result


def typical_speed(recordings: Sequence[Driven]) -> float:
    """Median of the recorded speed while moving, m/s; 1 if none was recorded."""
    speeds = [one.recording["v_x"] for one in recordings if "v_x" in one.recording]
    every_speed = np.concatenate([np.empty(0), *speeds])
    moving = every_speed[np.isfinite(every_speed) & (every_speed > MOVING * np.nanmax(every_speed, initial=0.0))]
    return float(np.median(moving)) if len(moving) else 1.0


def _driven(
    record: DataRecord, recording: Recording, model: MotionModel, simulator: Simulator, horizons: Sequence[float]
) -> Driven:
    predictor = Predictor(simulator, recording, model.values)
    each = zip(predictor.each_ahead(horizons), horizons, strict=True)
    by_horizon = {ahead(horizon): (prediction, horizon) for prediction, horizon in each}
    predictions: dict[str, tuple[Prediction, float | None]] = {n: p for n, p in by_horizon.items() if len(p[0].rows)}
    predictions[FREE_RUN] = (predictor.free_run(), None)
    rows = {ahead(h): (_rows_of(*next(iter(by_horizon.values())), h, predictor.runs), h) for h in HORIZONS}
    kept = {n: p for n, p in rows.items() if len(p[0].rows)} | {FREE_RUN: predictions[FREE_RUN]}
    outputs = recorded_outputs(model, recording)
    columns = [model.outputs.index(name) for name in outputs]
    soon, _ = next(iter(predictions.values()))
    return Driven(
        role=record.role,
        recording=recording,
        outputs=outputs,
        predicted={name: _of(item, columns) for name, (item, _) in predictions.items()},
        held={name: _of(persisted(item, predictor.runs, horizon), columns) for name, (item, horizon) in kept.items()},
        quantities={
            name: values[np.isfinite(values)]
            for name, values in zip(simulator.trace.model.outputs, soon.predicted.T, strict=True)
            if name in SHOWN
        },
    )


def _rows_of(prediction: Prediction, near: float, horizon: float, runs: Sequence[MotionRun]) -> Prediction:
    """The rows that would be predicted over a horizon, derived from those predicted over a shorter one."""
    rows, number, measured = [], [], []
    for k, run in enumerate(runs):
        near_steps, steps = (max(1, round(item / run.sample_time)) for item in (near, horizon))
        later = prediction.rows[prediction.run == k] - run.rows.start - near_steps + steps
        later = later[later < len(run)]
        rows.append(run.rows.start + later)
        number.append(np.full(len(later), k))
        measured.append(run.measured[later])
    read = np.vstack(measured)
    return Prediction(np.concatenate(rows), np.full(read.shape, np.nan), read, np.concatenate(number))


def _of(prediction: Prediction, columns: Sequence[int]) -> Prediction:
    """Some outputs of predictions, in the order of the recording's rows."""
    chosen = prediction.taken(np.argsort(prediction.rows, kind="stable")).of(columns)
    return replace(chosen, predicted=np.where(np.isinf(chosen.predicted), np.nan, chosen.predicted))


def _joined(recordings: Sequence[Driven], protocol: str, outputs: Sequence[str]) -> Prediction:
    """Predictions by persistence of several recordings, concatenated."""
    parts = [(one, one.held[protocol]) for one in recordings if protocol in one.held]
    places = [[one.outputs.index(name) for name in outputs] for one, _ in parts]
    return Prediction(
        rows=np.concatenate([part.rows for _, part in parts]),
        predicted=np.vstack([part.predicted[:, k] for (_, part), k in zip(parts, places, strict=True)]),
        measured=np.vstack([part.measured[:, k] for (_, part), k in zip(parts, places, strict=True)]),
        run=np.concatenate([part.run for _, part in parts]),
    )


REST_SHARE = 0.003
"""At rest: slower than this share of the top speed (the 99 % quantile of speed)."""
MOVING_SHARE, STEADY_SHARE = 0.2, 0.05
"""Straight at constant speed: faster than the first share of the top speed, with smoothed yaw rate and change of speed
below the second share of their own 99 % quantile, or below the limits that count as none."""
NO_TURN, NO_CHANGE = 0.01, 0.02
"""Yaw rate, rad/s, and relative change of speed, 1/s, that count as none."""
SMOOTHING = 0.5
"""Duration over which yaw rate and speed are smoothed for this, s."""
STRAIGHT_SECONDS, REST_SECONDS = 2.0, 1.0
"""Least length of a stretch, s."""


@dataclass(frozen=True)
class Noise:
    """Stretches of recordings that contain only sensor noise.

    Attributes
    ----------
    where : "straight at constant speed" or "at rest".
    stretches : recording, first row and end row of each.
    """

    where: str
    stretches: tuple[tuple[Recording, int, int], ...]

    @property
    def seconds(self) -> float:
        """Total duration of the stretches."""
        return float(sum((stop - start) * recording.sample_time for recording, start, stop in self.stretches))

    def of(self, name: str) -> list[Array]:
        """A signal in every stretch in which it has no NaN, detrended."""
        result = [recording[name][start:stop] for recording, start, stop in self.stretches if name in recording]
        return [detrended(values) for values in result if np.all(np.isfinite(values))]

    def sd(self, name: str) -> float:
        """Standard deviation of the noise of a signal; NaN if it was not recorded."""
        parts = self.of(name)
        return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else float("nan")


def noise(recordings: Sequence[Recording]) -> Noise | None:
    """Stretches with noise alone: straight at constant speed, or at rest if there are none; None if neither exists."""
    for where, stretches in (("straight at constant speed", _straight), ("at rest", _at_rest)):
        result = tuple((r, a, b) for r in recordings if "v_x" in r for a, b in stretches(r))
        if result:
            return Noise(where, result)
    return None


def _at_rest(recording: Recording) -> list[tuple[int, int]]:
    speed = np.abs(recording["v_x"])
    return _stretches(speed < REST_SHARE * _top(speed), recording, REST_SECONDS)


def _straight(recording: Recording) -> list[tuple[int, int]]:
    if "yaw_rate" not in recording:
        return []
    speed = recording["v_x"]
    turning, slope = np.abs(_smooth(recording, "yaw_rate")), np.zeros(len(recording))
    smooth = _smooth(recording, "v_x")
    for start, stop in recording.runs:
        if stop - start > 1:
            slope[start:stop] = np.abs(np.gradient(smooth[start:stop], recording.sample_time))
    top = _top(np.abs(speed))
    quiet = (speed > MOVING_SHARE * top) & (turning < max(STEADY_SHARE * _top(turning), NO_TURN))
    steady = slope < max(STEADY_SHARE * _top(slope), NO_CHANGE * top)
    return _stretches(quiet & steady, recording, STRAIGHT_SECONDS)


def _smooth(recording: Recording, name: str) -> Array:
    """Signal smoothed within runs; a missing value makes its neighbours missing."""
    length = max(1, round(SMOOTHING / recording.sample_time)) | 1
    result = recording[name].copy()
    for start, stop in recording.runs:
        mirrored = np.pad(recording[name][start:stop], length // 2, "symmetric")
        result[start:stop] = np.convolve(mirrored, np.full(length, 1.0 / length), "valid")
    return result


def _top(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, 0.99)) if finite.size else 0.0


def _stretches(quiet: NDArray[np.bool_], recording: Recording, seconds: float) -> list[tuple[int, int]]:
    """Row ranges within runs in which `quiet` holds for long enough."""
    least, result = round(seconds / recording.sample_time), []
    for start, stop in recording.runs:
        edges = np.flatnonzero(np.diff(np.concatenate(([0], quiet[start:stop].astype(np.int8), [0]))))
        result += [(start + int(a), start + int(b)) for a, b in edges.reshape(-1, 2) if b - a >= least]
    return result
