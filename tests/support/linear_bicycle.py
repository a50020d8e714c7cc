"""Recordings of a linear single track with known stiffnesses, integrated by a matrix exponential: nobody's model."""

import numpy as np
from scipy.linalg import expm

from greybox_id.datasets.recording import Recording
from greybox_id.models.parameter import Stated
from greybox_id.models.vehicle import Vehicle

SIMROD = {"m": 930.0, "I_z": 700.0, "l_f": 1.175, "l_r": 1.171}
VEHICLE = Vehicle("SimRod", {name: Stated(value) for name, value in SIMROD.items()})
NOISE = {"v_y": 0.05, "yaw_rate": 0.01, "a_y": 0.2}


def recorded(steer, v_x, C_f, C_r, *, I_z=700.0, rate=100.0, seed=None, name="linear"):
    """One manoeuvre at constant speed; steering is held between rows, rows are read just after it (paper, Eq. 6-8)."""
    m, l_f, l_r = SIMROD["m"], SIMROD["l_f"], SIMROD["l_r"]
    A = -np.array(
        [
            [(C_f + C_r) / (m * v_x), v_x + (l_f * C_f - l_r * C_r) / (m * v_x)],
            [(l_f * C_f - l_r * C_r) / (I_z * v_x), (C_f * l_f**2 + C_r * l_r**2) / (I_z * v_x)],
        ]
    )
    B = np.array([C_f / m, l_f * C_f / I_z])
    step = expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) / rate)
    x = np.zeros((len(steer), 2))
    for k in range(1, len(steer)):
        x[k] = step[:2, :2] @ x[k - 1] + step[:2, 2] * steer[k - 1]
    rates = x @ A.T + np.outer(steer, B)
    truth = {"v_y": x[:, 0], "yaw_rate": x[:, 1], "a_y": rates[:, 0] + v_x * x[:, 1]}
    rng = np.random.default_rng(seed)
    noisy = {n: v + (0.0 if seed is None else NOISE[n]) * rng.standard_normal(len(v)) for n, v in truth.items()}
    signals = {"v_x": np.full(len(steer), v_x), "steer": np.asarray(steer), **noisy}
    return Recording(name, np.arange(len(steer)) / rate, signals)


def sine(amplitude, frequency, rows=300, rate=100.0):
    return amplitude * np.sin(2.0 * np.pi * frequency * np.arange(rows) / rate)


def steps(amplitude, rows=300, rate=100.0):
    """To one side, to the other and back, as fast as hands turn a steering wheel: 0.3 rad/s at the road wheels."""
    at = np.arange(rows) / rows
    aim = amplitude * np.select([at < 0.1, at < 0.5, at < 0.9], [0.0, 1.0, -1.0], 0.0)
    steer, most = np.zeros(rows), 0.3 / rate
    for k in range(1, rows):
        steer[k] = steer[k - 1] + np.clip(aim[k] - steer[k - 1], -most, most)
    return steer


def manoeuvres(C_f, C_r, seed=0, **more):
    """Steps and sines at several speeds."""
    profiles = [(steps(0.03), 10.0), (sine(0.04, 0.7), 10.0), (steps(-0.02), 14.0), (sine(0.03, 1.2), 14.0),
                (sine(-0.02, 0.5), 12.0), (steps(0.025), 12.0)]  # fmt: skip
    return [
        recorded(steer, v_x, C_f, C_r, seed=None if seed is None else seed + k, name=f"manoeuvre {k}", **more)
        for k, (steer, v_x) in enumerate(profiles)
    ]
