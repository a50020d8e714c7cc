"""`greybox models` and `greybox effects` say what there is."""

import pytest
from calling import greybox, refused

from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import MODELS
from greybox_id.models.vehicle import vehicle


def test_models_lists_every_model():
    listed = greybox("models").out
    assert all(name in listed for name in MODELS)
    assert set(greybox("models", "--json").told["models"]) == set(MODELS)


def test_a_model_says_what_it_is_made_of():
    words = " ".join(greybox("models", "single_track").out.split())
    assert "drive: drive_force [N] or ax_cmd [m/s²] or motor_current [A]" in words
    assert "outputs v_x [m/s], v_y [m/s], yaw_rate [rad/s]" in words
    assert "I_z 2270 kg m² [0.001, 500000] free yaw inertia" in words
    assert "steering_delay" in words


def test_a_model_shows_a_vehicles_numbers_on_the_tyre_that_is_asked_for():
    asked = ["models", "lateral", "--vehicle", "full_size_car", "--set", "tyre=brush", "--json"]
    told = greybox(*asked).told
    assert told["settings"] == {"tyre": "brush"}
    assert told["parameters"]["m"]["value"] == 1457.2
    assert told["parameters"]["m"]["prior_sd"] == 4.4
    assert not told["parameters"]["h_cg"]["free"]
    assert "C_alpha_f" in told["parameters"]
    assert told["states"] == [{"name": "v_y", "unit": "m/s"}, {"name": "yaw_rate", "unit": "rad/s"}]
    assert "motor_lag" not in told["effects"]


def test_a_model_with_memory_shows_the_shapes_of_its_weights():
    assert " × " in greybox("models", "msnn_lat").out
    assert greybox("models", "msnn_lat", "--json").told["parameters"]["F"]["unit"] == "1"


def test_effects_lists_every_effect():
    listed = greybox("effects").out
    assert all(name in listed for name in EFFECTS)
    told = greybox("effects", "--json").told["effects"]
    assert set(told) == set(EFFECTS)
    assert told["steering_rate_limit"]["null"] == "inf"
    assert told["motor_lag"]["models"] == ["single_track", "longitudinal"]


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_says_what_it_is(name):
    words = " ".join(greybox("effects", name).out.split())
    assert words.startswith(f"{name} magnitude {EFFECTS[name].parameter.about} unit")
    assert "models " in words


def test_names_that_are_none_are_sentences():
    assert "Did you mean steering_lag?" in refused("effects", "stering_lag")
    assert "Did you mean single_track?" in refused("models", "singletrack")


def test_a_vehicle_file_to_be_edited_holds_the_models_numbers(tmp_path):
    file = tmp_path / "car.toml"
    greybox("models", "single_track", "--vehicle", "roboracer", "--set", "drive=motor", "--out", file)
    text = file.read_text(encoding="utf-8")
    assert "m = { value = 3.6, sd = 0.3 }  # kg: vehicle mass" in text
    again = greybox("models", "single_track", "--set", "drive=motor", "--vehicle", file, "--json").told["parameters"]
    like = greybox("models", "single_track", "--set", "drive=motor", "--vehicle", "roboracer", "--json").told
    assert again == like["parameters"]
    assert vehicle(file).model.name == "single_track"
    assert vehicle(file).noise == vehicle("roboracer").noise
    assert "which model" in refused("models", "--out", file)
    assert ".toml" in refused("models", "lateral", "--out", tmp_path / "car.json")
