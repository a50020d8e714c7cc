"""The steering actuator, against the response of a first-order system in closed form."""

import numpy as np
import pytest

import greybox_id as gb
from greybox_id.datasets.recording import Recording


def test_lag_and_gain_of_a_measured_servo_are_recovered_within_their_intervals():
    rng, time = np.random.default_rng(3), np.arange(0.0, 20.0, 0.02)
    command = 0.1 * np.repeat(rng.standard_normal(50), 20)
    angle = np.zeros(len(time))
    for k in range(1, len(time)):
        angle[k] = 0.9 * command[k - 1] + (angle[k - 1] - 0.9 * command[k - 1]) * np.exp(-0.02 / 0.08)
    signals = {"steer": command, "steer_measured": angle + 0.001 * rng.standard_normal(len(time))}
    fit = gb.fit("steering", Recording("servo", time, signals, hold="zero"))
    low, high = np.array([fit.conf_int(0.95).loc[name] for name in ("lag", "gain")]).T
    assert np.all((low < [0.08, 0.9]) & (high > [0.08, 0.9]))
    assert float(fit.model["lag"].value) == pytest.approx(0.08, rel=0.02)
