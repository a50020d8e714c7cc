"""From drive command to force."""

import pytest
from driving import read

from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import single_track

SATURATED = single_track() + EFFECTS["motor_saturation"].at(2.0)
"""2 m/s^2 of 1450 kg, 1450 N per unit, from 10 m/s on falling."""


def force(v_x, drive):
    return read(SATURATED, ("drive_force",), {"v_x": v_x}, {"steer": 0.0, "drive": drive})["drive_force"]


def test_a_motor_gives_its_largest_force_and_from_a_speed_on_its_largest_power():
    assert force(5.0, 8.0) == pytest.approx(2900.0, rel=1e-3)
    assert force(20.0, 8.0) == pytest.approx(1450.0, rel=1e-3)
    assert force(40.0, 8.0) == pytest.approx(725.0, rel=1e-3)


def test_what_it_can_give_it_gives_and_brakes_do_as_they_are_told():
    assert force(5.0, 1.0) == pytest.approx(1450.0, rel=1e-3)
    assert force(5.0, 0.0) == 0.0
    assert force(40.0, -8.0) == -8.0 * 1450.0


def test_the_corner_is_rounded_by_half_a_per_cent():
    assert force(5.0, 2.0) == pytest.approx(0.995 * 2900.0, rel=1e-3)


def test_brake_bias_shares_out_braking_alone():
    biased = single_track() + EFFECTS["brake_bias"].at(0.1)
    braking, driving = (
        read(biased, ("F_xf", "F_xr"), {"v_x": 20.0}, {"steer": 0.0, "drive": drive}) for drive in (-1.0, 1.0)
    )
    assert braking == pytest.approx({"F_xf": -0.72 * 1450, "F_xr": -0.28 * 1450})
    assert driving == {"F_xf": 0.0, "F_xr": 1450.0}
