"""The truck's networks: from measurements alone, beside a bicycle, and after a bicycle.

Protocol of the publication (Table III): v_x and alpha1 as recorded at 0.05 s, forward Euler, loss over windows of 1, 10
or 20 steps; of the weights along the way those are kept that are best on the held-out trajectories. What differs: the
held-out error is that of the whole 10 s; horizons grow; L-BFGS in place of Adam; inputs in units of their spread.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..engine.hybrid.free_run import free_run
from ..engine.hybrid.problem import WindowErrors
from ..engine.hybrid.stretches import Stretch, stretches
from ..fitting.how import How, Say
from ..fitting.networks import counted, trained_from
from ..fitting.pretraining import Pretraining, known_physics
from ..hybrid_model import HybridModel
from ..models.registry import prepared
from ..parameter import Array
from ..recording import Recording

METHODS = ("learning", "discrepancy", "transfer")
"""Measurements alone; what a bicycle is off by; first a bicycle's rates, then measurements."""
NAMES = {"learning": "mlp_lateral", "discrepancy": "bicycle_mlp", "transfer": "mlp_lateral"}
ROWS = 200
"""Of a trajectory: 10 s."""


@dataclass(frozen=True)
class NetworkTraining:
    """Trainings of one network from several seeds.

    Attributes
    ----------
    method : one of `METHODS`.
    units : of each of the four hidden layers.
    horizon : s of the windows.
    runs : split -> (seeds, trajectories, outputs) RMSE of free runs.
    together : split -> (trajectories, outputs) RMSE of the mean of all seeds' free runs.
    along : split -> (seeds, rows, outputs) RMSE over all trajectories up to a row.
    parameters : weights.
    cpu_seconds : of one training, mean.
    """

    method: str
    units: int
    horizon: float
    runs: Mapping[str, Array]
    together: Mapping[str, Array]
    along: Mapping[str, Array]
    parameters: int
    cpu_seconds: float


def trained(
    method: str,
    units: int,
    horizon: float,
    recordings: Mapping[str, Recording],
    known: Pretraining,
    seeds: Sequence[int],
    say: Say,
) -> NetworkTraining:
    """Train on "train", stop by "val", score every recording there is.

    Parameters
    ----------
    method : one of `METHODS`.
    units : of each of four hidden layers.
    horizon : s predicted from one start at the end of training.
    recordings : split -> recording, all trajectories of 10 s at 0.05 s.
    known : the bicycle, fitted to "train".
    seeds : of the trainings.
    say : progress.
    """
    train = recordings["train"]
    window = min(round(horizon / train.sample_time) + 1, ROWS)
    settings = {"hidden": [units] * 4, "window": window, "integrator": "euler", "symmetric": False}
    model = prepared(NAMES[method], train, settings)
    assert isinstance(model, HybridModel)
    if method == "discrepancy":
        model = known_physics(model, known)
    laid = {split: stretches(model, own) for split, own in recordings.items()}
    sd = counted(model, laid["train"], How())
    whole = replace(model, window=min(ROWS, *(len(own) for own in laid["val"])), warm_up=0)
    outside = WindowErrors(whole, laid["val"], sd)
    found: list[Array] = []
    clock = time.process_time()
    for seed in seeds:
        first = known if method == "transfer" else None
        found.append(trained_from(model, [train], laid["train"], sd, outside, seed, say, first).x)
    seconds = (time.process_time() - clock) / len(seeds)
    errors = {split: _errors(model, found, recordings[split], own) for split, own in laid.items()}
    weights = sum(int(np.prod(shape)) for shape in model.network.shapes.values())
    return NetworkTraining(
        method, units, horizon,
        {split: np.sqrt(np.mean(own**2, axis=2)) for split, own in errors.items()},
        {split: np.sqrt(np.mean(np.mean(own, axis=0) ** 2, axis=1)) for split, own in errors.items()},
        {split: np.sqrt(np.cumsum(np.mean(own**2, axis=1), axis=1) / (1 + np.arange(own.shape[2]))[None, :, None])
         for split, own in errors.items()},
        weights, seconds,
    )  # fmt: skip


def _errors(model: HybridModel, found: Sequence[Array], recording: Recording, laid: Sequence[Stretch]) -> Array:
    """(seeds, trajectories, rows, outputs) of free runs, cut to the rows that all trajectories have."""
    rows = min(len(own) for own in laid)
    every = []
    for p in found:
        told = free_run(model.with_values(p), recording)
        every.append(
            [
                np.column_stack([told[n][own.rows] - own.outputs[k] for k, n in enumerate(model.outputs)])[:rows]
                for own in laid
            ]
        )
    return np.array(every)
