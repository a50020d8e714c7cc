"""Vehicle files: what they say, and what is said of those that cannot be used."""

import json
import tomllib
from pathlib import Path

import pytest

from greybox_id.base.errors import BadInput
from greybox_id.base.signals import SIGNALS
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import vehicle_parameters
from greybox_id.models.vehicle import (
    ChosenModel,
    Stated,
    StatedModelError,
    Vehicle,
    parse_vehicle,
    shipped_vehicles,
    vehicle,
)

EXAMPLE = """
name = "full-size car"
steer_max = 0.5                                   # rad
[parameters]                                      # SI
m = { value = 1457.2, sd = 4.4, source = "scale" }
I_z = 2274.0
l_f = 1.296
l_r = 1.465
h_cg = 0.55
track_f = 1.55
track_r = 1.55
wheel_radius = 0.32
B_f = 9.3                                         # C_f D_f E_f, B_r C_r D_r E_r alike
C_f = 1.4
D_f = 1.0
E_f = 0.2
B_r = 10.5
C_r = 1.4
D_r = 1.02
E_r = 0.2
c_0 = 208.0
c_1 = 0.0
c_2 = 0.45
drive_split_front = 0.0
brake_split_front = 0.62
force_per_unit = 1457.2                           # N per unit of the drive channel
[effects]                                         # small ones known to be there at this size: tolerances, not gaps
steering_lag = { sd = 0.003 }
accel_bias_x = { sd = 0.01 }
[noise]                                           # sensor standard deviations
v_x = 0.02
yaw_rate = 0.01
a_x = 0.15
a_y = 0.15
"""
MODEL = """
[model]
name = "single_track"
tyre = "pacejka"
effects = { steering_delay = { value = 0.03, sd = 0.002, source = "greybox gap" }, mass_change = 1.1 }
"""
PARAMETERS = vehicle_parameters()


def written(folder, text, name="car.toml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_the_example_of_the_specification_is_read(tmp_path):
    path = written(tmp_path, EXAMPLE)
    car = vehicle(path, PARAMETERS, tuple(EFFECTS))
    assert (car.name, car.steer_max, car.path, car.model) == ("full-size car", 0.5, path, None)
    assert car.values["m"] == Stated(1457.2, 4.4, source="scale")
    assert car.values["D_r"] == Stated(1.02)
    assert len(car.values) == 22
    assert car.effects == {"steering_lag": Stated(sd=0.003), "accel_bias_x": Stated(sd=0.01)}
    assert car.noise == {"v_x": 0.02, "yaw_rate": 0.01, "a_x": 0.15, "a_y": 0.15}


def test_json_with_the_same_keys_says_the_same(tmp_path):
    both = EXAMPLE + MODEL
    as_json = written(tmp_path, json.dumps(tomllib.loads(both)), "car.json")
    assert vehicle(as_json, PARAMETERS, tuple(EFFECTS)) == vehicle(written(tmp_path, both), PARAMETERS, tuple(EFFECTS))


def test_the_model_that_describes_it_best_may_be_named(tmp_path):
    assert vehicle(written(tmp_path, MODEL)).model == ChosenModel(
        "single_track",
        {"tyre": "pacejka"},
        {"steering_delay": Stated(0.03, 0.002, source="greybox gap"), "mass_change": Stated(1.1)},
    )


def test_a_file_needs_nothing_but_what_it_states(tmp_path):
    assert vehicle(written(tmp_path, "", "racer.toml")) == Vehicle("racer")


def test_a_vehicle_is_taken_as_it_is():
    car = Vehicle("car")
    assert vehicle(car) is car


@pytest.mark.parametrize("name", shipped_vehicles())
def test_shipped_vehicles_say_where_every_number_comes_from(name):
    car = vehicle(name, PARAMETERS, tuple(EFFECTS))
    assert car.about
    assert car.steer_max
    stated = [*car.values.values(), *car.effects.values()]
    assert all(own.source for own in stated)
    assert {"m", "I_z", "l_f", "l_r", "h_cg", "B_f", "C_f", "D_f", "c_0", "force_per_unit"} <= set(car.values)


def test_the_six_vehicles_are_there():
    assert set(shipped_vehicles()) == {"roboracer", "simrod", "ferrari_250lm", "truck", "full_size_car", "dart"}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("m = 1457.2", r"car.toml: m is a parameter and belongs under \[parameters\]"),
        ("nmae = 'x'", r'car.toml: there is no key "nmae". Did you mean name\?'),
        ("name = 3", "name must be text in quotes, not 3"),
        ("name = ' '", "name must be text in quotes"),
        ("parameters = 3", '"parameters" must be a table, not 3'),
        ("[parameters]\nlf = 1.3", r'car.toml: \[parameters\] lf: there is no parameter "lf". Did you mean l_f\?'),
        ("[parameters]\nm = '1457 kg'", r"\[parameters\] m must be a number in the SI unit, not '1457 kg'"),
        ("[parameters]\nm = true", r"\[parameters\] m must be a number in the SI unit, not True"),
        ("[parameters]\nm = nan", r"\[parameters\] m must be a finite number, not nan"),
        ("[parameters]\nm = inf", r"\[parameters\] m must be a finite number, not inf"),
        ("[parameters]\nm = { sd = 4.4 }", r"\[parameters\] m has no value; add one"),
        ("[parameters]\nm = { value = 1.0, sd = '5 %' }", r"\[parameters\] m: sd must be a number in the SI unit"),
        ("[parameters]\nm = { value = 1.0, sd = 0 }", r"\[parameters\] m: sd = 0 must be above zero"),
        ("[parameters]\nm = { value = 1.0, sd = -1 }", r"\[parameters\] m: sd = -1 must be above zero"),
        ("[parameters]\nm = { value = 1.0, mim = 0 }", r'\[parameters\] m: there is no key "mim". Did you mean min'),
        ("[parameters]\nm = { value = 1.0, min = 3, max = 2 }", "m: min = 3 is above max = 2; mend one of them"),
        ("[parameters]\nm = { value = 1.0, min = 2 }", "m: value = 1 is below min = 2; mend one of them"),
        ("[parameters]\nm = { value = 3.0, max = 2 }", "m: value = 3 is above max = 2; mend one of them"),
        ("[parameters]\nm = { value = 3.0, source = 2 }", "m: source must be text in quotes, not 2"),
        ("[parameters]\nm = 1\nm = 2", "car.toml: not valid TOML"),
        ("[effects]\nsteering_lg = { sd = 1.0 }", 'there is no effect "steering_lg". Did you mean steering_lag'),
        (
            "[effects]\nm = 1457.2",
            r"car.toml: \[effects\] m: that is no effect and belongs under \[parameters\]",
        ),
        (
            "[parameters]\nsteering_lag = 0.003",
            r"car.toml: \[parameters\] steering_lag: that is no parameter and belongs under \[effects\]",
        ),
        (
            "[effects]\nsteering_lag = 0.003",
            r"\[effects\] steering_lag is a tolerance and needs its standard deviation",
        ),
        ("[effects]\nsteering_lag = { value = 0.003 }", "needs its standard deviation"),
        ("[noise]\nyawrate = 0.01", r'\[noise\] yawrate: there is no signal "yawrate". Did you mean yaw_rate'),
        ("[noise]\nyaw_rate = 0", r"\[noise\] yaw_rate = 0 must be above zero"),
        ("steer_max = -0.5", "steer_max = -0.5 must be above zero"),
        ("[model]\ntyre = 'brush'", r"\[model\] has no name; say which model it is"),
        ("[model]\nname = 'lateral'\neffects = { steer = 1 }", r'\[model\] effects steer: there is no effect "steer"'),
        ("[model]\nname = 'lateral'\neffects = { steering_lag = { sd = 1 } }", "effects steering_lag has no value"),
        ("[model]\nname = 'lateral'\neffects = 3", '"effects" must be a table'),
        ("name = 'a", "car.toml: not valid TOML"),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_sentence(tmp_path, text, says):
    with pytest.raises(BadInput, match=says):
        vehicle(written(tmp_path, text), PARAMETERS, tuple(EFFECTS))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "car.json: not valid JSON"),
        ("[1, 2]", "car.json: a vehicle file is a table of keys"),
        ('{"parameters": {"m": 1, "m": 2}}', 'the key "m" is there twice'),
        ('{"parameters": {"m": NaN}}', "must be a finite number"),
        ('{"parameters": {"m": null}}', "must be a number in the SI unit, not None"),
    ],
)
def test_json_that_cannot_be_used_is_refused_in_a_sentence(tmp_path, text, says):
    with pytest.raises(BadInput, match=says):
        vehicle(written(tmp_path, text, "car.json"), PARAMETERS)


def test_names_are_left_to_the_caller_where_none_are_given(tmp_path):
    car = vehicle(written(tmp_path, "[parameters]\nwheelbase = 2.7\n[effects]\nrust = { sd = 1.0 }"))
    assert set(car.values) == {"wheelbase"}


def test_limits_may_be_open(tmp_path):
    car = vehicle(written(tmp_path, "[parameters]\nm = { value = 1.0, max = inf }"))
    assert car.values["m"].max == float("inf")


@pytest.mark.parametrize(
    ("wanted", "says"),
    [
        ("trucks", r'There is no vehicle "trucks". Did you mean truck\? Shipped vehicles: '),
        ("nowhere.toml", "nowhere.toml: the vehicle file cannot be read"),
        ("null\0byte.toml", "no valid path"),
    ],
)
def test_a_vehicle_that_is_not_there_is_identifiable_in_a_sentence(wanted, says):
    with pytest.raises(BadInput, match=says):
        vehicle(wanted)


def test_a_file_that_is_no_text_is_refused_in_a_sentence(tmp_path):
    path = tmp_path / "car.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match="is not UTF-8 text"):
        vehicle(path)


def test_known_signals_are_those_of_the_project():
    noise = "\n".join(f"{name} = 0.1" for name in SIGNALS)
    assert set(parse_vehicle(f"[noise]\n{noise}", Path("car.toml")).noise) == set(SIGNALS)


def test_what_is_tracked_may_be_stated(tmp_path):
    file = tmp_path / "car.toml"
    file.write_text(
        'name = "car"\n[tracking]\nparameters = ["C_alpha_f"]\n'
        'disturbances = ["road_bank"]\nnoise = { walk_v_y = 0.05 }\n'
    )
    plan = vehicle(file).tracking
    assert plan.parameters == ("C_alpha_f",)
    assert plan.disturbances == ("road_bank",)
    assert plan.noise == {"walk_v_y": 0.05}


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('parameter = ["C_alpha_f"]', 'no key "parameter". Did you mean parameters'),
        ('parameters = "C_alpha_f"', "parameters must be a list of names"),
        ("parameters = [1]", "parameters must be a list of names"),
        ("noise = { walk_v_y = 0.0 }", "noise walk_v_y = 0 must be above zero"),
        ("noise = 3", '"noise" must be a table'),
    ],
)
def test_a_plan_of_tracking_that_cannot_be_used_is_a_sentence(tmp_path, line, said):
    file = tmp_path / "car.toml"
    file.write_text(f'name = "car"\n[tracking]\n{line}\n')
    with pytest.raises(BadInput) as caught:
        vehicle(file)
    assert said in str(caught.value)


def test_model_error_may_be_stated():
    text = "[model_error]\nF_y = { share = 0.02, amplitude = 0.05, correlation_time = 0.4 }\nF_x = { share = 0.1 }\n"
    found = parse_vehicle(text, Path("car.toml")).model_error
    assert found == {"F_y": StatedModelError(0.02, 0.05, 0.4), "F_x": StatedModelError(share=0.1)}


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("F_z = { share = 0.1 }", 'no force "F_z"'),
        ("F_y = { shares = 0.1 }", 'F_y: there is no key "shares". Did you mean share'),
        ("F_y = { share = 0 }", "F_y share = 0 must be above zero"),
        ("F_y = 0.1", '"F_y" must be a table'),
    ],
)
def test_model_error_that_cannot_be_used_is_a_sentence(line, said):
    with pytest.raises(BadInput) as caught:
        parse_vehicle(f"[model_error]\n{line}\n", Path("car.toml"))
    assert said in str(caught.value)
