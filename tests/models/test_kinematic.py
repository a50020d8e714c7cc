"""The kinematic model: where its yaw rate settles, how it gets there, and where it ends."""

import numpy as np
import pytest
from linearised import outputs, rates, run, vector

from greybox_id.models.registry import build

MODEL = build("kinematic")
CAR = {"l_f": 1.2, "l_r": 1.5}


@pytest.mark.parametrize("K_us", [-1e-3, 0.0, 2e-3])
@pytest.mark.parametrize("v", [-2.0, 0.5, 20.0])
def test_yaw_rate_settles_where_geometry_and_understeer_say(v, K_us):
    p = vector(MODEL, **CAR, K_us=K_us, yaw_lag=0.1)
    settled = v * np.tan(0.1) / (2.7 + K_us * v**2)
    found = run(MODEL, [0.0], 300, 0.01, p=p, v_x=v, steer=0.1)
    assert found[-1, 0] == pytest.approx(settled, rel=1e-9)
    assert found[10, 0] == pytest.approx(settled * (1 - np.exp(-1)), rel=1e-5)
    assert outputs(MODEL, [settled], p=p, v_x=v, steer=0.1)["a_y"] == pytest.approx(v * settled)


def test_lateral_acceleration_is_that_of_rear_wheels_that_do_not_slip():
    """v_y = l_r yaw_rate, so that turning in throws the centre of gravity sideways."""
    given = {"p": vector(MODEL, **CAR, yaw_lag=0.2), "v_x": 10.0, "steer": 0.1}
    turning_in = rates(MODEL, [0.05], **given)["yaw_rate"]
    assert outputs(MODEL, [0.05], **given)["a_y"] == pytest.approx(10 * 0.05 + 1.5 * turning_in)


def test_without_understeer_it_is_purely_kinematic():
    model = build("kinematic", {"understeer": False})
    assert "K_us" not in model
    found = run(model, [0.0], 500, 0.01, p=vector(model, **CAR), v_x=50.0, steer=0.1)
    assert found[-1, 0] == pytest.approx(50.0 * np.tan(0.1) / 2.7)


def test_steering_wheel_angles_are_scaled_by_the_gain():
    p = vector(MODEL, **CAR, steer_gain=1 / 16)
    assert rates(MODEL, [0.0], p=p, v_x=10.0, steer=1.6) == rates(
        MODEL, [0.0], p=vector(MODEL, **CAR), v_x=10.0, steer=0.1
    )


def test_beyond_its_critical_speed_it_stays_finite():
    p = vector(MODEL, **CAR, K_us=-5e-3)
    found = run(MODEL, [0.0], 300, 0.01, p=p, v_x=60.0, steer=0.1)
    assert found[-1, 0] == pytest.approx(60 * np.tan(0.1) / 0.27)
