"""Models by name, from plain data."""

import json

import numpy as np
import pytest
from toys import TINY, drive, tiny

from greybox_id.base.errors import BadInput, GreyboxError
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.parameter import Prior, Stated
from greybox_id.models.registry import MODELS, build, candidates, prepared, vehicle_parameters
from greybox_id.models.tyres import TYRES

MOTION = ["single_track", "lateral", "longitudinal", "kinematic", "steering"]
NETWORKS = ["mlp_lateral", "bicycle_mlp"]
MEMORY = [name for name in MODELS if name not in (*MOTION, *NETWORKS) and not name.startswith("hybrid_")]


@pytest.mark.parametrize("tyre", TYRES)
@pytest.mark.parametrize("name", MOTION)
def test_equations_of_motion_are_rebuilt_from_their_settings_as_json(name, tyre):
    model = build(name, {"tyre": tyre} if name in ("single_track", "lateral") else {})
    again = build(name, json.loads(json.dumps(dict(model.settings))))
    assert again.settings == model.settings
    assert [parameter.name for parameter in again.parameters] == [parameter.name for parameter in model.parameters]


@pytest.mark.parametrize("name", MEMORY)
def test_a_model_is_rebuilt_from_its_settings_as_json(name):
    model = prepared(name, drive(300), TINY[name])
    again = build(name, json.loads(json.dumps(dict(model.settings))))
    assert again.settings == model.settings
    assert np.array_equal(predictions(again, drive()).predicted, predictions(model, drive()).predicted)


@pytest.mark.parametrize("name", MODELS)
def test_a_model_stands_without_settings(name):
    assert build(name).name == name


@pytest.mark.parametrize(
    ("name", "settings", "effects", "says"),
    [
        ("msnn_lap", {}, {}, "Did you mean msnn_lat"),
        ("msnn_lat", {"n_dleta": 3}, {}, "Did you mean n_delta"),
        ("msnn_lat", {"n_delta": 3.5}, {}, "n_delta is a int"),
        ("msnn_lat", {"n_delta": True}, {}, "n_delta is a int"),
        ("msnn_lat", {"v_x": "0, 1"}, {}, "list of numbers"),
        ("msnn_lat", {"v_x": []}, {}, "list of numbers"),
        ("msnn_lat", {"v_x": [0, "1"]}, {}, "v_x"),
        ("msnn_full", {"lat": 3}, {}, "group of settings"),
        ("msnn_full", {"lat": {"n_q": 3}}, {}, "lat.n_q"),
        ("msnn_full_plus", {"symmetric": 1}, {}, "symmetric is a bool"),
        ("single_track", {"tyre": "brsh"}, {}, "Did you mean brush"),
        ("single_track", {"tyre": 3}, {}, "tyre is a str"),
        ("longitudinal", {"tyre": "brush"}, {}, "no setting tyre; there are drive, brake"),
        ("single_track", {}, {"steering_lag": "30 ms"}, "needs a number, in s; '30 ms' was given"),
        ("single_track", {}, {"steering_lag": True}, "needs a number"),
        ("msnn_lat", {}, {"steering_rate_limt": 2.0}, "Did you mean steering_rate_limit"),
        ("msnn_lat", {}, {"steering_rate_limit": -1.0}, "outside its bounds"),
    ],
)
def test_what_cannot_be_built_is_refused_in_a_sentence(name, settings, effects, says):
    with pytest.raises(BadInput, match=says):
        build(name, settings, effects)


@pytest.mark.parametrize("wrong", [{"sample_time": 0.0}, {"sample_time": -0.05}, {"q": -1}, {"q": -5}])
def test_hyperparameters_that_make_no_sense_are_refused_in_a_sentence(wrong):
    with pytest.raises(GreyboxError):
        build("msnn_lat", wrong)


def test_effects_are_held_at_their_magnitudes_free_without_one_and_free_with_a_belief():
    effects = {"mass_change": 1.1, "steering_lag": None, "steering_delay": Stated(0.02, 0.01)}
    model = build("single_track", {}, effects)
    assert model.effects == tuple(effects)
    for name, value, fixed in (
        ("mass_change", 1.1, True),
        ("steering_lag", 0.03, False),
        ("steering_delay", 0.02, False),
    ):
        assert (float(model[name].array), model[name].fixed) == (value, fixed)
    assert model["steering_delay"].prior == Prior(0.01, mean=0.02)


def test_what_a_vehicle_may_state_is_known():
    assert {"m", "B_f", "C_alpha_r", "mu_f", "wheel_radius", "K_us", "drive_lag"} <= set(vehicle_parameters())


def test_an_effect_that_a_model_has_from_its_settings_is_not_added_twice():
    model = tiny("msnn_full_plus")
    again = build("msnn_full_plus", model.settings, {name: float(model[name].array) for name in model.effects})
    assert again.effects == model.effects


@pytest.mark.parametrize("name", MODELS)
def test_candidates_differ_only_in_what_the_settings_leave_open(name):
    lap = drive(300)
    lap = lap.with_signals(v_y=0.1 * lap["yaw_rate"])
    found = candidates(name, lap, TINY.get(name, {}))
    assert len(found) >= 1
    assert len({json.dumps(dict(m.settings), sort_keys=True) for m in found}) == len(found)
    assert len(candidates(name, lap, found[0].settings)) == 1


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({"lat": 3}),
        pytest.param({"lat": {"n_delta": "five"}}),
        pytest.param({"symetric": True}),
    ],
)
def test_candidates_of_impossible_settings_are_refused_in_a_sentence(settings):
    with pytest.raises(BadInput):
        candidates("msnn_full_plus", drive(300), settings)


def test_given_centres_settle_how_many_local_models_are_tried():
    assert candidates("msnn_full_plus", drive(300), {"lat": {"steer": [-0.4, -0.2, 0.0, 0.2, 0.4]}})
