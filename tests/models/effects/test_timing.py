"""When sensors read."""

import numpy as np
import pytest
from driving import driven

from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import single_track

TIME = np.arange(100) / 50
SLALOM = {"time": TIME, "steer": 0.05 * np.sin(6 * TIME), "drive": np.cos(3 * TIME)}
START = {"v_x": 20.0, "v_y": 0.0, "yaw_rate": 0.0}
BARE = driven(single_track(), SLALOM, START)


def late(*effects):
    model = single_track()
    for name, magnitude in effects:
        model = model + EFFECTS[name].at(magnitude)
    return driven(model, SLALOM, START)


@pytest.mark.parametrize(("name", "outputs"), [
    ("sensor_latency_yaw", {"yaw_rate"}), ("sensor_latency_vx", {"v_x"}),
    ("sensor_latency_imu", {"yaw_rate", "a_x", "a_y"}),
])  # fmt: skip
def test_a_latency_of_whole_rows_reads_what_was_there_rows_before(name, outputs):
    found = late((name, 0.04))
    for output, values in found.items():
        expected = np.concatenate([[BARE[output][0]] * 2, BARE[output][:-2]]) if output in outputs else BARE[output]
        np.testing.assert_allclose(values, expected, atol=1e-9)


def test_latencies_of_one_reading_add_up():
    both = late(("sensor_latency_yaw", 0.013), ("sensor_latency_imu", 0.027))
    np.testing.assert_allclose(both["yaw_rate"][2:], BARE["yaw_rate"][:-2], atol=1e-6)


@pytest.mark.parametrize("name", ["timestamp_jitter", "dropped_samples"])
def test_what_only_scatters_or_repeats_readings_moves_no_expected_one(name):
    found = late((name, EFFECTS[name].typical))
    assert all(np.array_equal(found[output], BARE[output]) for output in BARE)
