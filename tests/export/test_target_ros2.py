"""Parameter files of ROS 2 nodes: all parameters exactly, typed, with intervals where they are known."""

import numpy as np
import pytest
import yaml

from greybox_id.export.subject import Subject
from greybox_id.export.target_ros2 import files, number_text, origins
from greybox_id.fitting.fit import Fit
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle


def test_parameters_and_intervals_come_back_exactly():
    car = vehicle("full_size_car")
    model = build("single_track", {}, {"steering_delay": 0.037, "steering_rate_limit": float("inf")}, car)
    sd = {p.name: 0.05 * np.abs(p.array) for p in model.parameters if not p.fixed and np.isfinite(p.array)}
    fit = Fit(model=model, sd=sd, stages=(), metrics={}, data=(), mode="given", seed=0)
    meant = Subject(model, "car", None, fit, source="a test", vehicle=car)
    (text,) = files(meant).values()
    found = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert found["parameters"] == {p.name: float(p.array) for p in model.parameters}
    assert found["intervals"]["I_z"] == [float(end) for end in fit.interval("I_z")]
    assert (found["model"], found["frame_id"], found["steer_max"]) == ("single_track", "base_link", 0.5)
    assert "REP-103" in text.decode()
    assert {origin.key.partition(".")[2] for origin in origins(meant) if origin.key.startswith("parameters.")} == set(
        found["parameters"]
    )


@pytest.mark.parametrize("value", [1e-9, 1e22, 5e-324, -1.5, 0.0, 1e16, float("inf"), -float("inf")])
def test_numbers_are_read_as_numbers(value):
    assert yaml.safe_load(number_text(value)) == value
    assert isinstance(yaml.safe_load(number_text(value)), float)
