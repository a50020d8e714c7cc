"""Closed models come back from what a diagnosis wrote down, and are tried on the held-out recordings."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.base.json_data import without_nan
from greybox_id.gap.gap import Closure, Gap, Ranked, Where
from greybox_id.models.registry import build
from greybox_lab.cli.exam import diagnose_case
from greybox_lab.exam.answers import Answer
from greybox_lab.exam.verification import held_out_closure, model_from, plain_model, true_closure

VEHICLE = """
name = "car"
[parameters]
m = 1500.0
[noise]
yaw_rate = 0.01
"""


@pytest.fixture
def closed():
    model = build("single_track", effects={"steering_delay": 0.031, "wind_gust": 4.0})
    return model.with_values(model.values * 1.01)


@pytest.fixture
def case(tmp_path):
    (tmp_path / "vehicle.toml").write_text(VEHICLE)
    (tmp_path / "recording.csv").write_text("time,yaw_rate,steer\n0,0,0\n0.01,0,0\n")
    return tmp_path


def test_a_model_survives_being_written_down(closed):
    again = model_from(json.loads(json.dumps(without_nan(plain_model(closed)))))
    assert again.name == closed.name
    assert tuple(again.effects) == tuple(closed.effects)
    assert [parameter.name for parameter in again.parameters] == [parameter.name for parameter in closed.parameters]
    assert np.allclose(
        [parameter.array for parameter in again.parameters],
        [parameter.array for parameter in closed.parameters],
        rtol=1e-14,
    )


def test_the_closed_model_is_compared_with_that_of_the_vehicle_file(case, closed, monkeypatch):
    seen = []

    def closure(before, after, recordings, vehicle, effects):
        seen.append((before, after, recordings, vehicle))
        assert "steering_delay" in effects
        return SimpleNamespace(closed=0.9)

    monkeypatch.setattr("greybox_lab.exam.verification.closure", closure)
    found = held_out_closure(case, case / "recording.csv", {"closed_model": plain_model(closed)})
    ((before, after, recordings, stated),) = seen
    assert found == 0.9
    assert float(before["m"].array) == 1500.0
    assert not before.effects
    assert float(after["steering_delay"].array) == pytest.approx(0.031 * 1.01)
    assert [len(recording) for recording in recordings] == [2]
    assert dict(stated.noise) == {"yaw_rate": 0.01}


def test_the_true_effects_are_in_the_model_that_they_close(case, monkeypatch):
    seen = []

    def closure(before, after, *_, **__):
        seen.append((before, after))
        return SimpleNamespace(closed=0.95)

    monkeypatch.setattr("greybox_lab.exam.verification.closure", closure)
    drawn = {"steering_delay": 0.04, "gust_direction": 0.5, "outside_the_vocabulary": 1.0}
    present = {"steering_delay": 0.04, "wind_gust": 3.0, "outside_the_vocabulary": 1.0}
    answer = Answer("case_000", "many", "many", present, about={"drawn": drawn})
    assert true_closure(case, case / "recording.csv", answer) == 0.95
    ((before, after),) = seen
    assert not before.effects
    assert set(after.effects) == {"steering_delay", "wind_gust"}
    assert [float(after[name].array) for name in ("m", *after.effects)] == [1500.0, 0.04, 3.0]


def test_a_model_that_cannot_be_simulated_closes_nothing(case, closed, monkeypatch):
    def closure(*_, **__):
        raise BadInput("it blew up.")

    monkeypatch.setattr("greybox_lab.exam.verification.closure", closure)
    assert held_out_closure(case, case / "recording.csv", {"closed_model": plain_model(closed)}) == -np.inf


def test_a_case_is_diagnosed_as_a_user_does_it(case, closed, monkeypatch):
    gap = Gap(
        model="single_track", recordings=("recording",), doubts=(), gap_detected=True, p_value=1e-9,
        unknown_probability=0.1, unknown="", where=Where("yaw_rate"),
        ranking=(Ranked("steering_delay", 0.9, 0.031, "s", (0.03, 0.032)),), applied=("steering_delay",),
        gap=Closure(2.0, 1.0, 1.0, 1.0, (0.9, 1.0)), held_out=None, not_excited={}, absorbed=(), advice=(),
        closed=closed,
    )  # fmt: skip

    def diagnosed(vehicle, recording, since=None, *, held_out=(), columns="canonical"):
        assert (recording.name, vehicle.name, since, columns) == ("recording.csv", "car", None, "canonical")
        return gap

    monkeypatch.setattr("greybox_id.api.diagnosing.diagnose", diagnosed)
    body = diagnose_case(case)
    assert body["ranking"][0]["effect"] == "steering_delay"
    assert body["closed_model"]["values"]["steering_delay"] == pytest.approx(0.031 * 1.01)
    assert "steering_delay" in (case / "closed.toml").read_text()
