"""Masses and loads."""

import pytest
from driving import read

from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import G, single_track

WEIGHT = 1450.0 * G
TURNING = {"v_x": 20.0, "v_y": -0.4, "yaw_rate": 0.3}


def loads(effect, magnitude, drive=0.0, **parameters):
    model = single_track() + EFFECTS[effect].at(magnitude)
    return read(model, ("F_zf", "F_zr", "a_x"), TURNING, {"steer": 0.05, "drive": drive}, **parameters)


def test_a_payload_presses_on_the_tyres_as_much_as_it_resists():
    names = ("F_zf", "F_zr", "F_yf", "F_yr", "drive_force", "F_drag", "a_y")
    plain, laden = (
        read(single_track() + EFFECTS["mass_change"].at(m), names, TURNING, {"steer": 0.05, "drive": 0.0})
        for m in (1.0, 1.2)
    )
    for name in ("F_zf", "F_zr", "F_yf", "F_yr"):
        assert laden[name] == pytest.approx(1.2 * plain[name], rel=1e-12)
    for name in ("drive_force", "F_drag", "a_y"):
        assert laden[name] == pytest.approx(plain[name], rel=1e-12)


def test_a_payload_takes_friction_of_tyres_whose_friction_falls_with_load_and_no_force_of_a_motor():
    model = single_track() + EFFECTS["load_sensitivity"].at(0.1) + EFFECTS["motor_saturation"].at(2.0)
    straight = ({"v_x": 5.0}, {"steer": 0.0, "drive": 8.0})
    plain, laden = (
        read(model + EFFECTS["mass_change"].at(m), ("grip_f", "drive_force"), *straight) for m in (1.0, 1.2)
    )
    assert laden["grip_f"] == pytest.approx(1 - 0.1 * 0.2, rel=1e-3)
    assert laden["drive_force"] == pytest.approx(plain["drive_force"], rel=1e-12)


@pytest.mark.parametrize("drive", [-8.0, -2.0, 3.0])
def test_acceleration_moves_load_and_adds_none(drive):
    found = loads("longitudinal_load_transfer", 1.0, drive)
    assert found["F_zf"] + found["F_zr"] == pytest.approx(WEIGHT, rel=1e-6)
    moved = found["F_zr"] - loads("longitudinal_load_transfer", 0.0, drive)["F_zr"]
    assert moved == pytest.approx(1450.0 * found["a_x"] * 0.55 / 2.76, rel=1e-3)


def test_an_axle_that_has_lifted_carries_nothing():
    assert 0 < loads("longitudinal_load_transfer", 2.0, -20.0, h_cg=2.5)["F_zr"] < 1e-3 * WEIGHT


def test_downforce_is_split_as_the_weight_is():
    found = loads("downforce", 2.0)
    assert found["F_zf"] + found["F_zr"] == pytest.approx(WEIGHT + 2.0 * 20.0**2)
    assert found["F_zf"] / found["F_zr"] == pytest.approx(1.46 / 1.30)


def test_a_centre_of_gravity_further_forward_loads_the_front():
    found = loads("cog_shift", 0.1)
    assert found["F_zf"] == pytest.approx(WEIGHT * 1.56 / 2.76)


def test_a_body_in_steady_roll_adds_gravity_along_the_axle_and_none_when_it_does_not_roll():
    model = single_track() + EFFECTS["roll_dynamics"].at(0.01)
    given = {"steer": 0.05, "drive": 0.0}
    bare = read(single_track(), ("a_y",), TURNING, given)["a_y"]
    steady = read(model, ("a_y",), {**TURNING, "a_y_of_roll": bare}, given)["a_y"]
    assert steady == pytest.approx(bare * (1 + 0.01 * G))
