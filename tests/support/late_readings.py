"""Runs of a car that is a network of known weights, its yaw rate stamped late."""

import numpy as np
from toys import DT, drive

from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.registry import build

NOISE = 0.05


def car():
    """A car that is a lateral benchmark network, of known weights."""
    model = build("msnn_bench_lat", {"v_x": [0.5, 4.0]})
    F = np.array([3.0, 2.4])[:, None] * np.exp(-np.arange(20)[::-1] / 3.0) / np.sum(np.exp(-np.arange(20) / 3.0))
    return model.with_parameters(model["F"].with_value(F), model["A"].with_value(0.01))


def driven(model, rows, seed, late=0.0, noise=NOISE):
    """A run of a car, its yaw rate stamped late by so many seconds."""
    recording = drive(rows + 60, seed)
    at = np.arange(len(recording))
    moved = {n: np.interp(at - late / DT, at, recording[n]) for n in model.inputs}
    seen = predictions(model, recording.with_signals(**moved))
    yaw_rate = np.zeros(len(recording))
    yaw_rate[seen.rows] = seen.predicted[:, 0]
    yaw_rate += noise * np.random.default_rng(seed + 1000).standard_normal(len(yaw_rate))
    return recording.with_signals(yaw_rate=yaw_rate).rows(30, 30 + rows)
