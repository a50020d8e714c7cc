"""A network saved by nnodely predicts here what it predicts there, and its file becomes a fit like any other."""

import json

import numpy as np
import pytest
from networks import FOLDER, FOREIGN, NAMES, body_of, imported, predicted, said, stated

from greybox_id.base.errors import BadInput
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.saved_fit import load
from greybox_id.fitting.scores.memory import predictions
from greybox_id.fitting.scores.metrics import score
from greybox_id.models.registry import build
from greybox_lab.nnodely import import_network, verb

MODELS = {"lat": "msnn_lat", "ren": "msnn_lat", "lon": "msnn_long", "ful": "msnn_full"}


def of_file(name):
    return import_network(FOLDER / f"{name}.json", said(name))


@pytest.mark.parametrize("name", NAMES)
def test_predictions_are_those_of_nnodely(name):
    found, told = of_file(name), stated(name)
    assert found.fit.model.name == MODELS[name[:3]]
    assert found.roles == told["roles"]
    windows = {told["roles"][key]: np.array(values) for key, values in told["windows"].items()}
    own = predicted(found.fit.model, windows)
    assert set(found.outputs.values()) == set(found.fit.model.outputs)
    for output, signal in found.outputs.items():
        double, single = np.array(told["double"][output]), np.array(told["predictions"][output])
        scale = max(np.max(np.abs(double)), 1.0)
        np.testing.assert_allclose(own[signal], double, rtol=0, atol=1e-13 * scale)
        np.testing.assert_allclose(own[signal], single, rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("name", NAMES)
def test_a_fit_of_a_file_is_saved_and_loaded_and_says_that_nothing_is_known_of_its_uncertainty(tmp_path, name):
    fit = of_file(name).fit
    again = load(fit.save(tmp_path / "fit.json"), build)
    np.testing.assert_array_equal(again.model.values, fit.model.values)
    assert again.model.sample_time == 0.05
    assert set(again.notes().values()) == {"held"}
    assert all(np.all(np.isnan(end)) for p in again.model.parameters for end in again.interval(p.name))
    assert again.mode == "imported"
    assert again.how["imported"] == f"{name}.json"


def test_a_sample_time_that_nnodely_made_up_is_asked_for(tmp_path):
    body = body_of("lat_small")
    body["Info"]["SampleTime"] = 1
    with pytest.raises(BadInput, match=r"1 s, which nnodely writes if none was given.*sample_time 0.05"):
        imported(tmp_path, body)
    assert imported(tmp_path, body, sample_time=0.02).fit.model.sample_time == 0.02


def test_windows_in_seconds_follow_the_sample_time(tmp_path):
    body = body_of("renamed")
    assert imported(tmp_path, body, FOREIGN).fit.model["F"].shape[-1] == 5
    with pytest.raises(BadInput, match="window"):
        imported(tmp_path, body, FOREIGN, sample_time=0.025)  # weights are of five samples, the window now of ten


def test_numbers_that_no_vehicle_has_are_kept_and_said(tmp_path):
    body = body_of("long")
    body["Parameters"]["k_a"]["values"] = [[-0.65]]
    body["Parameters"]["r"]["values"] = [[-0.27]]
    found = imported(tmp_path, body)
    assert float(found.fit.model["k_a"].array) == pytest.approx(-0.65, rel=1e-12)
    assert float(found.fit.model["r"].array) == -0.27
    assert any("r, k_a" in note or "k_a, r" in note for note in found.notes)
    again = load(found.fit.save(tmp_path / "fit.json"), build)
    assert float(again.model["r"].array) == -0.27


def test_a_closed_loop_at_constant_speed_is_that_of_nnodely():
    told, found = stated("full_closed")["loop"], of_file("full_closed")
    read = {name: np.array(values) for name, values in told["read"].items()}
    rows = len(read["vel"]) + 1
    signals = {found.roles[name]: values for name, values in read.items() if name in found.roles}
    signals["yaw_rate"] = read["rate"]
    padded = {name: np.pad(values, (0, rows - len(values)), "edge") for name, values in signals.items()}
    run = predictions(found.fit.model, Recording("loop", 0.05 * np.arange(rows), padded), "closed_loop").predicted
    for output, signal in found.outputs.items():
        own = run[:, found.fit.model.outputs.index(signal)]
        np.testing.assert_allclose(own, told["predictions"][output], rtol=0, atol=1e-12)


def test_the_authors_numbers_in_a_file_of_nnodely_give_their_published_error(tmp_path, real_data):
    net = json.loads((real_data / "roboracer" / "lateral_net.json").read_text(encoding="utf-8"))
    body = body_of("lat")
    for name, own in body["Parameters"].items():  # made as theirs was, the file has their names
        own["values"] = net["parameters"][name]
    for name, own in body["Constants"].items():
        axis = next(axis for axis in ("steer", "vx", "ax") if name.startswith(axis))
        own["values"] = [net["centres"][{"vx": "v_x", "ax": "a_x"}.get(axis, axis)][int(name[-1])]]
    for own in body["Functions"].values():
        if "centers" in own:
            sizes = {-0.3: "v_x", -0.37: "steer", -5.1: "a_x"}
            own["centers"] = net["centres"][sizes[own["centers"][0]]]
    valid = read(real_data / "roboracer" / "valid.csv", "roboracer")
    model = imported(tmp_path, body).fit.model
    scored = score(model, valid.with_signals(a_x=-valid["a_x"]))  # their sign of a_x
    assert scored["published"]["yaw_rate"].rmse == pytest.approx(0.1088, abs=5e-4)


def test_what_is_read_wrongly_is_not_handed_out(tmp_path, monkeypatch):
    recognise = verb.recognise

    def bent(network, roles):
        family = recognise(network, roles)
        family.parts[0].values["F"][0, 0, 0] += 1e-6
        return family

    monkeypatch.setattr(verb, "recognise", bent)
    with pytest.raises(BadInput, match="its own graph predicts something else"):
        imported(tmp_path, body_of("lat_small"))
