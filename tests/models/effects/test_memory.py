"""Effects that are known for maps with memory, on every such model of the registry."""

import numpy as np
import pytest
from toys import TINY, drive, linear_toy, scattered, tiny

from greybox_id.base.errors import BadModel
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.effects import EFFECTS, sensor_latency_imu, steering_rate_limit
from greybox_id.models.memory_model import MemoryModel
from greybox_id.models.registry import MODELS, build
from greybox_id.models.single_track import single_track

IN_MEMORY = [name for name, effect in EFFECTS.items() if effect.apply_to_memory]
PAIRS = [
    (name, effect)
    for name in TINY
    for effect in IN_MEMORY
    if effect not in tiny(name).effects and EFFECTS[effect].concerns(tiny(name))
]
AWAY = {"steering_rate_limit": 0.5, "sensor_latency_imu": 0.06, "steering_offset": 0.05, "steering_ratio": 1.2,
        "motor_gain": 0.7}  # fmt: skip


def test_every_map_with_memory_is_examined():
    assert set(TINY) == {name for name in MODELS if name in TINY or isinstance(build(name), MemoryModel)}
    assert set(IN_MEMORY) == set(AWAY)


@pytest.mark.parametrize(("name", "effect"), PAIRS)
def test_null_effect_leaves_every_model_unchanged(name, effect):
    model = scattered(tiny(name))
    recording = drive(80)
    more = model + EFFECTS[effect]
    assert more.effects[-1] == effect
    for protocol in ("honest", "published") + (("closed_loop",) if model.feedback else ()):
        bare, with_effect = (predictions(m, recording, protocol).predicted for m in (model, more))
        np.testing.assert_allclose(with_effect, bare, atol=1e-12)


@pytest.mark.parametrize(("name", "effect"), PAIRS)
def test_an_effect_away_from_its_null_does_change_the_predictions(name, effect):
    model = scattered(tiny(name))
    more = model + EFFECTS[effect].at(AWAY[effect])
    assert np.max(np.abs(predictions(more, drive()).predicted - predictions(model, drive()).predicted)) > 1e-6


@pytest.mark.parametrize("name", ["msnn_lat", "msnn_full"])
def test_effects_compose_in_either_order(name):
    a, b = steering_rate_limit.at(1.0), sensor_latency_imu.at(0.04)
    one, other = tiny(name) + a + b, tiny(name) + b + a
    assert one.effects == ("steering_rate_limit", "sensor_latency_imu")
    assert one.effects == other.effects[::-1]
    np.testing.assert_allclose(predictions(one, drive()).predicted, predictions(other, drive()).predicted, atol=1e-12)


def test_an_effect_reaches_the_parts_it_concerns():
    model = tiny("msnn_full") + steering_rate_limit.at(1.0)
    assert all("steering_rate_limit" in part.effects for part in model.parts)
    assert all(part["steering_rate_limit"].array == 1.0 for part in model.parts)


def test_a_latency_belongs_to_the_run_in_maps_with_memory_and_to_the_model_in_equations_of_motion():
    models = linear_toy(), single_track()
    in_memory, in_motion = ((model + sensor_latency_imu)["sensor_latency_imu"] for model in models)
    assert in_memory.scope == "run"
    assert in_memory.prior is not None
    assert in_motion.scope == "model"
    assert in_motion.prior is None
    held = sensor_latency_imu.at(0.05)
    assert all((model + held)["sensor_latency_imu"].array == 0.05 for model in models)


@pytest.mark.parametrize("effect", IN_MEMORY)
def test_an_effect_twice_is_refused_in_a_sentence(effect):
    with pytest.raises(BadModel, match="already has"):
        _ = tiny("msnn_full") + EFFECTS[effect] + EFFECTS[effect]


def test_an_effect_on_a_model_it_does_not_concern_is_refused_in_a_sentence():
    with pytest.raises(BadModel, match="acts on yaw_rate"):
        _ = _current_to_speed() + sensor_latency_imu
    with pytest.raises(BadModel, match="acts on steer"):
        _ = _current_to_speed() + steering_rate_limit
    with pytest.raises(BadModel, match="grip_scale acts on grip_f and grip_r"):
        _ = linear_toy() + EFFECTS["grip_scale"]


def _current_to_speed():
    toy = linear_toy()
    return type(toy)(
        name="motor", about="", inputs=("motor_current",), outputs=("v_x",), parameters=toy.parameters,
        equations=lambda u, p, past: {"v_x": past(u.motor_current, p.F)}, sample_time=0.05,
    )  # fmt: skip


def test_a_ratio_and_an_offset_of_the_steering_and_a_gain_of_the_motor_are_what_their_commands_say():
    recording = drive(80)
    model = scattered(tiny("msnn_full"))
    moved = model + EFFECTS["steering_ratio"].at(1.2) + EFFECTS["steering_offset"].at(0.03)
    moved = moved + EFFECTS["motor_gain"].at(0.7)
    commands = {"steer": 1.2 * recording["steer"] + 0.03, "motor_current": 0.7 * recording["motor_current"]}
    np.testing.assert_allclose(
        predictions(moved, recording).predicted, predictions(model, recording.with_signals(**commands)).predicted,
        atol=1e-12,
    )  # fmt: skip
