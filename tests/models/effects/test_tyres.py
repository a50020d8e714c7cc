"""Forces of tyres beyond a fixed curve."""

import numpy as np
import pytest
from driving import read

from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import single_track
from greybox_id.models.tyres import TYRES

TURNING = {"v_x": 20.0, "v_y": -0.4, "yaw_rate": 0.3}
"""Both axles slip."""


def forces(effect, magnitude, drive=0.0, tyre="pacejka", states=TURNING, **parameters):
    model = single_track(TYRES[tyre]) + EFFECTS[effect].at(magnitude)
    names = ("F_yf", "F_yr", "F_xf", "F_xr", "peak_f", "peak_r", "grip_f", "grip_r", "F_zf", "F_zr", "a_y")
    return read(model, names, states, {"steer": 0.05, "drive": drive}, **parameters)


def test_a_longitudinal_force_takes_its_part_of_the_friction_ellipse():
    free, braked = forces("combined_slip", 0.0, -6.0), forces("combined_slip", 0.8, -6.0)
    for axle in "fr":
        taken = 0.8 * braked[f"F_x{axle}"] / braked[f"peak_{axle}"]
        assert braked[f"F_y{axle}"] == pytest.approx(free[f"F_y{axle}"] * np.sqrt(1 - taken**2), rel=1e-6)


def test_more_longitudinal_force_than_friction_leaves_next_to_no_lateral_force_and_never_a_negative_one():
    for drive in (-20.0, -40.0, -400.0):
        locked = forces("combined_slip", 1.0, drive)
        assert 0 < locked["F_yf"] / forces("combined_slip", 0.0, drive)["F_yf"] < 0.03


def test_a_tyre_without_a_peak_knows_no_ellipse():
    assert forces("combined_slip", 1.0, -6.0, "linear") == forces("combined_slip", 0.0, -6.0, "linear")


@pytest.mark.parametrize("tyre", ["pacejka", "dugoff", "brush"])
def test_grip_of_loads_is_that_of_two_wheels_at_the_accelerations_they_give(tyre):
    k = 0.2
    found = forces("load_sensitivity", k, tyre=tyre)
    for axle, share in (("f", 0.55), ("r", 0.45)):
        wheel, transfer = found[f"F_z{axle}"] / 2, share * 1450.0 * found["a_y"] * 0.55 / 1.55
        wheels = wheel + transfer, wheel - transfer
        friction = sum(F_z * (1 - k * (F_z - wheel) / wheel) for F_z in wheels) / (2 * wheel)
        assert found[f"grip_{axle}"] == pytest.approx(friction, rel=1e-3)


def test_a_wheel_that_has_lifted_carries_nothing_and_no_more():
    high = forces("load_sensitivity", 0.2, h_cg=2.5)
    assert high["grip_f"] == pytest.approx(0.8, abs=1e-3)


def test_tyres_that_have_done_their_friction_work_have_lost_their_share_of_grip():
    for work, left in ((0.0, 1.0), (2e4, 1 - 0.2 * (1 - np.exp(-1))), (1e7, 0.8)):
        warm = forces("tyre_temperature", 0.2, states={**TURNING, "friction_work": work})
        assert warm["grip_f"] == pytest.approx(left)


def test_slopes_go_along_with_friction_as_far_as_is_said():
    """A factor on Pacejka's D takes the slope B C D along, another road does not."""
    barely = {"v_x": 20.0, "v_y": 0.0, "yaw_rate": 0.0}
    model = single_track(TYRES["pacejka"]) + EFFECTS["grip_scale"].at(0.6)

    def front(slip, share, own=model):
        other = {"grip_scale_slope": share} if own is model else {}
        return read(own, ("F_yf",), barely, {"steer": slip, "drive": 0.0}, **other)["F_yf"]

    for slip, share, left in ((1e-4, 1.0, 0.6), (1e-4, 0.0, 1.0), (1e-4, 0.5, 0.6**0.5), (0.4, 0.0, 0.6)):
        found = front(slip, share) / front(slip, 1.0, single_track(TYRES["pacejka"]))
        assert found == pytest.approx(left, rel=1e-3 if slip < 0.1 else 0.05)


@pytest.mark.parametrize("tyre", ["dugoff", "brush"])
def test_tyres_whose_slope_is_a_number_of_its_own_keep_it_anyway(tyre):
    small = {"v_x": 20.0, "v_y": 0.0, "yaw_rate": 0.0}
    model = single_track(TYRES[tyre]) + EFFECTS["grip_scale"].at(0.6)
    for share in (0.0, 1.0):
        found = read(model, ("F_yf",), small, {"steer": 1e-5, "drive": 0.0}, grip_scale_slope=share)["F_yf"]
        usual = read(single_track(TYRES[tyre]), ("F_yf",), small, {"steer": 1e-5, "drive": 0.0})["F_yf"]
        assert found == pytest.approx(usual, rel=1e-3)
