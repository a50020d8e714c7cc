"""Effects as transforms from model to model, on a model and an effect made for the purpose."""

from dataclasses import replace

import numpy as np
import pytest
from toys import drive, linear_toy, speed_toy

from greybox_id.base.errors import BadInput, BadModel
from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.effect import Effect
from greybox_id.models.memory_model import SampledActuator
from greybox_id.models.motion_model import MotionModel, State
from greybox_id.models.parameter import Parameter


def offset(name="steer_offset"):
    """A command that is off by a constant."""
    return Effect(
        name, Parameter(name, "rad", 0.0, (-1.0, 1.0)), ("steer",),
        apply=lambda m: m.altered(steer=lambda steer, q: steer + getattr(q.p, name)),
        apply_to_memory=lambda m: m.with_actuator(
            SampledActuator("steer", lambda s, command, p, dt: (s, command + getattr(p, name)))
        ),
    )  # fmt: skip


def turning(**entries):
    """Equations of motion of something that turns as it is steered."""
    return MotionModel(
        name="turning", about="one state", states=(State("yaw_rate", "rad/s"),), inputs=("steer",),
        outputs=("yaw_rate",), parameters=(Parameter("gain", "1/s", 2.0),), quantities=("turn",), dynamics=_turn,
        **entries,
    )  # fmt: skip


def _turn(x, u, p, q):
    q.turn = p.gain * u.steer
    return {"yaw_rate": q.turn - x.yaw_rate}


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


def test_one_effect_serves_both_kinds_of_model_each_with_its_own_parameter():
    effect = replace(offset(), memory_parameter=Parameter("steer_offset", "rad", 0.0, (-0.5, 0.5), scope="run"))
    in_memory, in_motion = linear_toy() + effect, turning() + effect
    assert in_memory["steer_offset"].scope == "run"
    assert in_motion["steer_offset"].scope == "model"
    assert (linear_toy() + effect.at(0.2))["steer_offset"].array == 0.2
    assert (turning() + effect.starting_at(0.2))["steer_offset"].array == 0.2
    rate = MotionTrace(in_motion).rates([0.0], [0.01, 0.3, 0.0], [2.0, 0.1])
    assert float(rate) == pytest.approx(0.8)


def test_an_effect_for_one_kind_does_not_concern_the_other():
    assert not replace(offset(), apply=None).concerns(turning())
    assert not replace(offset(), apply_to_memory=None).concerns(linear_toy())


def test_an_effect_that_needs_more_than_a_model_has_is_refused_in_a_sentence():
    slipping = replace(offset(), needs=("turn", "v_x"))
    assert not slipping.concerns(turning())
    assert replace(slipping, needs=("turn",)).concerns(turning())
    with pytest.raises(BadModel, match="acts on steer and needs turn and v_x, but model turning has inputs steer"):
        _ = turning() + slipping


def test_further_parameters_come_with_an_effect_once():
    second = Parameter("direction", "rad", 0.0, fixed=True)
    one, other = replace(offset("one"), others=(second,)), replace(offset("two"), others=(second,))
    model = turning() + one + other
    assert [p.name for p in model.parameters] == ["gain", "one", "direction", "two"]
