"""How much later than a model's inputs its outputs are stamped in a recording, run by run.

Clocks of commands and sensors are often joined anew for every run. On the recordings of a 1:10 car at 20 Hz the yaw
rate's stamps lie between 35 ms early and 35 ms late of those that a network was trained on, and that alone doubles its
error; a few seconds tell it to some milliseconds. What is late is taken back by moving the inputs, straight lines
between samples; readings stay what they are.

What a new run's delay is can be told from its first seconds of motion and is then held: `calibrated_timing`. Outputs of
parts of a coupled model have delays of their own, since their readings and what drives them may be stamped by different
clocks.
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
"""Seconds of motion at the start of each run that tell its delay, unless other ones are asked for."""
LONGEST = 1e4
"""Seconds above which no run is calibrated: what is longer is a mistyped number."""

SPREAD = 0.03
"""Standard deviation of a delay before a run is seen, s: what `sensor_latency_imu` states of maps with memory."""
EARLIEST, LATEST = -0.8, 3.0
"""Delays looked for, samples: one that is early by a sample would need inputs of the very sample to be predicted."""
STEP = 0.2
"""Between the delays tried, samples; a parabola tells what lies between."""
FEWEST = 20
"""Readings in motion below which a run keeps the delay it was trained with."""
MAY_BE_EARLY = ("yaw_rate",)
"""Outputs that may be early. An acceleration may not: the speed among the inputs is its integral, and inputs ahead of
the reading would give away what is to be predicted."""
DRIVEN_BY = {"steer": "yaw_rate", "motor_current": "a_x", "v_x": "a_x"}
"""Inputs of a coupled model in closed loop -> the output whose delay moves them; what is fed back is not moved."""
_WRITTEN = re.compile(r"timing(?:\s*=\s*([0-9.eE+-]+)\s*s?)?")


@dataclass(frozen=True)
class RunDelay:
    """The delay of one run.

    Attributes
    ----------
    run : its number, from 0.
    delay, sd : s, and its standard deviation.
    stop : row of the recording after the last one that was looked at; the run's end, where it holds no more than that.
    """

    run: int
    delay: float
    sd: float
    stop: int


def run_delays(
    part: MemoryModel, recording: Recording, noise: Mapping[str, float], seconds: float | None = None
) -> list[RunDelay]:
    """The most likely delay of every run after its first seconds of motion; the one of least error, held to `SPREAD`.

    Parameters
    ----------
    part : a model whose outputs share a delay.
    noise : output -> standard deviation of its residuals in training.
    seconds : of motion to look at from the start of each run; None for all.
    """
    trace, dt = Trace(part), recording.sample_time
    lowest = EARLIEST if set(part.outputs) & set(MAY_BE_EARLY) else 0.0
    lags = np.arange(round(lowest / STEP), round(LATEST / STEP) + 1) * STEP
    counted = np.array([noise[name] for name in part.outputs])
    errors = np.full((len(lags), len(recording), len(part.outputs)), np.nan)
    everywhere = range(len(recording.runs))
    for error, lag in zip(errors, lags, strict=True):
        try:
            seen = predictions(part, aligned(recording, part.inputs, dict.fromkeys(everywhere, lag * dt)), trace=trace)
        except BadInput:  # too short for a window that is moved
            continue
        error[seen.rows] = (seen.predicted - seen.measured) / counted
    known = np.all(np.isfinite(errors), axis=(0, 2)) & (moving(recording) > 0)
    result = []
    for number, (start, stop) in enumerate(recording.runs):
        rows = start + np.flatnonzero(known[start:stop])
        enough = seconds is None or len(rows) > round(seconds / dt)
        rows = rows if seconds is None else rows[: round(seconds / dt)]
        if len(rows) < FEWEST:
            result.append(RunDelay(number, 0.0, SPREAD, start))
            continue
        delay, sd = _most_likely(errors[:, rows], np.asarray(lags * dt, dtype=float))
        result.append(RunDelay(number, delay, sd, int(rows[-1]) + 1 if enough else stop))
    return result


def _most_likely(errors: Array, delays: Array) -> tuple[float, float]:
    """From (delays, rows, outputs) errors in noise standard deviations: the likeliest delay and its sd, s."""
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
    """The recording with inputs moved to where the readings of runs with these delays, s, belong; NaN beyond a run."""
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
    """Predictions of a recording whose runs have these delays, s; run -> none where there is none."""
    used = {run: delay for run, delay in delays.items() if delay}
    return predictions(part, aligned(recording, part.inputs, used) if used else recording)


@dataclass(frozen=True)
class Timing:
    """Delays of the runs of a recording, told by their first seconds.

    Attributes
    ----------
    seconds : of motion that were looked at in each run; None for all of it.
    delays : outputs of a part -> a delay for each run.
    """

    seconds: float | None
    delays: Mapping[tuple[str, ...], Sequence[RunDelay]]

    def of(self, outputs: Sequence[str]) -> dict[int, float]:
        """Run, from 0 -> delay of these outputs, s."""
        return {delay.run: delay.delay for delay in self.delays[tuple(outputs)]}

    def looked_at(self, recording: Recording) -> Array:
        """(rows,) whether a row told a delay, or stands before one that did."""
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
                known = runs.setdefault(str(item.run + 1), {})
                known |= {output: {"delay": item.delay, "sd": item.sd} for output in outputs}
        return {"seconds": self.seconds, "runs": runs}


def calibrated_seconds(words: str | Iterable[str] | None) -> float | None:
    """Seconds of motion that tell a run's delay: "timing" takes `CALIBRATED`, "timing=8s" 8; none of them, None.

    Raises
    ------
    BadInput : there is no such thing to calibrate, or what follows is no number of seconds above zero.
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
    """Name of the protocol in which so many seconds of motion tell a run's delay, and what follows is scored."""
    return f"timing calibrated on {seconds:g} s"


def parts_of(model: MemoryModel) -> list[MemoryModel]:
    """The parts of a coupled model, or the model itself, at the values of the whole."""
    return [
        part.with_parameters(*(model[parameter.name] for parameter in part.parameters)) for part in model.parts
    ] or [model]


def residual_noise(fit: Fit, recording: Recording) -> dict[str, float]:
    """Standard deviation of residuals in training; on a recording, where the fit was never trained here."""
    model = must_have_timing(fit.model)
    known = {name: sd for stage in fit.stages for name, sd in stage.noise.items()}
    if set(model.outputs) <= set(known):
        return {name: max(known[name], 1e-9) for name in model.outputs}
    return {
        name: max(error.rmse, 1e-9) for name, error in errors(model, predictions(model, recording), "honest").items()
    }


def must_have_timing(model: Model) -> MemoryModel:
    """The model, if its runs tell delays that can be held. Raises `BadInput` for others."""
    none = (
        f"‹calibrate› is for models with memory, and {model.name} is not one. Add the effect steering_delay or "
        "sensor_latency_yaw to equations of motion, and fit it per run."
    )
    return must_be(MemoryModel, model, none)


def calibrated_timing(fit: Fit, recording: Recording, seconds: float | None = CALIBRATED) -> Timing:
    """The delay of every run of a recording, told by its first seconds of motion; of the fit, nothing moves.

    Parameters
    ----------
    fit : of a model with memory.
    recording : inputs and readings.
    seconds : of motion to look at from the start of each run; None for all.

    Raises
    ------
    BadInput : the model is of another kind, or no run has anything left behind its first seconds.
    """
    parts = parts_of(must_have_timing(fit.model))
    noise = residual_noise(fit, recording)
    known = {tuple(part.outputs): run_delays(part, recording, noise, seconds) for part in parts}
    timing = Timing(seconds, known)
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
    """Predictions of what follows the calibrated seconds, each run's delay taken back.

    Parameters
    ----------
    model : with memory.
    recording : inputs and readings.
    timing : what `calibrated_timing` told of the recording.
    open_loop : one sample ahead, each part with its own delay; else freely, inputs moved as `DRIVEN_BY` says.
    """
    predicted, measured = (np.full((len(recording), len(model.outputs)), np.nan) for _ in range(2))
    if open_loop or model.feedback is None:
        for part in parts_of(model):
            seen = timed(part, recording, timing.of(part.outputs))
            columns = [model.outputs.index(name) for name in part.outputs]
            place = np.ix_(np.asarray(seen.rows, dtype=np.intp), np.array(columns, dtype=np.intp))
            predicted[place], measured[place] = seen.predicted, seen.measured
    else:
        seen = predictions(model, aligned_together(model, recording, timing), "closed_loop")
        predicted[seen.rows], measured[seen.rows] = seen.predicted, seen.measured
    known = np.any(np.isfinite(predicted), axis=1) & np.logical_not(timing.looked_at(recording))
    rows = np.flatnonzero(known)
    if not len(rows):
        raise BadInput(
            f"Nothing of {recording.name} can be predicted after the seconds of its runs from which "
            "delays were estimated."
        )
    joins = np.searchsorted([start for start, _ in recording.runs], rows, side="right")
    apart = np.concatenate(([False], (np.diff(rows) > 1) | (np.diff(joins) > 0)))
    return Prediction(np.asarray(rows), predicted[rows], measured[rows], np.cumsum(apart))


def aligned_together(model: MemoryModel, recording: Recording, timing: Timing) -> Recording:
    """The recording for all parts at once: every input moved by the delay of the output that it drives."""
    parts = parts_of(model)
    for part in parts:
        delays = {run: delay for run, delay in timing.of(part.outputs).items() if delay}
        moved = part.inputs if len(parts) == 1 else [n for n in part.inputs if DRIVEN_BY.get(n) in part.outputs]
        recording = aligned(recording, moved, delays) if delays else recording
    return recording


def calibrated_errors(model: MemoryModel, recording: Recording, timing: Timing) -> dict[str, Error]:
    """Errors one sample ahead, pooled, on what follows the calibrated seconds of each output's part."""
    result: dict[str, Error] = {}
    for part in parts_of(model):
        result |= errors_after(part, recording, timing.delays[tuple(part.outputs)])
    return result


def errors_after(part: MemoryModel, recording: Recording, delays: Sequence[RunDelay]) -> dict[str, Error]:
    """Errors of a part with delays taken back, behind the rows that told them; nothing where no window fits."""
    try:
        seen = timed(part, recording, {delay.run: delay.delay for delay in delays})
    except BadInput:
        return {}
    looked_at = Timing(None, {tuple(part.outputs): delays}).looked_at(recording)
    kept = np.logical_not(looked_at[seen.rows])
    if not np.any(kept):
        return {}
    return errors(part, seen.taken(kept), "honest")


def moving(recording: Recording) -> Array:
    """(rows,) whether the vehicle moves, 1 or 0; always, where its speed was not recorded."""
    if "v_x" not in recording:
        return np.ones(len(recording))
    return np.where(np.abs(recording["v_x"]) > ROLLING, 1.0, 0.0)
