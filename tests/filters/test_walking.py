"""From names to what walks."""

from dataclasses import replace

import numpy as np
import pytest
from filter_cases import car

from greybox_id.base.errors import BadInput
from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.filters.state_space import trackable, walking
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Parameter, Prior
from greybox_id.models.registry import build


def walks(*names, disturbances=(), model=None):
    return walking(model or car(), names, disturbances, EFFECTS)


def rates(model, inputs=(0.05, 1.0), z=(20.0, 0.3, 0.2)):
    trace = MotionTrace(model)
    s = np.zeros(trace.segment_size)
    s[1 : 1 + len(inputs)] = inputs
    return np.asarray(trace.rates(z, s, model.values)).ravel()


def test_a_parameter_walks_as_itself():
    model, (own,) = walks("I_z")
    assert (own.name, own.unit, own.value, own.logarithmic, own.returns) == ("I_z", "kg m^2", 2274.0, True, False)
    assert own.sd == pytest.approx(0.2 * 2274.0)
    np.testing.assert_array_equal(model.values, car().values)
    assert model.alterations == ()


def test_a_stated_belief_is_how_well_it_is_known():
    model = car()
    model = model.with_parameters(replace(model["I_z"], prior=Prior(100.0), fixed=False))
    assert walks("I_z", model=model)[1][0].sd == 100.0


def test_cornering_stiffness_walks_as_the_factor_that_scales_it():
    model, tracked = walks("C_alpha_f", "C_alpha_r")
    assert [own.name for own in tracked] == ["stiffness_f", "stiffness_r"]
    assert all(own.value == 1.0 and own.logarithmic and own.unit == "1" for own in tracked)
    np.testing.assert_allclose(rates(model), rates(car()), rtol=1e-14)
    stiffer = model.with_parameters(model["stiffness_f"].with_value(1.2), model["stiffness_r"].with_value(0.9))
    same = car(B_f=9.3 * 1.2, B_r=10.5 * 0.9)
    np.testing.assert_allclose(rates(stiffer), rates(same), rtol=1e-12)
    told, s = MotionTrace(stiffer).named_values(("C_alpha_f", "C_alpha_r")), [0.0, 0.05, 1.0, 0.0, 0.0]
    static = 1457.2 * 9.81 / (1.296 + 1.465)
    expected = [1.2 * 9.3 * 1.4 * 1.0 * 1.465 * static, 0.9 * 10.5 * 1.4 * 1.02 * 1.296 * static]
    np.testing.assert_allclose(np.asarray(told([20.0, 0.3, 0.2], s, stiffer.values)).ravel(), expected, rtol=1e-12)


def test_a_stiffness_that_an_effect_scales_already_is_scaled_further():
    model = car("single_track", {"front_stiffness": 0.8})
    model, _ = walks("C_alpha_f", model=model)
    model = model.with_parameters(model["stiffness_f"].with_value(1.2))
    np.testing.assert_allclose(rates(model), rates(car(B_f=9.3 * 0.96)), rtol=1e-12)


def test_the_stiffness_of_a_linear_tyre_is_a_parameter():
    model, (own,) = walks("C_alpha_f", model=build("lateral", {"tyre": "linear"}))
    assert (own.name, own.unit, own.value) == ("C_alpha_f", "N/rad", 90e3)
    assert model.size == build("lateral", {"tyre": "linear"}).size


def test_an_axle_force_takes_the_place_of_the_tyre():
    model, tracked = walks("F_yf", "F_yr")
    assert [(own.name, own.unit, own.value, own.logarithmic) for own in tracked] == [
        ("F_yf", "N", 0.0, False), ("F_yr", "N", 0.0, False),
    ]  # fmt: skip
    assert tracked[0].sd == pytest.approx(0.3 * 1457.2 * 9.81)
    pushed = model.with_parameters(model["F_yf"].with_value(2000.0), model["F_yr"].with_value(1000.0))
    _, v_dot, r_dot = rates(pushed, inputs=(0.0, 0.0))
    assert v_dot == pytest.approx(3000.0 / 1457.2 - 0.2 * 20.0, rel=1e-9)
    assert r_dot == pytest.approx((1.296 * 2000.0 - 1.465 * 1000.0) / 2274.0, rel=1e-9)


def test_an_input_that_is_not_recorded_walks_as_what_it_leads_to():
    model, (own,) = walks("drive")
    assert (own.name, own.unit) == ("drive_force", "N")
    assert "drive" in model.defaults
    pushed = model.with_parameters(model["drive_force"].with_value(1457.2 * 2))
    np.testing.assert_allclose(rates(pushed, inputs=(0.0, 0.0)), rates(car(), inputs=(0.0, 2.0)), rtol=1e-12)


def test_another_input_walks_as_itself():
    model, (own,) = walks("steer")
    assert (own.name, own.unit, own.sd, own.logarithmic) == ("steer", "rad", 0.01, False)
    turned = model.with_parameters(model["steer"].with_value(0.05))
    np.testing.assert_allclose(rates(turned, inputs=(0.0, 1.0)), rates(car(), inputs=(0.05, 1.0)), rtol=1e-12)


def test_an_effect_walks_without_being_in_the_model():
    model, (own,) = walks(disturbances=("road_bank",))
    assert "road_bank" in model.effects
    assert (own.name, own.value, own.returns, own.logarithmic) == ("road_bank", 0.0, True, False)
    np.testing.assert_allclose(rates(model), rates(car()), rtol=1e-13, atol=1e-13)


def test_what_is_positive_walks_in_shares_of_itself():
    """A parameter that may be negative, or is zero, does not."""
    model = car().with_parameters(Parameter("one", "1", 2.0, (-5.0, 5.0)), Parameter("none", "1", 0.0, (0.0, 5.0)))
    assert [walk.logarithmic for walk in walks("m", "one", "none", model=model)[1]] == [True, False, False]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("C_alpha_g",), "single_track has no C_alpha_g that could be tracked. Did you mean C_alpha_"),
        (("rode_bank",), "Did you mean road_bank"),
        (("F_yff",), "Did you mean F_yf"),
        (("I_z", "m", "I_z"), "I_z is named twice; name it once"),
    ],
)
def test_what_cannot_be_tracked_is_a_sentence_with_what_was_meant(names, said):
    with pytest.raises(BadInput, match=said.replace(".", r"\.")):
        walks(*names)


def test_the_same_by_two_names_is_tracked_once():
    """A driving force that was not recorded is asked for by either of its names."""
    for names in (("drive_force", "drive"), ("C_alpha_f", "stiffness_f")):
        with pytest.raises(BadInput, match="twice"):
            walks(*names)


def test_a_name_among_both_parameters_and_disturbances_is_refused():
    with pytest.raises(BadInput, match="road_bank is named twice"):
        walks("road_bank", disturbances=("road_bank",))


def test_all_that_is_said_to_be_trackable_is():
    names = trackable(car())
    assert names[:2] == ("C_alpha_f", "C_alpha_r")
    assert {"I_z", "drive", "F_yf"} < set(names)
    for name in names:
        model, (own,) = walks(name)
        assert own.name in model
