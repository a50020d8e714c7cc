"""The verbs `simulate` and `predict`: what a model makes of a recording, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from ..engine.motion.prediction import Predictions, Predictor
from ..engine.motion.simulator import Simulator
from ..errors import BadInput
from ..hybrid_model import HybridModel
from ..memory_model import MemoryModel
from ..model import Model
from ..motion_model import MotionModel
from ..recording import Recording
from ..signals import SIGNALS
from .metrics import Prediction, hybrid_predictions, predictions


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
    if isinstance(model, MotionModel):
        return _as_prediction(Predictor(Simulator(model), recording, model.values, start or {}).free_run())
    if isinstance(model, HybridModel):
        if start:
            raise BadInput(f"{model.name} starts from the readings of each run's first rows. Give it no start.")
        return hybrid_predictions(model, recording)
    assert isinstance(model, MemoryModel)
    if start:
        raise BadInput(f"{model.name} has no states: it starts from a window of the recording. Give it no start.")
    if model.feedback is None:
        raise BadInput(
            f"{model.name} predicts one sample ahead from measured inputs, with no loop to run in; use greybox predict."
        )
    return predictions(model, recording, "closed_loop")


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
    if isinstance(model, MotionModel):
        if open_loop:
            raise BadInput(f"{model.name} has states and no open loop; say how far to look ahead with ‹horizon›.")
        predictor = Predictor(Simulator(model), recording, model.values)
        if horizon is None:
            return _as_prediction(predictor.free_run())
        must_suit(horizon, [recording])
        return _as_prediction(predictor.ahead(horizon))
    if isinstance(model, HybridModel):
        if horizon is not None or open_loop:
            raise BadInput(f"{model.name} runs freely from the start of each run; omit ‹horizon› and ‹open_loop›.")
        return hybrid_predictions(model, recording)
    assert isinstance(model, MemoryModel)
    if horizon is not None:
        raise BadInput(
            f"{model.name} is a model with memory: it predicts freely or, with ‹open_loop›, one sample ahead; omit "
            "‹horizon›."
        )
    return predictions(model, recording, "closed_loop" if model.feedback is not None and not open_loop else "honest")


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


def assumed(model: Model, recording: Recording, start: Mapping[str, float]) -> list[str]:
    """Sentences on states that are neither recorded nor given, where the model starts them from a mere number."""
    if not isinstance(model, MotionModel):
        return []
    found = []
    for state in model.states:
        if (
            state.name in SIGNALS
            and not recording.has(state.name)
            and state.name not in start
            and not callable(state.start)
        ):
            found.append(
                f"{recording.name} does not hold {state.name}, so it starts at {state.start:g} {state.unit} unless you "
                "hand over where it starts."
            )
    return found


def as_table(model: Model, recording: Recording, found: Prediction, suffix: str) -> pd.DataFrame:
    """Predictions beside the readings there are: time, run, and every output as read and as predicted."""
    table = pd.DataFrame({"time": recording.time[found.rows], "run": found.run + 1})
    for k, name in enumerate(model.outputs):
        if name in recording:
            table[name] = found.measured[:, k]
        table[f"{name}_{suffix}"] = found.predicted[:, k]
    return table


def _as_prediction(found: Predictions) -> Prediction:
    if len(found.rows) == 0:
        raise BadInput("There is no row to predict from: at no row are all measured states read at once.")
    order = np.lexsort((found.rows, found.run))
    return Prediction(
        rows=np.asarray(found.rows[order]),
        predicted=found.predicted[order],
        measured=found.measured[order],
        run=np.asarray(found.run[order]),
    )
