"""What hybrid models make of a recording: forces, stiffnesses, slips and motion, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pandas as pd

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.hybrid.cell import free_run
from ...models.hybrid_model import HybridModel
from ...models.model import must_be
from ..fit import Fit

SD = "_sd"
"""What the name of a standard deviation ends in."""
_BLOCK, _APART = 0.1, 2
"""Seconds of readings that are averaged, and rows left out between blocks: a yaw acceleration is told by its
neighbours, and what two blocks share of the noise would count as an error of the model."""


@dataclass(frozen=True)
class Estimates:
    """Estimates of every row of a recording.

    Attributes
    ----------
    time : (n,) s.
    columns : name -> (n,); NaN where the model does not hold or, of stiffnesses, where slip does not tell them.
        Ensembles have `<name>_sd` besides, the spread of their members.
    units : name -> SI unit.
    """

    time: Array
    columns: Mapping[str, Array]
    units: Mapping[str, str]

    def __getitem__(self, name: str) -> Array:
        if name not in self.columns:
            raise BadInput(f"There is no estimate {name}; there are {', '.join(self.columns)}.")
        return self.columns[name]

    def table(self) -> pd.DataFrame:
        """Time and all estimates, a column each."""
        return pd.DataFrame({"time": self.time, **self.columns})


def apply_hybrid(fits: Fit | Sequence[Fit], recording: Recording, calibrated_on: Sequence[Recording] = ()) -> Estimates:
    """Forces, stiffnesses, slips and motion of a recording, from its inputs and each stretch's first readings.

    Parameters
    ----------
    fits : of one hybrid model, or several trained from different seeds: then their mean and, as `<name>_sd`, their
        spread. That is how far trainings differ, not all that is uncertain: what they have in common is missing.
    recording : v_x [m/s] and steer [rad]; of a_y, yaw_rate, v_y no more than the first rows are read.
    calibrated_on : recordings that no member was trained on, with a_y and yaw_rate: they tell how far members are off
        together, and the standard deviations of what they tell are widened by it (`_widened`).

    Returns
    -------
    Estimates with the columns of `HybridModel.estimates`: F_yf, F_yr [N], C_alpha_f, C_alpha_r [N/rad], alpha_f,
    alpha_r [rad], v_y [m/s], sideslip [rad], yaw_rate [rad/s], a_y [m/s^2].

    Raises
    ------
    BadInput : a fit is of another kind of model, the recording lacks an input, or bands are to be calibrated of one
        fit, on what it was trained on, or on recordings that tell nothing.
    """
    members = [fits] if isinstance(fits, Fit) else list(fits)
    none = "{} is no hybrid model; fit hybrid_stiffness or hybrid_force."
    models = [must_be(HybridModel, fit.model, none.format(fit.model.name)) for fit in members]
    if not models:
        raise BadInput("There is no fit to apply.")
    if len({model.name for model in models}) > 1:
        raise BadInput(
            "An ensemble takes fits of one hybrid model; apply hybrid_stiffness and hybrid_force one after the other."
        )
    runs = [free_run(model, recording) for model in models]
    units, columns = dict(models[0].estimates), {}
    for name in units:
        every = np.array([run[name] for run in runs])
        columns[name] = np.asarray(np.mean(every, axis=0))
        if len(runs) > 1:
            columns[name + SD] = np.asarray(np.std(every, axis=0, ddof=1))
    if calibrated_on:
        _must_be_new(members, calibrated_on)
        columns |= _widened(models, columns, calibrated_on)
    units |= {name + SD: unit for name, unit in models[0].estimates.items() if name + SD in columns}
    return Estimates(recording.time, columns, units)


def _must_be_new(members: Sequence[Fit], recordings: Sequence[Recording]) -> None:
    if len(members) < 2:
        raise BadInput("One fit has no band; train it from several seeds, and name all of them.")
    trained = {record.sha256 for fit in members for record in fit.data if record.role == "train"} - {""}
    for recording in recordings:
        if recording.source.sha256 in trained:
            raise BadInput(
                f"{recording.name} was trained on: errors there are smaller than elsewhere. Name recordings for "
                "‹calibrated_on› that no member was trained on."
            )


def _widened(
    models: Sequence[HybridModel], columns: Mapping[str, Array], recordings: Sequence[Recording]
) -> dict[str, Array]:
    """Standard deviations of what readings tell, widened by what members have in common.

    The mean of M members that scatter by s about a truth of their kind is off by s^2 (1 + 1/M), and nowhere by less
    than it is found to be off on average, E[e^2] and, as runs differ in it, its standard error. E[e^2] is the mean
    product of the error's averages over neighbouring blocks, in which noise of readings, many times as large, cancels.
    (Adding what E[e^2] has beyond s^2 (1 + 1/M) was tried: where members part in bursts there is nothing to add, and
    between bursts bands are too narrow.)
    """
    value = {
        parameter.name: float(np.mean([model[parameter.name].array for model in models]))
        for parameter in models[0].parameters
        if parameter.shape == ()
    }
    p, share = SimpleNamespace(**value), 1.0 + 1.0 / len(models)
    off: dict[str, list[float]] = {}
    for recording in recordings:
        runs = [free_run(model, recording) for model in models]
        errors = {
            name: read - np.mean([run[name] for run in runs], axis=0)
            for name in models[0].estimates
            if (read := models[0].read(name, recording)) is not None
        }
        for name, of in models[0].told_by.items():
            error = of(recording, errors, p)
            if error is not None:
                squares = [_square_error(error[start:stop], recording.sample_time) for start, stop in recording.runs]
                off.setdefault(name, []).extend(square for square in squares if np.isfinite(square))
    result = {}
    for name, several in off.items():
        if len(several) > 1:
            least = np.mean(several) + np.std(several, ddof=1) / np.sqrt(len(several))
            result[name + SD] = np.sqrt(np.maximum(share * columns[name + SD] ** 2, least))
    if not result:
        raise BadInput(
            f"‹calibrated_on›: two unbroken runs with a_y and yaw_rate are needed to say how wide bands of "
            f"{models[0].name} have to be; name more recordings."
        )
    return result


def _square_error(errors: Array, sample_time: float) -> float:
    """Mean square of the slow part of errors, by products of neighbouring blocks; NaN without two of them."""
    length = max(round(_BLOCK / sample_time), 1)
    count = (len(errors) + _APART) // (length + _APART)
    blocks = [errors[k * (length + _APART) :][:length] for k in range(count)]
    means = np.array([np.mean(block) for block in blocks])
    products = means[1:] * means[:-1]
    known = products[np.isfinite(products)]
    return float(np.mean(known)) if len(known) else np.nan
