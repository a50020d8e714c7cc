"""What driving still explains of the residuals is found, and white noise has nothing of it."""

import numpy as np
import pytest
from gap_cases import GivenBench, search_on

from greybox_id.gap.leftover import left_gain

ROWS, SD = 3000, np.array([0.1, 0.3])
TIME = 0.02 * np.arange(ROWS)


def wave(period, seed):
    rng = np.random.default_rng(seed)
    return sum(np.sin(2 * np.pi * TIME / period / f + rng.uniform(0, 6)) for f in (0.4, 1.0, 1.7))


SEEN = {"v_x": 15 + 3 * wave(20.0, 1), "a_y": 3 * wave(4.0, 2), "a_x": wave(9.0, 3), "yaw_rate": 0.2 * wave(4.0, 4),
        "steer": 0.05 * wave(4.0, 5)}  # fmt: skip
ORDINARY = {"v_x": SEEN["v_x"]}


def excess(structure=0.0, seed=0, seen=None, rows=ROWS):
    """Gained over expected, in standard deviations of what noise alone gains."""
    noise = SD * np.random.default_rng(seed).standard_normal((ROWS, 2))
    noise[:, 1] += structure
    bench = GivenBench(lambda p: np.zeros((ROWS, 2)), noise, 0, channels=("a_x", "a_y"))
    bench.counted[rows:] = False
    search = search_on(bench, SD)
    found = search.at_means()
    found = found.__class__(found.candidates, found.m, found.theta, found.linear, 0.0, -noise, found.J)
    gained, expected = left_gain(search, found, SEEN if seen is None else seen)
    return gained, expected, (gained - expected) / np.sqrt(max(expected, 1e-9))


def test_white_noise_gains_what_is_expected():
    found = np.array([excess(seed=seed) for seed in range(60)])
    assert np.mean(found[:, 0]) == pytest.approx(found[0, 1], rel=0.1)
    assert np.mean(found[:, 2] > 4.0) <= 0.02


def test_a_residual_that_goes_with_lateral_acceleration_times_speed_is_found():
    product = SEEN["a_y"] * (SEEN["v_x"] - np.mean(SEEN["v_x"]))
    structure = 0.2 * SD[1] * product / np.std(product)
    gained, expected, off = excess(structure)
    assert off > 10
    assert gained - expected == pytest.approx(0.5 * ROWS * 0.2**2, rel=0.3)  # all of what it explains


@pytest.mark.parametrize(
    "structure",
    [
        SEEN["a_x"] * SEEN["a_y"], np.sign(SEEN["a_y"]), np.abs(SEEN["a_x"]), TIME * SEEN["a_y"],
        np.roll(SEEN["a_y"], 20),
    ],
    ids=["product", "sign", "size", "drift", "late"],
)  # fmt: skip
def test_other_shapes_are_found(structure):
    assert excess(0.2 * SD[1] * structure / np.std(structure))[2] > 10


def test_what_has_nothing_to_do_with_driving_is_not_found():
    assert excess(0.3 * SD[1] * np.sin(2 * np.pi * 7 * TIME))[2] < 4


def test_few_readings_and_few_signals_tell_nothing_wrong():
    assert excess(rows=60)[:2] == (0.0, 0.0)
    gained, expected, off = excess(seen=ORDINARY)
    assert np.isfinite(gained)
    assert abs(off) < 4
    assert expected > 0
