"""Commands between rows, where no column map says how they run: as the recording is explained better."""

from dataclasses import replace

import numpy as np
import pytest
from driven import NOISE, commands, without

import greybox_id as gb
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

EFFECTS = ["steering_delay", "steering_offset", "yaw_rate_bias"]


def drive(hold, seconds=20.0):
    """A single track whose commands run so between rows of 0.05 s, read with noise; the hold is known."""
    model, rng = build("single_track", None, {}, vehicle("full_size_car")), np.random.default_rng(5)
    given = replace(without(commands(seconds, 3, dt=0.05), "v_x"), hold=hold)
    result = simulate(model, given, {"v_x": 18.0})
    read = {n: result.predicted[:, k] + NOISE[n] * rng.standard_normal(len(given.time))
            for k, n in enumerate(model.outputs) if n in NOISE}  # fmt: skip
    return given.with_signals(**read)


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_hold_that_is_not_stated_is_the_one_that_explains_more(hold):
    unstated = replace(drive(hold), hold="zero", hold_stated=False)
    gap = gb.diagnose("single_track", unstated, vehicle="full_size_car", effects=EFFECTS)
    assert not gap.applied
    assert not gap.gap_detected
    assert any('state hold = "linear"' in doubt for doubt in gap.doubts) == (hold == "linear")


def test_a_hold_that_is_stated_is_kept():
    stated = replace(drive("linear"), hold="zero", hold_stated=True)
    gap = gb.diagnose("single_track", stated, vehicle="full_size_car", effects=EFFECTS)
    assert not any("hold" in doubt for doubt in gap.doubts)
