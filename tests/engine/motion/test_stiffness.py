"""How long segments may be: a vehicle at standstill, recorded at a low rate, stays stable."""

import numpy as np
import pytest

from greybox_id.engine.motion.runs import motion_runs
from greybox_id.engine.motion.schedule import MOST_STEPS, STABLE, least_segment, longest_segment
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.models.registry import build
from greybox_id.recording import Recording
from greybox_id.scores.prediction import simulate

RACING = {"m": 787.0, "I_z": 1000.0, "l_f": 1.62, "l_r": 1.36, "B_f": 20.0, "B_r": 22.0, "C_f": 1.6, "C_r": 1.6,
          "D_f": 1.7, "D_r": 1.8}  # fmt: skip


def racing():
    model = build("lateral")
    return model.with_parameters(*(model[name].with_value(value) for name, value in RACING.items()))


def from_standstill(rate):
    time = np.arange(0.0, 20.0, 1.0 / rate)
    v_x = np.interp(time, [0, 5, 20], [0.0, 0.0, 60.0])
    steer = 0.01 * np.sin(time)
    nothing = 0.02 * np.random.default_rng(0).standard_normal((3, len(time)))
    return Recording("start", time, {"v_x": v_x, "steer": steer, "v_y": nothing[0], "yaw_rate": nothing[1]})


@pytest.mark.parametrize("rate", [10.0, 25.0, 100.0])
def test_a_racing_car_at_standstill_is_stable_whatever_the_rate(rate, monkeypatch):
    monkeypatch.setenv("GREYBOX_COMPILE", "0")
    model, recording = racing(), from_standstill(rate)
    longest = longest_segment(Simulator(model).trace, motion_runs(model, recording), model.values)
    C = sum(20.0 * 1.6 * 1.7 * 787.0 * 9.81 * share for share in (1.36 / 2.98, 1.62 / 2.98))
    assert longest <= STABLE / (C / 787.0 / 0.25), "at 0.25 m/s the sideslip decays at this rate, at least"
    found = simulate(model, recording)
    assert np.all(np.abs(found.predicted[:, 1]) < 3.0)


def test_rows_that_follow_each_other_fast_are_cut_no_finer_than_they_were():
    assert least_segment(0.01) == 0.01 / MOST_STEPS
    assert least_segment(0.005) == 0.005 / MOST_STEPS
    assert least_segment(0.04) == 2.5e-4
