"""The verbs `simulate` and `predict`: what a model makes of a recording, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from ...base.errors import BadInput
from ...datasets.recording import Recording
from ...engine.simulation import Prediction
from ...models.kinds import by_kind
from ...models.model import Model


@by_kind
def simulate(model: Model, recording: Recording, start: Mapping[str, float] | None = None) -> Prediction:
    """Free run of every unbroken run, to its end, on the recorded inputs alone.

    Parameters
    ----------
    model : at the values it is simulated with.
    recording : its inputs; outputs need not be there.
    start : states at the start of every run, in SI units; others start from the readings of the first row, and where
        there are none as the model says.

    Raises
    ------
    BadInput : an input is missing, or the model has no loop to run in.
    """
    raise BadInput(f"{model.name} is not simulated.")


@by_kind
def predict(model: Model, recording: Recording, horizon: float | None = None, *, open_loop: bool = False) -> Prediction:
    """Predictions of a recording's rows.

    Parameters
    ----------
    model : equations of motion, a map with memory, or a hybrid of physics and network.
    recording : inputs and readings.
    horizon : s; equations of motion predict every row from the readings so much earlier. None runs freely from
        the first row of each run.
    open_loop : maps with memory predict one sample ahead from measured inputs; those without a loop do so anyway.

    Raises
    ------
    BadInput : a signal is missing, the horizon does not suit the recording, or the model knows no such thing.
    """
    if horizon is not None or open_loop:
        raise BadInput(f"{model.name} runs freely from the start of each run; omit ‹horizon› and ‹open_loop›.")
    return simulate(model, recording)


@by_kind
def predicted_how(model: Model, horizon: float | None, open_loop: bool) -> tuple[str, dict[str, Any]]:
    """How `predict` predicts, in words and as data."""
    return "free run", {}


def must_suit(horizon: float, recordings: Sequence[Recording]) -> None:
    """Raise `BadInput` where a horizon is shorter than a sample or longer than every run of a recording."""
    for recording in recordings:
        step = recording.sample_time
        longest = max(float(recording.time[stop - 1] - recording.time[start]) for start, stop in recording.runs)
        if horizon < 0.5 * step:
            raise BadInput(f"A horizon of {horizon:g} s is shorter than a sample of {recording.name}, {step:.4g} s.")
        if horizon > longest * (1 + 1e-9):
            raise BadInput(
                f"A horizon of {horizon:g} s is longer than the longest unbroken run of {recording.name}, "
                f"{longest:.4g} s."
            )


@by_kind
def assumed(model: Model, recording: Recording, start: Mapping[str, float]) -> list[str]:
    """Sentences on states that are neither recorded nor given, where the model starts them from a mere number."""
    return []


def as_table(model: Model, recording: Recording, prediction: Prediction, suffix: str) -> pd.DataFrame:
    """Predictions beside the readings there are: time, run, and every output as read and as predicted."""
    table = pd.DataFrame({"time": recording.time[prediction.rows], "run": prediction.run + 1})
    for k, name in enumerate(model.outputs):
        if name in recording:
            table[name] = prediction.measured[:, k]
        table[f"{name}_{suffix}"] = prediction.predicted[:, k]
    return table
