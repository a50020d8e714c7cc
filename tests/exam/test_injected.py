"""Real recordings altered as an effect would have altered them: exactly, and nothing else."""

import numpy as np
import pytest

from greybox_id.errors import BadInput
from greybox_id.exam.real import INJECTIONS, SOURCES, altered, make_injected
from greybox_id.models.effects import EFFECTS
from greybox_id.recording import Recording


def said(*_, **__):
    pass


@pytest.fixture
def window():
    time = np.concatenate([np.arange(100) * 0.02, np.arange(80) * 0.02])
    wave = np.sin(1.7 * np.arange(180) * 0.02)
    signals = {"v_x": 5.0 + wave, "v_y": 0.1 * wave, "yaw_rate": wave, "a_x": 0.3 * wave, "a_y": 2.0 * wave,
               "steer": 0.1 * wave}  # fmt: skip
    return Recording("drive", time, signals, runs=((0, 100), (100, 180)))


def test_every_injection_is_an_effect_and_its_null_is_nothing(window):
    assert set(INJECTIONS) <= set(EFFECTS)
    for name, own in INJECTIONS.items():
        same = altered(window, name, own.null)
        for signal, values in window.signals.items():
            np.testing.assert_allclose(same[signal], values, atol=1e-12)


def test_a_delay_means_that_the_command_was_given_earlier(window):
    late = altered(window, "steering_delay", 0.04)
    np.testing.assert_allclose(late["steer"][:98], window["steer"][2:100], atol=1e-12)
    np.testing.assert_allclose(late["steer"][100:178], window["steer"][102:180], atol=1e-12)  # not across the join
    assert late["yaw_rate"] is window["yaw_rate"] or np.array_equal(late["yaw_rate"], window["yaw_rate"])


def test_a_latency_reads_what_was(window):
    late = altered(window, "sensor_latency_yaw", 0.06)
    np.testing.assert_allclose(late["yaw_rate"][3:100], window["yaw_rate"][:97], atol=1e-12)
    np.testing.assert_allclose(late["yaw_rate"][103:], window["yaw_rate"][100:177], atol=1e-12)
    assert late["yaw_rate"][100] == window["yaw_rate"][100]


def test_a_ratio_and_an_offset_are_those_of_the_vehicle(window):
    np.testing.assert_allclose(1.2 * altered(window, "steering_ratio", 1.2)["steer"], window["steer"])
    np.testing.assert_allclose(altered(window, "steering_offset", 0.02)["steer"] + 0.02, window["steer"])


def test_a_turned_accelerometer_keeps_what_it_measures_in_all(window):
    turned = altered(window, "imu_mount_yaw", 0.2)
    before, after = (np.hypot(own["a_x"], own["a_y"]) for own in (window, turned))
    np.testing.assert_allclose(after, before)
    assert not np.allclose(turned["a_x"], window["a_x"])


def test_recordings_that_are_not_there_are_told(tmp_path):
    with pytest.raises(BadInput, match=r"holds none of roboracer/train\.csv"):
        make_injected(tmp_path / "exam", tmp_path, 1, 2, said)
    assert not (tmp_path / "exam").exists()
    assert {own.columns for own in SOURCES.values()} >= {"roboracer", "truck"}
