"""What may be there: each effect with the sizes and forms from which a search may see it."""

from math import log, pi

import pytest
from gap_cases import CAR, nominal

from greybox_id.gap.estimation.axes import nuisances, shifting
from greybox_id.gap.estimation.causes import causes
from greybox_id.gap.estimation.preparing import prepare
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.vehicle import Vehicle

DT = 0.02


def found(vehicle=CAR, rough=False):
    prepared = prepare(nominal(vehicle=vehicle), [], EFFECTS, vehicle)
    moving = shifting(prepared.everything)
    stated = [own for own in nuisances(prepared.everything, EFFECTS, moving) if not own.narrow]
    return {own.name: own for own in causes(prepared.everything, prepared.effects, moving, stated, DT, rough)}


def test_every_start_lies_within_bounds_and_off_the_null():
    for cause in found().values():
        for form in cause.forms:
            for start in form.starts:
                assert len(start) == len(form.candidate.axes)
                assert start[0] != cause.main.null
                for each, coordinate in zip(form.candidate.axes, start, strict=True):
                    assert each.low <= coordinate <= each.high


def test_effects_that_a_derivative_tells_all_about_need_no_starts():
    own = found()
    gradual = ("mass_change", "road_slope", "steering_ratio", "yaw_rate_bias")
    assert all(own[name].gradual and not own[name].forms[0].starts for name in gradual)
    abrupt = ("steering_delay", "sensor_latency_yaw", "steering_backlash", "steering_rate_limit", "motor_saturation")
    assert all(len(own[name].forms[0].starts) >= 3 and not own[name].gradual for name in abrupt)


def test_a_direction_is_looked_at_all_round():
    (wind,) = found()["wind_gust"].forms
    assert {start[1] for start in wind.starts} == {0.0, pi / 2, pi, -pi / 2}


def test_a_frequency_is_looked_at_within_a_factor_of_five_and_believed_within_that():
    (roll,) = found()["roll_dynamics"].forms
    frequency = roll.seconds[0]
    looked = sorted({start[1] for start in roll.starts})
    assert looked[-1] - looked[0] == pytest.approx(log(2.9 / 0.6))
    assert frequency.relative
    assert frequency.value(frequency.mean) == pytest.approx(1.5)
    assert frequency.sd == pytest.approx(0.5 * log(2.9 / 0.6))


def test_zones_are_there_where_equations_are_rough_and_as_wide_as_what_is_stated():
    exact, rough = found(), found(rough=True)
    assert all(own.zone == 0.0 for own in exact.values())
    assert rough["mass_change"].zone == pytest.approx(0.05 * 0.15)
    assert rough["imu_lever_arm"].zone == pytest.approx(0.05 * 0.15 * 2.761)  # a length goes with the wheelbase
    assert rough["steering_delay"].zone >= 0.15 * DT
    stated = found(Vehicle("car", CAR.values, {"accel_bias_x": Stated(0.02, 0.05)}, CAR.noise), rough=True)
    assert (stated["accel_bias_x"].zone, stated["accel_bias_x"].main.mean) == (0.05, 0.02)
