"""Vehicles have four wheels and drag that is not exactly v^2: that is no gap, and passes for no effect."""

import numpy as np
import pytest

from greybox_id.datasets.vehicle_file import vehicle
from greybox_id.datasets.virtual_vehicle import Forms, drive, random_vehicle
from greybox_id.datasets.virtual_vehicle.car import tolerances, vehicle_file_text
from greybox_id.estimation import preparing
from greybox_id.gap.closing import refitted_tolerances
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import model_of


@pytest.mark.parametrize(
    ("form", "channel"), [({"geometry": "each_wheel"}, "yaw_rate"), ({"drag": "other_powers"}, "v_x")]
)
def test_forms_of_a_vehicle_are_within_what_its_model_leaves_out(form, channel, tmp_path, monkeypatch):
    car = random_vehicle(100, "racer")
    path = tmp_path / "car.toml"
    path.write_text(vehicle_file_text(car, tolerances(car)))
    stated = vehicle(path)
    recording, _ = drive(car, "mixed", 40.0, seed=100, forms=Forms(**form))

    def left():
        found, bench = refitted_tolerances(model_of(stated), [recording], stated, EFFECTS)
        return np.sum((found.e[:, bench.channels.index(channel)] / stated.noise[channel]) ** 2), found.charge

    misfit, charge = left()
    monkeypatch.setattr(preparing, "with_roughness", lambda model, *_: model)
    bare_misfit, bare_charge = left()
    assert misfit < 1.08 * len(recording)
    assert misfit + charge < bare_misfit + bare_charge - 10.0
