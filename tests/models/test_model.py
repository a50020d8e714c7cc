"""Models as records: parameters by name, sums with effects, what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
from toys import linear_toy, speed_toy, tiny

from greybox_id.base.errors import BadModel
from greybox_id.models.memory_model import SampledActuator, SampledSensor
from greybox_id.models.motion_model import MotionModel, State
from greybox_id.models.parameter import Parameter


def test_two_parameters_of_one_name_are_refused():
    twice = (Parameter("m", "kg", 1.0), Parameter("m", "kg", 2.0))
    with pytest.raises(BadModel, match="two parameters of the name m"):
        replace(linear_toy(), parameters=twice)


@pytest.mark.parametrize("dt", [0.0, -0.05, np.nan])
def test_a_sample_time_that_is_not_above_zero_is_refused(dt):
    with pytest.raises(BadModel, match="sample time above zero"):
        replace(linear_toy(), sample_time=dt)


def test_a_parameter_that_is_not_there_is_named_with_those_that_are():
    with pytest.raises(BadModel, match=r"no parameter 'm'; it has pole, gain"):
        speed_toy()["m"]


def test_values_are_the_parameters_in_order():
    model = speed_toy()
    assert model.values.tolist() == [0.6, 0.5]
    assert model.with_values(np.array([0.1, 0.2])).values.tolist() == [0.1, 0.2]
    assert model.values.tolist() == [0.6, 0.5]


def test_named_parameters_are_replaced_in_place_and_new_ones_appended():
    model = speed_toy().with_parameters(Parameter("extra", "1", 7.0), Parameter("pole", "1", 0.1))
    assert [p.name for p in model.parameters] == ["pole", "gain", "extra"]
    assert model.values.tolist() == [0.1, 0.5, 7.0]


def test_an_actuator_stands_before_an_input_and_a_sensor_behind_an_output():
    actuator = SampledActuator("steer", lambda state, command, p, dt: (state, command))
    with pytest.raises(BadModel, match="no input steer"):
        speed_toy().with_actuator(actuator)
    sensor = SampledSensor("yaw_rate", lambda p, dt: [1.0])
    with pytest.raises(BadModel, match="no output yaw_rate"):
        speed_toy().with_sensor(sensor)
    with pytest.raises(BadModel, match="already has a sensor"):
        linear_toy().with_sensor(sensor).with_sensor(sensor)


def test_parts_share_their_parameters_by_name_with_the_whole():
    model = tiny("msnn_full")
    assert [p.name for part in model.parts for p in part.parameters] == [p.name for p in model.parameters]


def test_units_are_stated_by_models_else_told_by_names():
    pendulum = MotionModel(
        name="pendulum",
        about="no vehicle",
        states=(State("angle", "rad"), State("rate", "rad/s")),
        inputs=("torque",),
        outputs=("angle", "yaw_rate"),
        parameters=(),
        units={"torque": "N m"},
        dynamics=lambda x, u, p, q: {"angle": x.rate, "rate": u.torque},
    )
    units = {"angle": "rad", "torque": "N m", "yaw_rate": "rad/s", "F_yf": "N", "unknown": "1"}
    assert {name: pendulum.unit(name) for name in units} == units
