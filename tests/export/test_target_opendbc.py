"""A snippet for opendbc: it runs, and sets what the model knows."""

from types import SimpleNamespace

import pytest

from greybox_id.export.subject import Subject
from greybox_id.export.target_opendbc import cautions, files, origins
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle


def made(effects, source="a test"):
    car = vehicle("full_size_car")
    return Subject(build("single_track", {}, effects, car), "car", None, source=source, vehicle=car)


@pytest.mark.parametrize("source", ["a test", "evil\nimport os", 'x"""\u2028y = 1'])
def test_the_snippet_sets_what_is_known(source):
    meant = made({"steering_delay": 0.12, "mass_change": 1.1, "front_stiffness": 0.9}, source)
    space = {}
    exec(files(meant)["car_opendbc.py"].decode(), space)  # our own text
    ret = space["vehicle_params"](SimpleNamespace())
    own = vehicle("full_size_car").values
    assert set(vars(ret)) == {origin.key for origin in origins(meant) if origin.value is not None}
    assert (ret.steerActuatorDelay, ret.rotationalInertia, ret.centerToFront) == (
        0.12,
        own["I_z"].value,
        own["l_f"].value,
    )
    assert ret.mass == pytest.approx(1.1 * own["m"].value)
    load = ret.mass * 9.81 * own["l_r"].value / ret.wheelbase
    assert ret.tireStiffnessFront == pytest.approx(0.9 * 9.3 * 1.4 * 1.0 * load, rel=1e-9)


def test_what_is_not_known_is_left_open_and_said():
    text = files(made({}))["car_opendbc.py"].decode()
    assert "# ret.steerRatio = ..." in text
    assert "# ret.steerActuatorDelay = ...  # s; the model has no steering_delay" in text
    assert "CarParams has no entry for steering_lag, which is left out." in cautions(made({"steering_lag": 0.1}))
