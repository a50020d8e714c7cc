"""Recordings of a full-size car driven by the engine itself, with noise: small ones, for tests of what is around it."""

import numpy as np
import pandas as pd

from greybox_id.datasets.recording import Recording, join
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

NOISE = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.005, "a_x": 0.1, "a_y": 0.1}
DT = 0.04


def commands(seconds=8.0, seed=0, speed=18.0, dt=DT):
    """Smooth steering, and a speed that swings about `speed`."""
    rng = np.random.default_rng(seed)
    time = dt * np.arange(round(seconds / dt))
    waves = [np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.2, 0.45, 0.9)]
    return Recording(
        f"drive{seed}", time,
        {
            "steer": 0.03 * waves[0] + 0.025 * waves[1] + 0.015 * waves[2],
            "v_x": speed + 2 * np.sin(0.5 * time),
            "ax_cmd": 0.4 * np.cos(0.5 * time) + 0.2,
        },
    )  # fmt: skip


def driven(name="lateral", runs=2, seconds=8.0, seed=0, effects=None, noise=1.0, values=None):
    """A model of the registry with the full-size car's numbers, driven along `commands`, and read with noise."""
    model = build(name, None, effects or {}, vehicle("full_size_car"))
    model = model.with_parameters(*(model[n].with_value(v) for n, v in (values or {}).items()))
    rng = np.random.default_rng(100 + seed)
    parts = []
    for k in range(runs):
        given = commands(seconds, seed + k)
        start = {"v_x": 18.0} if name != "lateral" else {}
        found = simulate(model, without(given, "v_x") if start else given, start)
        read = {n: found.predicted[:, j] for j, n in enumerate(model.outputs)}
        noisy = {n: v + noise * NOISE[n] * rng.standard_normal(len(v)) for n, v in read.items()}
        parts.append(given.with_signals(**noisy))
    return join(parts, "drive")


def without(recording, *names):
    """The recording lacking some signals."""
    return Recording(recording.name, recording.time, {n: v for n, v in recording.signals.items() if n not in names})


def written(recording, path):
    """The recording as a file that needs no column map; runs are told by their numbers."""
    run = np.concatenate([np.full(b - a, k + 1) for k, (a, b) in enumerate(recording.runs)])
    table = pd.DataFrame({"time": recording.time, "run": run, **recording.signals})
    table.to_csv(path, index=False)
    return path
