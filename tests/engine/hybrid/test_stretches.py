"""Stretches end where an input is missing, the vehicle is slow or a run ends; windows compare each row once."""

from dataclasses import replace

import numpy as np
import pytest
from linear_bicycle import manoeuvres, recorded, sine

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import join
from greybox_id.engine.hybrid.stretches import noise, stretches, windows
from greybox_id.models.registry import build

MODEL = build("hybrid_force", {"window": 60})


def test_a_stretch_ends_at_a_gap_a_standstill_and_a_join():
    one = recorded(sine(0.02, 0.5), 12.0, 5e4, 6e4)
    steer, v_x = one["steer"].copy(), one["v_x"].copy()
    steer[100] = np.nan
    v_x[200:210] = 1.0
    both = join([one.with_signals(steer=steer, v_x=v_x), one], "both")
    found = [(each.rows.start, each.rows.stop) for each in stretches(MODEL, both)]
    assert found == [(0, 100), (101, 200), (210, 300), (300, 600)]


def test_what_a_recording_lacks_follows_from_what_it_holds():
    one = recorded(sine(0.02, 0.5), 12.0, 5e4, 6e4)
    kept = {name: one[name] for name in ("v_x", "steer", "a_y", "yaw_rate")}
    other = type(one)("other", one.time, kept | {"sideslip": np.arctan2(one["v_y"], one["v_x"])})
    assert np.allclose(MODEL.read("v_y", other), one["v_y"])
    assert MODEL.read("v_y", type(one)("bare", one.time, kept)) is None
    rate = MODEL.read("yaw_acceleration", other)
    assert np.allclose(rate[1:-1], (one["yaw_rate"][2:] - one["yaw_rate"][:-2]) / 0.02)


def test_a_steering_that_is_held_acts_as_half_its_step():
    held = recorded(sine(0.02, 0.5), 12.0, 5e4, 6e4)
    (found,) = stretches(MODEL, held)
    v_x, steer, acting_v_x, acting_steer = found.inputs
    assert np.allclose(acting_steer[1:], 0.5 * (steer[1:] + steer[:-1]))
    assert np.array_equal(acting_v_x, v_x)
    (straight,) = stretches(MODEL, replace(held, hold="linear"))
    assert np.array_equal(straight.inputs[3], steer)


def test_every_row_after_the_warm_up_is_compared():
    one = recorded(sine(0.02, 0.5, 333), 12.0, 5e4, 6e4)
    laid = windows(MODEL, stretches(MODEL, one))
    assert laid.inputs.shape[2] == 8  # seven of 40 rows after 20, and one that ends with the recording
    assert np.all(np.isnan(laid.outputs[: MODEL.warm_up]))
    compared = laid.outputs[MODEL.warm_up :, 0, :-1].T.ravel()
    assert np.array_equal(compared, one["a_y"][20 : 20 + len(compared)])
    assert laid.outputs[-1, 0, -1] == one["a_y"][-1]


def test_noise_is_told_by_what_readings_scatter_about():
    model = build("hybrid_force")
    sd = noise([each for one in manoeuvres(5e4, 6e4) for each in stretches(model, one)])
    assert sd[:3] == pytest.approx([0.2, 0.01, 0.05], rel=0.15)
    # central differences at 100 Hz of readings with 0.01 rad/s
    assert sd[3] == pytest.approx(0.01 * np.sqrt(2.0) / 0.02, rel=0.2)


def test_another_sample_time_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match=r"sample time of 0\.02 s"):
        stretches(MODEL, recorded(sine(0.02, 0.5), 12.0, 5e4, 6e4, rate=50.0))


def test_stretches_shorter_than_a_window_are_refused_in_a_sentence():
    with pytest.raises(BadInput, match="60 rows"):
        windows(MODEL, stretches(MODEL, recorded(sine(0.02, 0.5, 30), 12.0, 5e4, 6e4)))
