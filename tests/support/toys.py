"""Small recordings and models to test the engine on."""

from dataclasses import replace

import numpy as np

from greybox_id.datasets.recording import Recording, join
from greybox_id.models.memory_model import MemoryModel
from greybox_id.models.parameter import Parameter, Prior
from greybox_id.models.registry import build

DT = 0.05
TINY_LAT = {"n_delta": 3, "q": 4}
TINY_LONG = {"n_y": 2, "eta": 2, "gamma": 3}
TINY = {
    "msnn_lat": TINY_LAT,
    "msnn_long": TINY_LONG,
    "msnn_full": {"lat": TINY_LAT, "long": TINY_LONG},
    "gnn": {"neurons": 3, "gamma": 4},
    "msnn_bench_lat": {"q": 4},
    "msnn_bench_long": {"gamma": 3},
    "msnn_full_plus": {"lat": TINY_LAT, "long": {**TINY_LONG, "speed_window": True}},
}
"""Settings that keep every model of the registry small."""


def tiny(name):
    """A small model of the registry."""
    return build(name, TINY[name])


def drive(rows=150, seed=0, name="drive"):
    """One unbroken run of smooth random signals in the ranges of a 1:10 car; they obey no model."""
    rng = np.random.default_rng(seed)

    def smooth(size):
        raw = np.convolve(rng.standard_normal(rows + 4), np.ones(5) / 5, "valid")
        return size * raw / 0.45 + 0.01 * size * rng.standard_normal(rows)

    v_x = 2.2 + np.clip(smooth(0.6), -1.8, 1.8)
    steer = np.clip(smooth(0.15), -0.4, 0.4)
    yaw_rate = 2.8 * v_x * steer + 0.1 * rng.standard_normal(rows)
    signals = {
        "v_x": v_x,
        "steer": steer,
        "yaw_rate": yaw_rate,
        "a_x": np.clip(smooth(1.5), -5, 5),
        "a_y": v_x * yaw_rate + 0.2 * rng.standard_normal(rows),
        "motor_current": smooth(2.0),
    }
    return Recording(name, DT * np.arange(rows), signals)


def joined(*lengths, seed=0):
    """Several runs in one recording."""
    return join([drive(rows, seed + k) for k, rows in enumerate(lengths)], "joined")


def without(recording, *names):
    """The recording lacking some signals."""
    return replace(recording, signals={n: v for n, v in recording.signals.items() if n not in names})


def scattered(model, seed=0, share=0.3):
    """The model at random parameter values about the nominal ones, within bounds; infinite ones stay."""
    rng = np.random.default_rng(seed)
    moved = []
    for p in model.parameters:
        spread = share * (np.abs(np.where(np.isfinite(p.array), p.array, 0.0)) + 0.05 * (p.bounds[0] == -np.inf))
        moved.append(p.with_value(np.clip(p.array + spread * rng.standard_normal(p.shape), *p.bounds)))
    return model.with_parameters(*moved)


def linear_toy(length=3, prior=None, symmetric=False, **entries):
    """Yaw rate as a finite impulse response to steer: linear in its parameters."""
    given = Parameter("F", "1/s", np.zeros(length), prior=prior)
    return MemoryModel(
        name="toy", about="a finite impulse response", inputs=("steer",), outputs=("yaw_rate",), parameters=(given,),
        equations=lambda u, p, past: {"yaw_rate": past(u.steer, p.F)}, sample_time=DT, symmetric=symmetric, **entries,
    )  # fmt: skip


def speed_toy(**entries):
    """A loop of one state: the predicted acceleration is fed back, dragged along and pushed by the current."""
    return MemoryModel(
        name="loop", about="one state", inputs=("motor_current", "a_x"), outputs=("a_x",),
        parameters=(Parameter("pole", "1", 0.6, (0.0, 0.95)), Parameter("gain", "m/(s^2 A)", 0.5, prior=Prior(1.0))),
        equations=lambda u, p, past: {"a_x": p.pole * past(u.a_x, [0.2, 0.8]) + p.gain * u.motor_current},
        feedback=lambda y, u: {"a_x": y.a_x}, sample_time=DT, **entries,
    )  # fmt: skip


def obeying_toy(F, rows=400, seed=0, noise=0.0):
    """A recording that the linear toy with impulse response F explains up to white noise."""
    rng = np.random.default_rng(seed)
    steer = 0.2 * rng.standard_normal(rows)
    yaw_rate = np.concatenate([np.zeros(1), np.convolve(steer, F[::-1])[: rows - 1]])
    return Recording(
        "obeying", DT * np.arange(rows), {"steer": steer, "yaw_rate": yaw_rate + noise * rng.standard_normal(rows)}
    )


def looping(recording, pole, gain, noise=0.0):
    """The recording with an acceleration that the loop of one state explains up to white noise."""
    current, a = recording["motor_current"], [0.1, 0.2]
    for k in range(2, len(recording)):
        a.append(pole * (0.2 * a[k - 2] + 0.8 * a[k - 1]) + gain * current[k - 1])
    return recording.with_signals(a_x=np.array(a) + noise * np.random.default_rng(0).standard_normal(len(a)))
