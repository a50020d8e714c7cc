"""Equations of motion meet a vehicle that has changed."""

from dataclasses import replace

import pytest
from calling import greybox, refused
from driven import driven, written

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.fitting.adaptation.verb import adapt

WET = {"D_f": 0.75, "D_r": 0.8}


@pytest.fixture(scope="module")
def fitted():
    options = gb.FitOptions(horizon=2.0, solver="gauss-newton")
    return gb.fit("lateral", driven(runs=2, seconds=16.0, seed=1), vehicle="full_size_car", fix=["m"], options=options)


@pytest.mark.slow
def test_a_floor_that_became_slippery_is_found_and_what_follows_is_predicted(fitted):
    new = driven(runs=1, seconds=30.0, seed=7, values=WET)
    found = adapt(fitted, new, seconds=16)
    assert "estimated parameters" in found.choices["yaw_rate"]
    assert found.fit.model["D_f"].array == pytest.approx(WET["D_f"], rel=0.15)
    again = gb.fit("lateral", new, vehicle="full_size_car", fix=["m"],
                   options=gb.FitOptions(horizon=2.0, solver="gauss-newton"))  # fmt: skip
    of_new = again.score(new).query("protocol == '0.5 s ahead'").set_index("output")["rmse"]
    for output, error in found.chosen.rest.items():
        assert error.rmse < 1.1 * of_new[output] < found.zero_shot.rest[output].rmse
        low, high = found.chosen.interval[output]
        assert low < error.rmse < high
    assert "D_f" in found.moved
    assert found.fit.model["m"].fixed
    assert [p.fixed for p in found.fit.model.parameters] == [p.fixed for p in fitted.model.parameters]


def test_a_vehicle_that_did_not_change_keeps_its_fit(fitted):
    found = adapt(fitted, driven(runs=1, seconds=16.0, seed=9), seconds=10)
    for output, error in found.chosen.rest.items():
        before = found.zero_shot.rest[output]
        assert error.rmse < before.rmse + before.rmse_sd


def test_only_what_is_named_moves(fitted):
    found = adapt(fitted, driven(runs=1, seconds=16.0, seed=7, values=WET), seconds=10, free="D_f, D_r")
    moved = [p.name for p in found.fit.model.parameters if p.array != fitted.model[p.name].array]
    assert sorted(moved) == ["D_f", "D_r"]


def test_what_cannot_be_adapted_is_a_sentence(fitted):
    new = driven(runs=1, seconds=20.0, seed=7)
    for call, says in (
        ({"free": "F"}, "not a parameter of this fit of lateral that may change"),
        ({"seconds": 60.0}, "holds 20 s of motion"),
        ({"seconds": 6.0}, "one run of 10 s is needed"),
        ({"calibrate": "timing"}, "for models with memory"),
    ):
        with pytest.raises(BadInput, match=says):
            adapt(fitted, new, **({"seconds": 16.0} | call))


@pytest.mark.slow
def test_the_command_adapts_and_the_fit_it_writes_is_read_again(fitted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fitted.save("fit.json")
    written(driven(runs=1, seconds=20.0, seed=7, values=WET), "wet.csv")
    told = greybox("adapt", "fit.json", "wet.csv", "--seconds", 16, "--out", "adapted", "--json").told
    assert told["chosen"]["rest"]["yaw_rate"]["rmse"] < told["zero_shot"]["rest"]["yaw_rate"]["rmse"]
    assert gb.load(told["written"]).params["D_f"] == pytest.approx(WET["D_f"], rel=0.15)
    assert "0.5 s ahead" in greybox("adapt", "fit.json", "wet.csv", "--seconds", 10, "--free", "D_f").out
    assert "one run of 10 s" in refused("adapt", "fit.json", "wet.csv", "--seconds", 5)


@pytest.mark.slow
def test_a_recording_that_is_not_trusted_is_told_first(fitted, tmp_path):
    new = driven(runs=1, seconds=16.0, seed=7)
    wrong = replace(new, signals={**new.signals, "yaw_rate": new["yaw_rate"] * 1000})
    said = []
    found = adapt(fitted, wrong, seconds=11, free="D_f", say=lambda line, passing=False: said.append(line))
    assert any("yaw_rate" in own for own in found.doubts)
    assert said[: len(found.doubts)] == list(found.doubts)
    assert len(said) > len(found.doubts)  # and then what is done
    assert found.as_dict()["doubts"] == list(found.doubts)
    assert found.doubts[0].split()[-1] in gb.adapt(fitted, wrong, seconds=11, free="D_f").summary()
    assert adapt(fitted, new, seconds=11, free="D_f").doubts == ()


def test_rows_that_are_too_far_apart_are_a_sentence(fitted):
    new = driven(runs=1, seconds=16.0, seed=7)
    with pytest.raises(BadInput, match=r"has a row every .* s, but errors of predictions over 0.5 s"):
        adapt(fitted, replace(new, time=new.time * 1000), seconds=11000)
