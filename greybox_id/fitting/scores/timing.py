"""Delays of a recording's outputs relative to a model's inputs, run by run.

Clocks of commands and sensors are often synchronised anew for every run. On the recordings of a 1:10 car at 20 Hz the
yaw rate's stamps lie between 35 ms before and 35 ms after those of the training data, and that alone doubles a
network's error; a few seconds determine the delay to some milliseconds. A delay is corrected by shifting the inputs,
interpolated linearly between samples; readings stay unchanged.

`calibrated_timing` estimates the delay of a new run from its first seconds of motion and keeps it. Outputs of parts of
a coupled model have delays of their own, since their readings and inputs may be stamped by different clocks.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...base.statistics import correlation_time
from ...datasets.recording import Recording
from ...engine.simulation import Prediction
from ...engine.trace import Trace
from ...models.memory_model import MemoryModel
from ...models.model import Model, must_be
from ...models.smooth import ROLLING
from ..fit import Fit
from .memory import errors, predictions
from .metrics import Error

CALIBRATED = 5.0
"""Default of the seconds of motion at the start of each run from which its delay is estimated."""
LONGEST = 1e4
"""Largest number of seconds for calibration: a larger one is a typing error."""

SPREAD = 0.03
"""Prior standard deviation of a delay, s: that of `sensor_latency_imu` in models with memory."""
EARLIEST, LATEST = -0.8, 3.0
"""Range of delays, samples: with an output early by a sample, the predicted sample's own inputs would be needed."""
STEP = 0.2
"""Spacing of the delays tried, samples; a parabola interpolates between them."""
FEWEST = 20
"""Readings in motion below which a run keeps its training delay."""
MAY_BE_EARLY = ("yaw_rate",)
"""Outputs that may be early. An acceleration may not: the speed among the inputs is its integral, and inputs after the
reading would leak it."""
DRIVEN_BY = {"steer": "yaw_rate", "motor_current": "a_x", "v_x": "a_x"}
"""Inputs of a coupled model in closed loop -> the output whose delay shifts them; fed-back inputs are not shifted."""
_WRITTEN = re.compile(r"timing(?:\s*=\s*([0-9.eE+-]+)\s*s?)?")


@dataclass(frozen=True)
class RunDelay:
    """The delay of one run.

    Attributes
    ----------
    run : its number, from 0.
    delay, sd : s, and its standard deviation.
    stop : row of the recording after the last one used; the run's end, if the run has no more rows than needed.
    """

    run: int
    delay: float
    sd: float
    stop: int


def run_delays(
    part: MemoryModel, recording: Recording, noise: Mapping[str, float], seconds: float | None = None
) -> list[RunDelay]:
    """The most likely delay of every run from its first seconds of motion, with a normal prior of `SPREAD`.

    Parameters
    ----------
    part : a model whose outputs share a delay.
    recording : the recording.
    noise : output -> standard deviation of its residuals in training.
    seconds : seconds of motion to use from the start of each run; None for all.
    """
    trace, dt = Trace(part), recording.sample_time
    lowest = EARLIEST if set(part.outputs) & set(MAY_BE_EARLY) else 0.0
    lags = np.arange(round(lowest / STEP), round(LATEST / STEP) + 1) * STEP
    counted = np.array([noise[name] for name in part.outputs])
    errors = np.full((len(lags), len(recording), len(part.outputs)), np.nan)
    everywhere = range(len(recording.runs))
    for error, lag in zip(errors, lags, strict=True):
        try:
            prediction = predictions(
                part, aligned(recording, part.inputs, dict.fromkeys(everywhere, lag * dt)), trace=trace
            )
        except BadInput:  # too short for a shifted window
            continue
        error[prediction.rows] = (prediction.predicted - prediction.measured) / counted
    complete = np.all(np.isfinite(errors), axis=(0, 2)) & (moving(recording) > 0)
    result = []
    for number, (start, stop) in enumerate(recording.runs):
        rows = start + np.flatnonzero(complete[start:stop])
        enough = seconds is None or len(rows) > round(seconds / dt)
        rows = rows if seconds is None else rows[: round(seconds / dt)]
        if len(rows) < FEWEST:
            result.append(RunDelay(number, 0.0, SPREAD, start))
            continue
        delay, sd = _most_likely(errors[:, rows], np.asarray(lags * dt, dtype=float))
        result.append(RunDelay(number, delay, sd, int(rows[-1]) + 1 if enough else stop))
    return result


def _most_likely(errors: Array, delays: Array) -> tuple[float, float]:
    """From (delays, rows, outputs) errors in noise standard deviations: the most likely delay and its sd, s."""
    squares = np.sum(errors**2, axis=(1, 2))
    best = errors[int(np.argmin(squares))]
    independent = max(1.0, float(np.mean(best**2))) * correlation_time(best)
    cost = squares / (2 * independent) + (delays / SPREAD) ** 2 / 2
    place, step = int(np.argmin(cost)), delays[1] - delays[0]
    if not 0 < place < len(delays) - 1:
        return float(delays[place]), SPREAD
    below, here, above = cost[place - 1 : place + 2]
    curvature = max(below - 2 * here + above, 1e-12)
    return float(delays[place] + step * (below - above) / (2 * curvature)), float(step / np.sqrt(curvature))


def aligned(recording: Recording, inputs: Sequence[str], delays: Mapping[int, float]) -> Recording:
    """The recording with inputs shifted by the runs' delays, s, to match the readings; NaN beyond a run."""
    signals: dict[str, Any] = {}
    for name in inputs:
        if name not in recording:
            continue
        values = recording[name].copy()
        for run, delay in delays.items():
            start, stop = recording.runs[run]
            at = np.arange(stop - start)
            if delay:
                before = at - delay / recording.sample_time
                values[start:stop] = np.interp(before, at, recording[name][start:stop], left=np.nan, right=np.nan)
        signals[name] = values
    return recording.with_signals(**signals)


def timed(part: MemoryModel, recording: Recording, delays: Mapping[int, float]) -> Prediction:
    """Predictions of a recording with these delays, run -> s; runs not listed have none."""
    used = {run: delay for run, delay in delays.items() if delay}
    return predictions(part, aligned(recording, part.inputs, used) if used else recording)


@dataclass(frozen=True)
class Timing:
    """Delays of the runs of a recording, estimated from their first seconds.

    Attributes
    ----------
    seconds : seconds of motion used in each run; None for all.
    delays : outputs of a part -> a delay for each run.
    """

    seconds: float | None
    delays: Mapping[tuple[str, ...], Sequence[RunDelay]]

    def of(self, outputs: Sequence[str]) -> dict[int, float]:
        """Run, from 0 -> delay of these outputs, s."""
        return {delay.run: delay.delay for delay in self.delays[tuple(outputs)]}

    def looked_at(self, recording: Recording) -> Array:
        """(rows,) whether a row was used to estimate a delay, or comes before one that was."""
        result = np.zeros(len(recording), dtype=bool)
        for several in self.delays.values():
            for item in several:
                result[recording.runs[item.run][0] : item.stop] = True
        return result

    def as_dict(self) -> dict[str, Any]:
        """Run, from 1 -> output -> delay and standard deviation, s."""
        runs: dict[str, dict[str, dict[str, float]]] = {}
        for outputs, several in self.delays.items():
            for item in several:
                of_run = runs.setdefault(str(item.run + 1), {})
                of_run |= {output: {"delay": item.delay, "sd": item.sd} for output in outputs}
        return {"seconds": self.seconds, "runs": runs}


def calibrated_seconds(words: str | Iterable[str] | None) -> float | None:
    """Parse `calibrate` to seconds of motion: "timing" gives `CALIBRATED`, "timing=8s" 8, nothing None.

    Raises
    ------
    BadInput : the text is unknown, or its number of seconds is not above zero.
    """
    several = [words] if isinstance(words, str) else list(words or ())
    if not several:
        return None
    for word in several:
        result = _WRITTEN.fullmatch(word.strip()) if isinstance(word, str) else None
        if result is None:
            raise BadInput(
                f"‹calibrate›: {word!r:.40} is not known. Write timing, or timing=8s to estimate delays from the first "
                "8 s of motion."
            )
    try:
        seconds = CALIBRATED if result is None or result[1] is None else float(result[1])
    except ValueError:
        seconds = np.nan
    if not 0 < seconds < LONGEST:
        raise BadInput(f"‹calibrate›: seconds above zero are needed, as in timing=8s, not {several[-1]!r:.40}.")
    return seconds


def calibration_words(seconds: float) -> str:
    """Name of the protocol that estimates each run's delay from its first seconds of motion and scores the rest."""
    return f"timing calibrated on {seconds:g} s"


def parts_of(model: MemoryModel) -> list[MemoryModel]:
    """The parts of a coupled model at the whole model's values, or the model itself."""
    return [
        part.with_parameters(*(model[parameter.name] for parameter in part.parameters)) for part in model.parts
    ] or [model]


def residual_noise(fit: Fit, recording: Recording) -> dict[str, float]:
    """Standard deviation of residuals in training; on the given recording, if the fit has none stored."""
    model = must_have_timing(fit.model)
    trained_noise = {name: sd for stage in fit.stages for name, sd in stage.noise.items()}
    if set(model.outputs) <= set(trained_noise):
        return {name: max(trained_noise[name], 1e-9) for name in model.outputs}
    return {
        name: max(error.rmse, 1e-9) for name, error in errors(model, predictions(model, recording), "honest").items()
    }


def must_have_timing(model: Model) -> MemoryModel:
    """The model, if its runs have delays that can be estimated. Raises `BadInput` for others."""
    none = (
        f"‹calibrate› is for models with memory, and {model.name} is not one. Add the effect steering_delay or "
        "sensor_latency_yaw to equations of motion, and fit it per run."
    )
    return must_be(MemoryModel, model, none)


def calibrated_timing(fit: Fit, recording: Recording, seconds: float | None = CALIBRATED) -> Timing:
    """The delay of every run of a recording, estimated from its first seconds of motion; the fit stays unchanged.

    Parameters
    ----------
    fit : a fit of a model with memory.
    recording : inputs and readings.
    seconds : seconds of motion to use from the start of each run; None for all.

    Raises
    ------
    BadInput : the model is of another kind, or no rows remain after the first seconds.
    """
    parts = parts_of(must_have_timing(fit.model))
    noise = residual_noise(fit, recording)
    delays_of_parts = {tuple(part.outputs): run_delays(part, recording, noise, seconds) for part in parts}
    timing = Timing(seconds, delays_of_parts)
    if seconds is not None and np.all(timing.looked_at(recording)):
        raise BadInput(
            f"‹calibrate›: {seconds:g} s of motion at the start of each run are used to estimate its delay, and "
            f"nothing of {recording.name} is left to score. Ask for fewer seconds, as in timing=2s, or record longer "
            "runs."
        )
    return timing


def calibrated_predictions(
    model: MemoryModel, recording: Recording, timing: Timing, *, open_loop: bool = True
) -> Prediction:
    """Predictions after the calibrated seconds, with each run's delay corrected.

    Parameters
    ----------
    model : a model with memory.
    recording : inputs and readings.
    timing : the recording's delays, from `calibrated_timing`.
    open_loop : one sample ahead, each part with its own delay; else freely, inputs shifted according to `DRIVEN_BY`.
    """
    predicted, measured = (np.full((len(recording), len(model.outputs)), np.nan) for _ in range(2))
    if open_loop or model.feedback is None:
        for part in parts_of(model):
            prediction = timed(part, recording, timing.of(part.outputs))
            columns = [model.outputs.index(name) for name in part.outputs]
            place = np.ix_(np.asarray(prediction.rows, dtype=np.intp), np.array(columns, dtype=np.intp))
            predicted[place], measured[place] = prediction.predicted, prediction.measured
    else:
        prediction = predictions(model, aligned_together(model, recording, timing), "closed_loop")
        predicted[prediction.rows], measured[prediction.rows] = prediction.predicted, prediction.measured
    scored = np.any(np.isfinite(predicted), axis=1) & np.logical_not(timing.looked_at(recording))
    rows = np.flatnonzero(scored)
    if not len(rows):
        raise BadInput(
            f"Nothing of {recording.name} can be predicted after the seconds of its runs from which "
            "delays were estimated."
        )
    joins = np.searchsorted([start for start, _ in recording.runs], rows, side="right")
    apart = np.concatenate(([False], (np.diff(rows) > 1) | (np.diff(joins) > 0)))
    return Prediction(np.asarray(rows), predicted[rows], measured[rows], np.cumsum(apart))


def aligned_together(model: MemoryModel, recording: Recording, timing: Timing) -> Recording:
    """The recording for all parts at once: every input shifted by the delay of the output that it drives."""
    parts = parts_of(model)
    for part in parts:
        delays = {run: delay for run, delay in timing.of(part.outputs).items() if delay}
        moved = part.inputs if len(parts) == 1 else [n for n in part.inputs if DRIVEN_BY.get(n) in part.outputs]
        recording = aligned(recording, moved, delays) if delays else recording
    return recording


def calibrated_errors(model: MemoryModel, recording: Recording, timing: Timing) -> dict[str, Error]:
    """Pooled errors one sample ahead, after the calibrated seconds of each output's part."""
    result: dict[str, Error] = {}
    for part in parts_of(model):
        result |= errors_after(part, recording, timing.delays[tuple(part.outputs)])
    return result


def errors_after(part: MemoryModel, recording: Recording, delays: Sequence[RunDelay]) -> dict[str, Error]:
    """Errors of a part with delays corrected, after the rows used for them; empty if no window fits."""
    try:
        prediction = timed(part, recording, {delay.run: delay.delay for delay in delays})
    except BadInput:
        return {}
    looked_at = Timing(None, {tuple(part.outputs): delays}).looked_at(recording)
    kept = np.logical_not(looked_at[prediction.rows])
    if not np.any(kept):
        return {}
    return errors(part, prediction.taken(kept), "honest")


def moving(recording: Recording) -> Array:
    """(rows,) whether the vehicle moves, 1 or 0; always 1 if its speed was not recorded."""
    if "v_x" not in recording:
        return np.ones(len(recording))
    return np.where(np.abs(recording["v_x"]) > ROLLING, 1.0, 0.0)
