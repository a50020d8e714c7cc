"""Recordings prepared for hybrid models: stretches with complete inputs, and windows of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...models.hybrid_model import HybridModel

SAMPLE_TIME_TOLERANCE = 0.02
"""Largest relative difference between the sample times of a recording and of the model."""
_START = 0.02
"""s to either side of a start whose readings are averaged by a straight line."""
_SMOOTH, _ORDER = 15, 3
"""Rows and order of the polynomials that smooth a signal; its deviation from them is noise."""


@dataclass(frozen=True)
class Stretch:
    """Rows without a gap.

    Attributes
    ----------
    rows : rows of the recording.
    sample_time : s.
    inputs : (2 inputs, n), at the row and as they act until the next row: a held command acts as half its step. With a
        single-step method (`HybridModel.integrator`), at the row and at the end of the step: a command as it is held,
        other inputs as in the next row.
    outputs : (outputs, n) readings; NaN where missing.
    states : (states, n) readings; NaN where missing.
    """

    rows: slice
    sample_time: float
    inputs: Array
    outputs: Array
    states: Array

    def __len__(self) -> int:
        return int(self.inputs.shape[1])

    def start(self, row: int) -> Array:
        """States at a row, from straight lines through the readings around it; zero without readings."""
        side = round(_START / self.sample_time)
        first = min(max(row - side, 0), max(len(self) - 2 * side - 1, 0))
        return np.array([_line(values[first : first + 2 * side + 1], row - first) for values in self.states])


def stretches(model: HybridModel, recording: Recording) -> list[Stretch]:
    """The stretches of a recording in which a hybrid model's inputs are finite and its physics are valid.

    Raises
    ------
    BadInput : an input is missing, or the sample time is not the model's.
    """
    recording.require(model.inputs, model.name)
    h = recording.sample_time
    if not abs(h - model.sample_time) <= SAMPLE_TIME_TOLERANCE * model.sample_time:
        raise BadInput(
            f"{recording.name} has a sample time of {h:.4g} s, but {model.name} is made for {model.sample_time:.4g} s: "
            "resample the recording with greybox data convert, or fit again."
        )
    inputs = np.array([recording[name] for name in model.inputs])
    usable = np.all(np.isfinite(inputs), axis=0)
    for name, least in model.least.items():
        with np.errstate(invalid="ignore"):
            usable &= recording[name] >= least
    outputs, states = (
        np.array([_read(model, name, recording) for name in names])
        for names in (model.outputs, [state.name for state in model.states])
    )
    result = []
    for start, stop in recording.runs:
        edges = np.flatnonzero(np.diff(np.concatenate(([0], usable[start:stop].astype(int), [0])))) + start
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            both = np.concatenate((inputs[:, a:b], _acting(model, recording, inputs[:, a:b])))
            result.append(Stretch(slice(a, b), h, both, outputs[:, a:b], states[:, a:b]))
    return result


@dataclass(frozen=True)
class Windows:
    """Windows side by side.

    Attributes
    ----------
    inputs : (rows, 2 inputs, windows), as in `Stretch`.
    outputs : (rows, outputs, windows), NaN where missing or not compared.
    starts : (states, windows).
    """

    inputs: Array
    outputs: Array
    starts: Array


def windows(model: HybridModel, stretchs: Sequence[Stretch]) -> Windows:
    """Windows of stretches, each row but the first ones compared once; stretches shorter than a window are dropped.

    Raises
    ------
    BadInput : no stretch is as long as a window.
    """
    length, stride = model.window, model.window - model.warm_up
    places = [(one, k) for one in stretchs for k in _starts(len(one), length, stride)]
    if not places:
        raise BadInput(
            f"No unbroken stretch of the recordings is as long as a window of {model.name}, {length} rows; set "
            "window and warm_up to fewer rows."
        )
    inputs = np.stack([one.inputs[:, k : k + length].T for one, k in places], axis=2)
    outputs = np.stack([one.outputs[:, k : k + length].T for one, k in places], axis=2)
    outputs[: model.warm_up] = np.nan
    return Windows(inputs, outputs, np.stack([one.start(k) for one, k in places], axis=1))


def noise(stretchs: Sequence[Stretch]) -> Array:
    """Standard deviation of every output's readings from smooth curves; NaN without readings.

    The curve is a cubic through the 15 rows around each; the result is corrected for the noise that the cubic follows.
    """
    # importing it takes a second, which reports of other models need not spend
    from scipy.signal import savgol_filter

    kept = 1.0 - savgol_filter(np.eye(1, 2 * _SMOOTH + 1, _SMOOTH)[0], _SMOOTH, _ORDER)[_SMOOTH]
    squares: list[list[Array]] = [[] for _ in range(stretchs[0].outputs.shape[0])]
    for one in stretchs:
        for k, values in enumerate(one.outputs):
            if len(values) > 2 * _SMOOTH and np.all(np.isfinite(values)):
                squares[k].append((values - savgol_filter(values, _SMOOTH, _ORDER)) ** 2 / kept)
    return np.array([np.sqrt(np.mean(np.concatenate(square))) if square else np.nan for square in squares])


def _acting(model: HybridModel, recording: Recording, inputs: Array) -> Array:
    """Inputs as they act on states, see `cell`; before the first row commands are taken as constant."""
    result = inputs.copy()
    if model.integrator != "ab2":
        for k, name in enumerate(model.inputs):
            if not (recording.hold == "zero" and name in model.commands):
                result[k, :-1] = inputs[k, 1:]
        return result
    if recording.hold == "zero":
        for k, name in enumerate(model.inputs):
            if name in model.commands:
                result[k, 1:] = 0.5 * (inputs[k, 1:] + inputs[k, :-1])
    return result


def _line(values: Array, place: int) -> float:
    """Value at `place` of a straight line through the readings."""
    at = np.flatnonzero(np.isfinite(values))
    if len(at) < 3:
        return float(np.mean(values[at])) if len(at) else 0.0
    slope, level = np.polyfit(at - place, values[at], 1)
    del slope
    return float(level)


def _starts(rows: int, length: int, stride: int) -> list[int]:
    """First rows of windows; the last one ends with the stretch."""
    if rows < length:
        return []
    result = list(range(0, rows - length + 1, stride))
    return result if result[-1] + length == rows else [*result, rows - length]


def _read(model: HybridModel, name: str, recording: Recording) -> Array:
    read = model.read(name, recording)
    return np.full(len(recording), np.nan) if read is None else read
