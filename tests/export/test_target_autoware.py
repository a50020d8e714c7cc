"""Files for Autoware: typed as its documentation says, every effect they can hold read back exactly."""

import csv
import io

import numpy as np
import pytest
import yaml

from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.export.subject import Subject
from greybox_id.export.target_autoware import ACTUATORS, PEDALS, SPEEDS, cautions, files, origins
from greybox_id.fitting.fit import Fit
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

NUMBER, WORD, TRUTH, COUNT = float, str, bool, int
SCHEMA = {
    "simulator_model.param.yaml": {
        "simulated_frame_id": WORD, "origin_frame_id": WORD, "vehicle_model_type": WORD, "initialize_source": WORD,
        "timer_sampling_time_ms": COUNT, "add_measurement_noise": TRUTH, "vel_lim": NUMBER, "vel_rate_lim": NUMBER,
        "steer_lim": NUMBER, "steer_rate_lim": NUMBER, "acc_time_delay": NUMBER, "acc_time_constant": NUMBER,
        "steer_time_delay": NUMBER, "steer_time_constant": NUMBER, "steer_dead_band": NUMBER, "steer_bias": NUMBER,
        "debug_acc_scaling_factor": NUMBER, "debug_steer_scaling_factor": NUMBER, "x_stddev": NUMBER,
        "y_stddev": NUMBER,
    },
    "vehicle_info.param.yaml": dict.fromkeys(
        ("wheel_radius", "wheel_width", "wheel_base", "wheel_tread", "front_overhang", "rear_overhang", "left_overhang",
         "right_overhang", "vehicle_height", "max_steer_angle"), NUMBER),
    "mpc.param.yaml": {"vehicle_model_type": WORD} | dict.fromkeys(
        ("input_delay", "vehicle_model_steer_tau", "acceleration_limit", "velocity_time_constant", "cg_to_front_m",
         "cg_to_rear_m", "mass_kg", "mass_fl", "mass_fr", "mass_rl", "mass_rr", "cf", "cr"), NUMBER),
}  # fmt: skip
"""Keys and types as Autoware's documentation of the three nodes has them; ROS refuses parameters of another type."""
EFFECTS = {
    "steering_delay": 0.0371234567890123, "steering_lag": 0.05, "steering_rate_limit": 0.7, "steering_backlash": 0.003,
    "steering_offset": 0.0123, "steering_ratio": 1.07, "motor_lag": 0.12, "motor_gain": 0.93, "motor_saturation": 3.3,
}  # fmt: skip


def subject(effects, fit=None):
    car = vehicle("full_size_car")
    return Subject(build("single_track", {}, effects, car), "car", None, fit, source="a test", vehicle=car)


def tables(meant):
    return {
        name: yaml.safe_load(text)["/**"]["ros__parameters"]
        for name, text in files(meant).items()
        if name.endswith(".yaml")
    }


@pytest.mark.parametrize("effects", [{}, EFFECTS])
def test_keys_and_types_are_those_of_the_documentation(effects):
    found = tables(subject(effects))
    assert {name: {key: type(value) for key, value in table.items()} for name, table in found.items()} == SCHEMA


@pytest.mark.parametrize("key", ACTUATORS)
def test_every_effect_comes_back_exactly(key):
    effect = ACTUATORS[key]
    found = tables(subject({effect: EFFECTS[effect]}))
    sign = -1 if key == "steer_bias" else 1
    assert found["simulator_model.param.yaml"][key] == sign * EFFECTS[effect]
    if effect == "steering_delay":
        assert found["mpc.param.yaml"]["input_delay"] == EFFECTS[effect]
    if effect == "steering_lag":
        assert found["mpc.param.yaml"]["vehicle_model_steer_tau"] == EFFECTS[effect]


@pytest.mark.parametrize("order", [("steering_ratio", "steering_offset"), ("steering_offset", "steering_ratio")])
def test_wheels_stand_where_the_model_has_them_whichever_effect_came_first(order):
    meant = subject({name: {"steering_ratio": 1.1, "steering_offset": 0.02}[name] for name in order})
    found = tables(meant)["simulator_model.param.yaml"]
    trace = MotionTrace(meant.model)
    segment = np.zeros(trace.segment_size)
    segment[1] = 0.1
    ours = float(trace.named_values(["steer"])([10.0, 0.0, 0.0], segment, meant.model.values))
    assert found["debug_steer_scaling_factor"] * 0.1 - found["steer_bias"] == pytest.approx(ours, rel=1e-14)


def test_geometry_mass_and_tyres_are_the_models():
    found, own = tables(subject({"cog_shift": 0.1, "mass_change": 1.2})), vehicle("full_size_car").values
    info, mpc = found["vehicle_info.param.yaml"], found["mpc.param.yaml"]
    assert info["wheel_base"] == pytest.approx(own["l_f"].value + own["l_r"].value, rel=1e-15)
    assert (info["wheel_tread"], info["wheel_radius"], info["max_steer_angle"]) == (1.55, 0.32, 0.5)
    assert mpc["cg_to_front_m"] == pytest.approx(own["l_f"].value - 0.1)
    wheels = [mpc[f"mass_{place}"] for place in ("fl", "fr", "rl", "rr")]
    assert sum(wheels) == pytest.approx(1.2 * own["m"].value) == mpc["mass_kg"]


def test_every_key_says_what_is_behind_it_or_why_it_stands_at_its_default():
    found = {(origin.file, origin.key): origin for origin in origins(subject({"steering_lag": 0.05}))}
    assert {(file, key) for file, keys in SCHEMA.items() for key in keys} == set(found)
    assert found["simulator_model.param.yaml", "steer_time_constant"].behind == "steering_lag"
    assert found["simulator_model.param.yaml", "steer_time_delay"].why == "the model has no steering_delay"
    assert found["vehicle_info.param.yaml", "wheel_width"].why == "no parameter or effect gives this value"
    assert all(bool(own.behind) != bool(own.why) for own in found.values())


def test_an_infinite_limit_leaves_the_default():
    found = tables(subject({"steering_rate_limit": float("inf")}))
    assert found["simulator_model.param.yaml"]["steer_rate_lim"] == 5.0


def test_what_cannot_be_held_is_said():
    told = " ".join(cautions(subject({"steering_lag": 0.01, "tyre_relaxation": 0.3})))
    assert "have no entry for tyre_relaxation" in told
    assert "time constants below 0.03 s to that value: steering_lag" in told
    assert "the model's drive signal is not a throttle position" in told


def test_pedals_are_mapped_where_the_fit_has_seen_a_throttle():
    model = build("single_track", {"drive": "motor"}, {"motor_lag": 0.2}, vehicle("full_size_car"))
    how = {"inputs": {"drive": "throttle"}}
    fit = Fit(model=model, sd={}, stages=(), metrics={}, data=(), mode="given", seed=0, how=how)
    found = files(Subject(model, "car", None, fit, source="a test"))
    for name, sign in (("accel_map.csv", 1.0), ("brake_map.csv", -1.0)):
        rows = list(csv.reader(io.StringIO(found[name].decode())))
        assert rows[0] == ["default", *(f"{v:g}" for v in SPEEDS)]
        assert [float(row[0]) for row in rows[1:]] == list(PEDALS)
        table = np.array([row[1:] for row in rows[1:]], dtype=float)
        assert np.all(sign * np.diff(table, axis=0) >= 0)
    p = {parameter.name: float(parameter.array) for parameter in model.parameters}
    v = SPEEDS[5]
    force = (p["force_per_unit"] * 0.5) - p["motor_damping"] * v * 0.5
    assert p["dead_band"] == 0.0
    drag = p["c_0"] + p["c_1"] * v + p["c_2"] * v**2
    found_there = float(list(csv.reader(io.StringIO(found["accel_map.csv"].decode())))[-1][6])
    assert found_there == pytest.approx((force - drag) / p["m"], rel=1e-5)


@pytest.mark.parametrize("source", ["a\nb: 3", "x # y\u2028z: 1", "\x85key: 1"])
def test_foreign_texts_stay_in_their_comment(source):
    meant = Subject(build("single_track"), "car", None, source=source)
    for name, text in files(meant).items():
        assert set(yaml.safe_load(text)["/**"]["ros__parameters"]) == set(SCHEMA[name])
