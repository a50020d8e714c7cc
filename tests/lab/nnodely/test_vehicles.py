"""Vehicle files of other tools become vehicle files, each number with its source."""

from importlib import resources

import pytest
from calling import greybox, refused

from greybox_id.base.errors import BadInput
from greybox_id.models.vehicle import vehicle
from greybox_lab.nnodely import import_vehicle

AUTOWARE = """\
/**:
  ros__parameters:
    wheel_radius: 0.383 # used for dead reckoning
    wheel_width: 0.235
    wheel_base: 2.79
    wheel_tread: 1.64
    front_overhang: 1.0
    max_steer_angle: 0.70
"""
GYM = """\
mu: 1.0489
C_Sf: 4.718
C_Sr: 5.4562
lf: 0.15875
lr: 0.17145
h: 0.074
m: 3.74
I: 0.04712
s_max: 0.4189
sv_max: 3.2
v_switch: 7.319
"""


def imported(tmp_path, text, name="x.yaml"):
    (tmp_path / name).write_text(text)
    return import_vehicle(tmp_path / name)


def test_autowares_vehicle_info(tmp_path):
    found = imported(tmp_path, AUTOWARE, "vehicle_info.param.yaml")
    car = found.vehicle
    assert car.values["l_f"].value + car.values["l_r"].value == pytest.approx(2.79)
    assert (car.values["l_f"].min, car.values["l_f"].max) == (0.0, 2.79)
    assert (car.values["track_f"].value, car.values["wheel_radius"].value, car.steer_max) == (1.64, 0.383, 0.7)
    assert car.values["track_f"].source == "Autoware vehicle_info.param.yaml: wheel_tread"
    assert "ignored: front_overhang, wheel_width" in found.notes


def test_f1tenth_gyms_parameters(tmp_path):
    car = imported(tmp_path, GYM).vehicle
    load = 3.74 * 9.81 * 0.17145 / (0.15875 + 0.17145)
    assert car.values["C_alpha_f"].value == pytest.approx(1.0489 * 4.718 * load)
    assert car.model.effects["steering_rate_limit"].value == 3.2
    assert (car.model.settings["tyre"], car.steer_max, car.values["I_z"].value) == ("linear", 0.4189, 0.04712)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_commonroads_vehicles(number):
    models = pytest.importorskip("vehiclemodels", reason="pip install 'greybox-id[exam]'")
    module = __import__(f"vehiclemodels.parameters_vehicle{number}", fromlist=["x"])
    p = getattr(module, f"parameters_vehicle{number}")()
    folder = resources.files(models).joinpath("parameters")
    car = import_vehicle(str(folder.joinpath(f"parameters_vehicle{number}.yaml"))).vehicle
    assert [car.values[name].value for name in ("m", "I_z", "l_f", "l_r")] == [p.m, p.I_z, p.a, p.b]
    assert (car.steer_max, car.model.effects["steering_rate_limit"].value) == (p.steering.max, p.steering.v_max)
    tyres = import_vehicle(str(folder.joinpath("parameters_tire.yaml"))).vehicle.values
    assert tyres["B_f"].value == pytest.approx(abs(p.tire.p_ky1) / (p.tire.p_cy1 * p.tire.p_dy1))
    assert (tyres["C_r"].value, tyres["D_r"].value, tyres["E_r"].value) == (p.tire.p_cy1, p.tire.p_dy1, p.tire.p_ey1)


@pytest.mark.parametrize("text", [AUTOWARE, GYM])
def test_the_command_writes_a_vehicle_file_that_is_read_again(tmp_path, text):
    (tmp_path / "x.yaml").write_text(text)
    called = greybox("import", tmp_path / "x.yaml", "--out", tmp_path / "car.toml", "--json")
    assert called.code == 0, called.err
    assert called.told["written"] == str(tmp_path / "car.toml")
    again = vehicle(tmp_path / "car.toml")
    assert again.values == import_vehicle(tmp_path / "x.yaml").vehicle.values
    assert "note     " in greybox("import", tmp_path / "x.yaml", "--out", tmp_path / "car.toml").out


@pytest.mark.parametrize(
    "text",
    [
        "", "3", "[1, 2]", "a: 1", "wheel_base: .nan", "wheel_base: -2", "wheel_base: true", "wheel_base: [2]",
        "wheel_base: 1.0e300", "wheel_base: 2\nwheel_tread: many", GYM.replace("3.74", ".inf"),
        GYM.replace("mu: 1.0489", "mu: 0"),
        "tire: 3", "tire: {p_cy1: 1.3}", "m: 1\na: 1\nb: 1\nI_z: 1\ntire: {p_cy1: 0, p_dy1: 1, p_ey1: 0, p_ky1: 1}",
        "wheel_base: " + "9" * 5000,
    ],
)  # fmt: skip
def test_what_cannot_be_is_a_sentence(tmp_path, text):
    with pytest.raises(BadInput, match=r"x\.yaml"):
        imported(tmp_path, text)
    assert "x.yaml" in refused("import", tmp_path / "x.yaml", "--out", tmp_path / "car.toml")


def test_options_of_networks_are_refused(tmp_path):
    (tmp_path / "x.yaml").write_text(AUTOWARE)
    assert greybox("import", tmp_path / "x.yaml", "--sample-time", "0.1").code == 2
    assert "vehicle file ends in" in refused("import", tmp_path / "x.yaml", "--out", tmp_path / "car.csv")
