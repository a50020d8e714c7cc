"""Estimates of hybrid models on a recording: forces, stiffnesses, slips and motion, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
"""Suffix of the names of standard deviations."""


@dataclass(frozen=True)
class Estimates:
    """Estimates of every row of a recording.

    Attributes
    ----------
    time : (n,) s.
    columns : name -> (n,); NaN where the model is not valid or, for stiffnesses, where slip is too small to identify
        them. Ensembles have `<name>_sd` as well, the spread of their members.
    units : name -> SI unit.
    """

    time: Array
    columns: Mapping[str, Array]
    units: Mapping[str, str]

    def __getitem__(self, name: str) -> Array:
        if name not in self.columns:
            raise BadInput(f"There is no estimate {name}; choose one of {', '.join(self.columns)}.")
        return self.columns[name]

    def table(self) -> pd.DataFrame:
        """Time and all estimates, one column each."""
        return pd.DataFrame({"time": self.time, **self.columns})


def apply_hybrid(fits: Fit | Sequence[Fit], recording: Recording) -> Estimates:
    """Forces, stiffnesses, slips and motion of a recording, from its inputs and each stretch's first readings.

    Parameters
    ----------
    fits : of one hybrid model, or several from different seeds: then their mean and, as `<name>_sd`, their spread,
        which is the variation between trainings, not the whole uncertainty: errors they have in common are missing.
    recording : v_x [m/s] and steer [rad]; of a_y, yaw_rate, v_y only the first rows are used.

    Returns
    -------
    Estimates with the columns of `HybridModel.estimates`: F_yf, F_yr [N], C_alpha_f, C_alpha_r [N/rad], alpha_f,
    alpha_r [rad], v_y [m/s], sideslip [rad], yaw_rate [rad/s], a_y [m/s^2].

    Raises
    ------
    BadInput : a fit is of another kind of model, or the recording lacks an input.
    """
    members = [fits] if isinstance(fits, Fit) else list(fits)
    none = "{} is not a hybrid model; fit hybrid_stiffness or hybrid_force."
    models = [must_be(HybridModel, fit.model, none.format(fit.model.name)) for fit in members]
    if not models:
        raise BadInput("No fit was given; pass at least one.")
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
    units |= {name + SD: unit for name, unit in models[0].estimates.items() if name + SD in columns}
    return Estimates(recording.time, columns, units)
