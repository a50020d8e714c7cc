"""Effects as transforms from model to model, on a model and an effect made for the purpose."""

import numpy as np
import pytest
from toys import drive, linear_toy, speed_toy

from greybox_id.effect import Effect
from greybox_id.errors import BadInput, BadModel
from greybox_id.metrics import predictions
from greybox_id.memory_model import SampledActuator
from greybox_id.parameter import Parameter


def offset(name="steer_offset"):
    """A command that is off by a constant."""
    return Effect(
        name, Parameter(name, "rad", 0.0, (-1.0, 1.0)), ("steer",),
        lambda m: m.with_actuator(SampledActuator("steer", lambda s, command, p, dt: (s, command + getattr(p, name)))),
    )  # fmt: skip


def test_an_effect_appends_its_parameter_and_its_name():
    model = linear_toy() + offset()
    assert [p.name for p in model.parameters] == ["F", "steer_offset"]
    assert model.effects == ("steer_offset",)
    assert not model["steer_offset"].fixed


def test_the_model_without_it_is_left_alone():
    bare = linear_toy()
    _ = bare + offset()
    assert bare.effects == ()
    assert bare.actuators == ()


def test_effects_add_up():
    recording = drive(30)
    model = linear_toy(1).with_values(np.ones(1)) + offset("one").at(0.2) + offset("two").at(0.3)
    np.testing.assert_allclose(predictions(model, recording).predicted[:, 0], recording["steer"][:-1] + 0.5)


def test_an_effect_at_a_magnitude_is_held_there_and_leaves_the_effect_alone():
    effect = offset()
    held = (linear_toy() + effect.at(0.1))["steer_offset"]
    assert held.fixed
    assert held.array == 0.1
    assert effect.parameter.array == 0.0


def test_a_magnitude_out_of_bounds_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match="steer_offset"):
        offset().at(2.0)


def test_twice_is_refused_and_so_is_a_model_it_does_not_concern():
    with pytest.raises(BadModel, match="already has the effect steer_offset"):
        _ = linear_toy() + offset() + offset()
    with pytest.raises(BadModel, match="acts on steer, but model loop has inputs motor_current"):
        _ = speed_toy() + offset()
