"""Offsets at rest."""

import numpy as np
import pytest
from simulated import clean

from greybox_id.datasets.checks.consistency import check_rest
from greybox_id.datasets.read import read


def parked(offset, seed=1):
    recording = clean(seed)
    rng = np.random.default_rng(seed)
    n = 200
    signals = {name: recording[name].copy() for name in ("v_x", "yaw_rate", "a_x", "a_y")}
    for values in signals.values():
        values[:n] = 0.01 * rng.standard_normal(n)
    signals["v_x"][:n] = 0.0
    signals["yaw_rate"] += offset
    return recording.with_signals(**signals)


def test_a_gyro_offset_is_measured_with_its_uncertainty():
    (finding,) = check_rest(parked(0.03))
    assert finding.where.channel == "yaw_rate"
    assert finding.value == pytest.approx(0.03, abs=4 * finding.uncertainty)
    assert finding.unit == "rad/s"


def test_no_offset_no_finding_and_no_rest_no_finding():
    assert check_rest(parked(0.0)) == []
    recording = clean(1)
    assert check_rest(recording.with_signals(yaw_rate=recording["yaw_rate"] + 0.03)) == []


def test_offsets_of_the_roboracer_are_found(real_data):
    train = read(real_data / "roboracer" / "train.csv", "roboracer")
    offsets = {finding.where.channel: finding.value for finding in check_rest(train)}
    assert offsets["yaw_rate"] == pytest.approx(0.027, abs=0.001)
    assert offsets["a_x"] == pytest.approx(-0.27, abs=0.03)
    assert offsets["a_y"] == pytest.approx(-0.16, abs=0.03)
