"""A fit on disk: it comes back as it was, or is refused in a sentence."""

import json
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toys import drive, tiny

from greybox_id.base.errors import BadInput, GreyboxError
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.provenance import Certificate, DataRecord, Stage
from greybox_id.fitting.saved_fit import load
from greybox_id.models.effects import sensor_latency_imu, steering_rate_limit
from greybox_id.models.registry import build, prepared


def made(model=None, **changed):
    """A fit as `fitting.fit` would make it, filled by hand."""
    model = model or prepared("msnn_lat", drive(), {"n_delta": 3, "q": 4})
    certificate = Certificate("Solve Succeeded", True, 3, 10.0, 9.99, 1e-9, 0.0, 0.1)
    stage = Stage(
        model=model.name, closed_loop=False, status="converged", converged=True, steps=3, history=(12.0, 11.0, 10.0),
        starts=(10.0, 11.5), strengths={"transient": 2.0}, strengths_from="cross-validation",
        tried=(({"transient": 1.0}, 1.1), ({"transient": 2.0}, 1.0)), noise={"yaw_rate": 0.1}, cpu_seconds=0.5,
        cross_validation_seconds=0.25, certificate=certificate, ended_at=({"m": 3.4}, {"m": 3.6}),
    )  # fmt: skip
    fields = {
        "model": model,
        "sd": {p.name: np.full(p.shape, 0.1) + np.arange(p.size).reshape(p.shape) for p in model.parameters},
        "stages": (stage, replace(stage, certificate=None)),
        "metrics": {"train": {"honest": {"yaw_rate": {"rmse": 0.1, "rmse_sd": 0.01, "fvu": 0.02, "samples": 145}}}},
        "data": (DataRecord("train", "drive", "a b/drive.csv", "ab" * 32, "roboracer", 150, 1, 7.45),),
        "mode": "cross-validation",
        "seed": 7,
        "command": "greybox fit --model msnn_lat 'a b/drive.csv'",
    }
    return Fit(**{**fields, **changed})


def sealed(path, change):
    """Change the file's content and give it the checksum that belongs to it, by way of a fit's own writing."""
    body = json.loads(path.read_text(encoding="utf-8"))
    change(body)
    body.pop("checksum")

    class Forged(Fit):
        def as_dict(self):
            return body

    Forged(**{name: getattr(made(), name) for name in made().__dataclass_fields__}).save(path)


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    return made().save(tmp_path_factory.mktemp("fit") / "fit.json").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["msnn_lat", "msnn_long", "msnn_full", "msnn_full_plus"])
def test_a_fit_comes_back_as_it_was(tmp_path, name):
    before = made(tiny(name))
    after = load(before.save(tmp_path / "fit.json"), build)
    assert after.as_dict() == before.as_dict()
    assert np.array_equal(after.model.values, before.model.values)
    assert (after.stages, after.data) == (before.stages, before.data)
    assert after.stages[0].certificate == before.stages[0].certificate


@pytest.mark.parametrize(
    "model",
    [
        tiny("msnn_lat") + steering_rate_limit.at(2.0) + sensor_latency_imu.at(0.04),
        tiny("msnn_full") + sensor_latency_imu,
        tiny("msnn_lat") + steering_rate_limit,
        tiny("msnn_lat").with_parameters(replace(tiny("msnn_lat")["F"], fixed=True)),
    ],
    ids=["two effects held", "effect free", "effect free at its infinite null", "parameter held"],
)
def test_effects_and_what_is_held_come_back_as_they_were(tmp_path, model):
    before = made(model)
    after = load(before.save(tmp_path / "fit.json"), build)
    assert after.model.effects == before.model.effects
    assert [p.fixed for p in after.model.parameters] == [p.fixed for p in before.model.parameters]
    assert np.array_equal(after.model.values, before.model.values)
    assert after.notes() == before.notes()


def test_numbers_that_are_not_finite_do_not_break_the_file(tmp_path):
    stage = made().stages[0]
    odd = replace(stage, certificate=replace(stage.certificate, gradient=float("nan")), starts=(1.0, float("inf")))
    metrics = {
        "validate": {"published": {"a_x": {"rmse": float("nan"), "rmse_sd": float("nan"), "fvu": float("-inf")}}}
    }
    before = made(stages=(odd,), metrics=metrics, sd={"F": np.full((2, 2, 5), np.inf)})
    path = before.save(tmp_path / "fit.json")
    json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    after = load(path, build)
    assert np.isnan(after.stages[0].certificate.gradient)
    assert after.stages[0].starts == (1.0, np.inf)
    assert np.isnan(after.metrics["validate"]["published"]["a_x"]["rmse"])
    assert after.metrics["validate"]["published"]["a_x"]["fvu"] == -np.inf
    assert np.all(np.isinf(after.sd["F"]))


def test_saving_again_replaces_the_file_whole(tmp_path):
    path = made(seed=1).save(tmp_path / "deep" / "fit.json")
    made(seed=2).save(path)
    assert load(path, build).seed == 2
    assert [p.name for p in path.parent.iterdir()] == ["fit.json"]


@pytest.mark.parametrize("where", ["write", "replace"])
def test_an_interrupted_save_leaves_the_old_file_whole(tmp_path, monkeypatch, where):
    from pathlib import Path

    path = made(seed=1).save(tmp_path / "fit.json")

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, {"write": "write_text", "replace": "replace"}[where], interrupted)
    with pytest.raises(KeyboardInterrupt):
        made(seed=2).save(path)
    monkeypatch.undo()
    assert load(path, build).seed == 1
    assert [p.name for p in tmp_path.iterdir()] == ["fit.json"]


def test_a_place_that_cannot_be_written_is_refused_in_a_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be written"):
        made().save(tmp_path / "file" / "fit.json")


@given(st.data())
@settings(max_examples=100)
def test_a_damaged_file_is_refused_in_a_sentence_whatever_the_damage(text, tmp_path, data):
    raw = bytearray(text.encode())
    place = data.draw(st.integers(0, len(raw) - 1))
    kind = data.draw(st.sampled_from(["flip", "cut", "drop", "insert", "repeat"]))
    length = data.draw(st.integers(1, 60))
    if kind == "flip":
        raw[place] ^= 1 << data.draw(st.integers(0, 7))
    elif kind == "cut":
        raw = raw[:place]
    elif kind == "drop":
        del raw[place : place + length]
    elif kind == "insert":
        raw[place:place] = data.draw(st.binary(min_size=1, max_size=length))
    else:
        raw[place:place] = raw[place : place + length]
    path = tmp_path / "fit.json"
    path.write_bytes(bytes(raw))
    with suppress(BadInput):  # unless white space moved, or something else that means the same
        assert load(path, build).as_dict() == made().as_dict()


@pytest.mark.parametrize("digit", "0123456789")
def test_a_changed_digit_in_an_estimate_is_noticed(text, tmp_path, digit):
    place = text.index('"value"')
    place += next(k for k, c in enumerate(text[place:]) if c == "." and text[place + k + 1] != digit) + 1
    path = tmp_path / "fit.json"
    path.write_text(text[:place] + digit + text[place + 1 :], encoding="utf-8")
    with pytest.raises(BadInput, match="damaged"):
        load(path, build)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "not JSON"), ("v_x,steer\n1,2\n", "is not JSON; name a file"), ("[" * 100_000, "not JSON"),
        ('{"a": ' + "9" * 5000, "not JSON"),
        ("{}", "not a fit"), ("[1, 2]", "not a fit"), ("null", "not a fit"), ('"fit"', "not a fit"), ("3", "not a fit"),
        ('{"format": "greybox-fit"}', "format version"), ('{"not_finite": "nan"}', "not a fit"),
        ('{"format": "greybox-fit", "format_version": 99, "version": "9.9"}', r"format version 99.*9\.9"),
        ('{"format": "greybox-fit", "format_version": 2}', "damaged"),
    ],
)  # fmt: skip
def test_what_is_no_fit_is_refused_in_a_sentence(tmp_path, content, says):
    path = tmp_path / "fit.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(BadInput, match=says):
        load(path, build)


def test_no_file_a_folder_and_bytes_that_are_no_text_are_refused_in_a_sentence(tmp_path):
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    for name in ("nothing.json", ".", "bytes.json"):
        with pytest.raises(BadInput):
            load(tmp_path / name, build)


FORGERIES = {
    "unknown model": lambda b: b["model"].update(name="msnn_lap"),
    "unknown setting": lambda b: b["model"]["settings"].update(n_gamma=3),
    "other setting": lambda b: b["model"]["settings"].update(q=5),
    "unknown effect": lambda b: b["model"]["effects"].update(wings=1.0),
    "effect without its parameter": lambda b: b["model"]["effects"].update(steering_rate_limit=1.0),
    "value of another shape": lambda b: b["parameters"]["F"].update(value=[1.0, 2.0]),
    "ragged value": lambda b: b["parameters"]["F"].update(value=[[1.0], [1.0, 2.0]]),
    "value in words": lambda b: b["parameters"]["F"].update(value="fast"),
    "value out of bounds": lambda b: b["parameters"]["F"].update(value=float("nan")),
    "deviation of another shape": lambda b: b["parameters"]["F"].update(sd=[1.0]),
    "no deviation": lambda b: b["parameters"]["F"].pop("sd"),
    "parameter missing": lambda b: b["parameters"].pop("F"),
    "parameter too many": lambda b: b["parameters"].update(G=b["parameters"]["F"]),
    "model missing": lambda b: b.pop("model"),
    "model in words": lambda b: b.update(model="msnn_lat"),
    "settings in words": lambda b: b["model"].update(settings="all"),
    "stages missing": lambda b: b.pop("stages"),
    "stage of other fields": lambda b: b["stages"][0].update(mood="good"),
    "stage in words": lambda b: b["stages"].append("done"),
    "tried in words": lambda b: b["stages"][0].update(tried=["all"]),
    "certificate in words": lambda b: b["stages"][0].update(certificate="yes"),
    "data in words": lambda b: b.update(data=["drive.csv"]),
    "per run in words": lambda b: b.update(per_run={"F": "many"}),
}


@pytest.mark.parametrize("forgery", FORGERIES)
def test_content_that_makes_no_fit_is_refused_in_a_sentence_even_with_a_right_checksum(tmp_path, forgery):
    path = made().save(tmp_path / "fit.json")
    sealed(path, FORGERIES[forgery])
    with pytest.raises(GreyboxError):
        load(path, build)


def test_notes_tell_what_is_held_at_a_bound_or_hardly_told():
    model = tiny("msnn_long")
    model = model.with_parameters(
        replace(model["r"], fixed=True), model["c_r"].with_value(0.0), model["m"].with_value(3.45)
    )
    notes = made(
        model, sd={"m": np.array(0.09), "c_r": np.array(0.01), "c_l": np.array(0.1), "r": np.array(0.0)}
    ).notes()
    assert notes["r"] == "held"
    assert notes["c_r"] == "at its bound"
    assert notes["m"].startswith("weakly identifiable")
    assert "c_l" not in notes
