"""What equations of a stated vehicle leave out."""

from dataclasses import replace

import numpy as np
import pytest
from driving import read
from linearised import rates, vector

from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.roughness import with_roughness
from greybox_id.models.vehicle import Vehicle

SD = {"B_f": Stated(10.0, 0.2), "C_f": Stated(1.4, 0.01), "c_0": Stated(200.0, 8.0), "c_2": Stated(0.45, 0.02)}
USUAL = 15.0
DRIVEN = {"speed": USUAL, "steer": 0.1, "drive": 2.0}
TURNING = (12.0, -0.3, 0.5)
"""v_x, v_y and yaw rate of a turn to the left."""


def rough(name="single_track", **values):
    return with_roughness(build(name), Vehicle("car", {**SD, **values}), DRIVEN)


def test_they_stand_beside_stated_tolerances_and_nowhere_else():
    combined = ("combined_power", "combined_balance")
    assert named() == ("steered_wheels", "power_of_c_0", "power_of_c_2", *combined)
    assert named(c_0=Stated(200.0)) == ("steered_wheels", "power_of_c_2", *combined)
    assert named(C_f=Stated(1.4)) == ("power_of_c_0", "power_of_c_2", *combined)
    exact = Vehicle("car", {name: replace(own, sd=None) for name, own in SD.items()})
    assert with_roughness(build("single_track"), exact, DRIVEN).effects == ()
    assert rough("kinematic").effects == ()


def named(**values):
    """Those that are no errors of a force by regime."""
    return tuple(name for name in rough(**values).effects if not name.startswith("form_"))


@pytest.mark.parametrize("name", ["single_track", "lateral"])
def test_errors_of_form_are_relative_to_the_force_and_grow_with_how_one_drives(name):
    model = rough(name)
    forms = [effect for effect in model.effects if effect.startswith("form_")]
    drives = {"single_track": 6, "lateral": 3}[name]
    assert len([form for form in forms if "F_yf" in form]) == drives
    assert all(model[form].prior.sd == 0.01 for form in forms)


def test_an_error_of_the_front_force_by_steering_is_that_share_of_it_at_the_usual_angle():
    model = rough()
    given = {"steer": 0.1, "drive": 0.0}
    without, with_it = (rates(model, TURNING, p=vector(model, form_F_yf_steer=k), **given) for k in (0.0, 0.1))
    p = {parameter.name: float(parameter.array) for parameter in model.parameters if parameter.shape == ()}
    before, after = (p["m"] * (own["v_y"] + TURNING[2] * TURNING[0]) for own in (without, with_it))
    turning = without["yaw_rate"] * p["I_z"]
    F_yf = (p["l_r"] * before + turning) / (p["l_f"] + p["l_r"])
    assert after - before == pytest.approx(0.1 * F_yf, rel=1e-6)


@pytest.mark.parametrize(("name", "usual", "twice"), [("braking", 0.1, 0.2), ("hard_braking", 0.1 / 3, 0.4 / 3)])
def test_errors_of_form_under_brakes_are_none_of_what_drives(name, usual, twice):
    model = rough()
    for drive, share in ((2.0, 0.0), (-2.0, usual), (-4.0, twice)):
        given = {"steer": 0.0, "drive": drive}
        plain, off = (rates(model, TURNING, p=vector(model, **{f"form_F_yr_{name}": k}), **given) for k in (0.0, 0.1))
        p = {each.name: float(each.array) for each in model.parameters if each.shape == ()}
        turning, across = plain["yaw_rate"] * p["I_z"], p["m"] * (plain["v_y"] + TURNING[2] * TURNING[0])
        F_yr = (p["l_f"] * across - turning) / (p["l_f"] + p["l_r"])
        assert p["m"] * (off["v_y"] - plain["v_y"]) == pytest.approx(share * F_yr, rel=1e-6, abs=1e-6)


def left_beside(drive, slip=1.0, **values):
    """Share of the lateral force of each axle beside a longitudinal one, and the friction that this one uses."""
    model = with_roughness(build("single_track"), Vehicle("car", SD), DRIVEN) + EFFECTS["combined_slip"]
    names = ("F_yf", "F_yr", "F_xf", "F_xr", "peak_f", "peak_r")
    states = dict(zip(("v_x", "v_y", "yaw_rate"), TURNING, strict=True))
    free, braked = (
        read(model, names, states, {"steer": 0.05, "drive": drive}, combined_slip=s, **values) for s in (0.0, slip)
    )
    return [(braked[f"F_y{k}"] / free[f"F_y{k}"], abs(slip * braked[f"F_x{k}"] / braked[f"peak_{k}"])) for k in "fr"]


@pytest.mark.parametrize("drive", [-1.0, -4.0])
def test_the_power_of_combined_slip_goes_from_an_ellipse_to_tyres_that_saturate_exponentially(drive):
    for left, used in left_beside(drive):
        assert left == pytest.approx(np.sqrt(1 - used**2), rel=1e-6)
    for left, used in left_beside(drive, combined_power=1.0):
        assert left == pytest.approx(np.sqrt(1 - used), rel=2e-3)
    (left, used), _ = left_beside(-1.0, combined_power=1.0)
    # a force of size 1 - exp(-s) in the direction of its slip, little of it lateral
    assert left == pytest.approx(-used / np.log1p(-used), abs=0.02)


def test_the_balance_of_combined_slip_is_that_share_more_of_it_in_front_and_less_behind():
    plain, more = left_beside(-4.0), left_beside(-4.0, combined_balance=0.2)
    for (_, used), (left, _), by in zip(plain, more, (1.2, 0.8), strict=True):
        assert left == pytest.approx(np.sqrt(1 - (by * used) ** 2), rel=1e-6)


def test_without_combined_slip_its_form_is_nothing():
    plain, other = (left_beside(-4.0, slip=0.0, **values) for values in ({}, {"combined_power": 1.0}))
    assert [left for left, _ in plain] == [left for left, _ in other] == [1.0, 1.0]


@pytest.mark.parametrize("name", ["steered_wheels", "power_of_c_0", "power_of_c_2", "combined_power"])
def test_each_is_one_number_that_is_believed_to_be_nothing(name):
    own = rough()[name]
    assert float(own.array) == 0.0
    assert 0 < own.prior.sd <= 0.5
    assert not own.fixed


@pytest.mark.parametrize("steer", [0.1, -0.2])
def test_steered_wheels_turn_the_car_back_as_two_wheels_do_that_share_force_as_they_share_load(steer):
    model = rough()
    z = TURNING if steer > 0 else (TURNING[0], -TURNING[1], -TURNING[2])
    given = {"steer": steer, "drive": 0.0}
    without, with_it = (rates(model, z, p=vector(model, steered_wheels=k), **given) for k in (0.0, 1.0))
    p = {parameter.name: float(parameter.array) for parameter in model.parameters if parameter.shape == ()}
    L = p["l_f"] + p["l_r"]
    turning = without["yaw_rate"] * p["I_z"]
    across = p["m"] * (without["v_y"] + z[2] * z[0])
    F_yr = (p["l_f"] * across - turning) / L
    F_yf = (across - F_yr) / np.cos(steer)
    load, transfer = p["m"] * 9.81 * p["l_r"] / L, 0.55 * (F_yf + F_yr) * p["h_cg"] / p["track_f"]
    left, right = (0.5 * F_yf * (1 + side * 2 * transfer / load) for side in (-1, 1))
    expected = (left - right) * np.sin(steer) * p["track_f"] / 2
    assert (with_it["yaw_rate"] - without["yaw_rate"]) * p["I_z"] == pytest.approx(expected, rel=1e-6)
    assert expected * steer < 0
    assert with_it["v_x"] == without["v_x"]
    assert with_it["v_y"] == without["v_y"]


@pytest.mark.parametrize(("name", "power"), [("c_0", 0.0), ("c_2", 2.0)])
def test_resistance_of_another_power_is_as_stated_at_the_usual_speed(name, power):
    model = rough()

    def resistance(v, n):
        given = {"c_0": 0.0, "c_1": 0.0, "c_2": 0.0, name: 1.0, f"power_of_{name}": n}
        p = vector(model, **given)
        return -rates(model, (v, 0.0, 0.0), p=p, steer=0.0, drive=0.0)["v_x"] * float(model["m"].array)

    assert resistance(USUAL, 0.2) == pytest.approx(USUAL**power, rel=1e-9)
    for v in (0.8 * USUAL, 1.25 * USUAL):
        assert resistance(v, 0.1) == pytest.approx(USUAL**power * (v / USUAL) ** (power + 0.1), rel=0.01)
