"""Directions in which parameters move: finite where a magnitude is not, beliefs as stated, what jumps told apart."""

from math import exp, inf

import pytest
from gap_cases import CAR, axis, nominal
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.gap.estimation.axes import candidates, nuisances, shifting
from greybox_id.gap.estimation.preparing import prepare
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.vehicle import Vehicle

TOLERANT = Vehicle(
    CAR.name,
    {**CAR.values, "m": Stated(1457.2, 4.4)},
    {"steering_lag": Stated(sd=0.003), "accel_bias_x": Stated(0.02, 0.01), "steering_delay": Stated(sd=0.002)},
    CAR.noise,
)


def found(model="single_track", vehicle=CAR):
    prepared = prepare(nominal(model, vehicle=vehicle), [], EFFECTS, vehicle)
    moving = shifting(prepared.everything)
    own = candidates(prepared.everything, prepared.effects, moving)
    return prepared.everything, {c.effect: c for c in own}, nuisances(prepared.everything, EFFECTS, moving)


@given(limit=st.floats(1e-3, 1e6))
def test_a_limit_comes_back_from_its_coordinate(limit):
    own = axis(0, inverse=True)
    assert own.value(own.coordinate(limit)) == pytest.approx(limit)
    assert own.coordinate(limit) == 1 / limit
    assert axis(0).value(limit) == limit


def test_no_limit_is_the_coordinate_zero():
    for name in ("steering_rate_limit", "motor_saturation"):
        own = found()[1][name].axes[0]
        assert own.inverse
        assert own.null == own.low == 0.0
        assert own.value(0.0) == inf
        assert own.value(-1e-9) == inf


@pytest.mark.parametrize("model", ["single_track", "lateral"])
def test_every_candidate_stands_where_the_model_has_it(model):
    everything, own, _ = found(model)
    values = everything.values
    for candidate in own.values():
        for each in candidate.axes:
            assert each.value(each.null) == values[each.index] or each.low == each.high
            assert each.low <= each.null <= each.high
            assert each.sd == inf
            assert each.scale > 0
    assert own["grip_scale"].axes[0].null == 1.0


def test_a_second_parameter_that_says_how_much_goes_along_makes_two_forms():
    forms = candidates(found()[0], {"grip_scale": EFFECTS["grip_scale"]}, frozenset())
    assert [(own.held, own.free) for own in forms] == [((0.0,), 1), ((1.0,), 1)]


def test_effects_of_sensors_say_which_outputs_they_change():
    by = {name: cause.reads for name, cause in found()[1].items()}
    assert by["yaw_rate_bias"] == by["sensor_latency_yaw"] == {"yaw_rate"}
    assert by["sensor_latency_imu"] == {"yaw_rate", "a_x", "a_y"}
    assert by["grip_scale"] == by["steering_delay"] == frozenset()
    assert found()[1]["wheel_speed_scale"].reads == {"v_x"}
    assert found("lateral")[1]["wheel_speed_scale"].reads == frozenset()  # there the motion takes that speed


def test_delays_and_latencies_are_what_moves_instants():
    everything, own, _ = found()
    late = {"steering_delay", "sensor_latency_yaw", "sensor_latency_vx", "sensor_latency_imu"}
    assert shifting(everything) == late
    assert {name for name, each in own.items() if each.axes[0].shift} == late
    assert all(own[name].axes[0].abrupt for name in late)
    assert not own["mass_change"].axes[0].abrupt


def test_a_magnitude_with_a_direction_has_no_sign():
    assert found()[1]["wind_gust"].axes[0].low == 0.0


def test_what_moves_instants_or_is_bounded_is_not_gradual():
    own = found()[1]
    assert all(own[name].gradual for name in ("mass_change", "road_slope", "steering_ratio", "yaw_rate_bias"))
    abrupt = ("steering_delay", "sensor_latency_yaw", "steering_backlash", "steering_rate_limit", "motor_saturation")
    assert not any(own[name].gradual for name in abrupt)


def test_effects_of_scatter_are_no_directions():
    assert {"timestamp_jitter", "dropped_samples"}.isdisjoint(found()[1])


def test_what_is_stated_with_an_sd_is_believed_and_nothing_else():
    assert found()[2] == ()
    own = {each.name: each for each in found(vehicle=TOLERANT)[2]}
    stated = {"m", "steering_lag", "accel_bias_x", "steering_delay"}
    assert stated <= set(own)
    assert {"steering_ratio", "yaw_rate_scale", "imu_lever_arm"} <= set(own)  # narrow zones about what is not stated
    assert (own["m"].mean, own["m"].sd) == (1457.2, 4.4)
    assert (own["accel_bias_x"].mean, own["accel_bias_x"].sd) == (0.02, 0.01)
    assert own["steering_lag"].mean == 0.0
    assert {name for name in stated if own[name].abrupt} == {"steering_lag", "steering_delay"}


@given(st.floats(1e-3, 1e6), st.floats(1e-3, 0.5), st.floats(-3.0, 3.0))
def test_a_tolerance_of_a_positive_number_is_a_share_of_it(mean, share, off):
    own = axis(0, null=mean, sd=share * mean, low=0.0, high=2e6).relatively()
    assert own.relative
    assert own.value(own.mean) == pytest.approx(mean)
    assert own.value(own.mean + off * own.sd) == pytest.approx(mean * exp(off * share))
    assert own.coordinate(own.value(off)) == pytest.approx(off, abs=1e-9)
    assert own.coordinate(0.0) < own.mean - 100 * own.sd  # nothing is zero by a tolerance
    assert own.low < own.mean < own.high


def test_what_may_be_zero_or_negative_is_tolerated_as_it_is_stated():
    for own in (axis(0, sd=0.1), axis(0, sd=0.1, low=0.0), axis(0, null=2.0, sd=0.1, inverse=True, low=0.0)):
        assert own.relatively() is own
