"""Tyre property files: what is written pulls as the model's tyres do and is read back as it was."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.export.subject import Subject
from greybox_id.export.target_tir import cautions, files, origins
from greybox_id.models.registry import build
from greybox_id.models.tyre_file import parse_tyre_file
from greybox_id.models.vehicle import vehicle

EFFECTS = {"grip_scale": 0.87, "front_stiffness": 1.13, "mass_change": 1.1}


def written(effects, **values):
    car = vehicle("full_size_car")
    model = build("single_track", {}, effects, car)
    model = model.with_parameters(*(model[name].with_value(value) for name, value in values.items()))
    meant = Subject(model, "car", None, source="a test", vehicle=car)
    texts = {name: text.decode() for name, text in files(meant).items()}
    return meant, {name: parse_tyre_file(text, name) for name, text in texts.items()}


def test_axles_pull_as_the_models_do():
    meant, tyres = written(EFFECTS, S_h_f=0.004, S_v_r=0.01)
    trace, model = MotionTrace(meant.model), meant.model
    rng = np.random.default_rng(0)
    told = trace.named_values(["alpha_f", "alpha_r", "F_zf", "F_zr", "F_yf", "F_yr"])
    for _ in range(200):
        z = np.array([rng.uniform(2, 40), rng.normal(0, 1.5), rng.normal(0, 0.5)])
        segment = np.zeros(trace.segment_size)
        segment[1] = rng.normal(0, 0.1)
        alpha_f, alpha_r, F_zf, F_zr, F_yf, F_yr = np.array(told(z, segment, model.values)).ravel()
        for file, alpha, load, force in (("front", alpha_f, F_zf, F_yf), ("rear", alpha_r, F_zr, F_yr)):
            tyre = tyres[f"car_{file}.tir"]
            assert 2 * tyre.nominal_load == pytest.approx(load)
            assert tyre.at().force(alpha, load) == pytest.approx(force, rel=1e-6, abs=1e-6 * load)


@pytest.mark.parametrize("payload", [1.0, 1.1])
@pytest.mark.parametrize("share", [0.4, 1.0, 1.8])
def test_stiffness_and_friction_go_with_load_as_the_models_do(share, payload):
    meant, tyres = written({"load_sensitivity": 0.2, "mass_change": payload})
    tyre = tyres["car_front.tir"]
    here, there = tyre.at(), tyre.at(share * tyre.nominal_load)
    stated = float(meant.model["D_f"].array)
    assert pytest.approx(stated * (1 - 0.2 * (share * payload - 1)), rel=1e-9) == there.D
    assert pytest.approx(here.B * here.C * here.D, rel=1e-5) == there.B * there.C * there.D


def test_read_written_and_read_again_coefficients_are_identical(tmp_path):
    rng = np.random.default_rng(3)
    for _ in range(12):
        values = {
            "B_f": rng.uniform(3, 40),
            "C_f": rng.uniform(0.8, 2),
            "D_f": rng.uniform(0.2, 2),
            "E_f": rng.uniform(-3, 0.9),
        }
        _, tyres = written({}, **values)
        first = tyres["car_front.tir"].at()
        again = {f"{letter}_f": getattr(first, letter) for letter in "BCDE"}
        _, tyres = written({}, **again)
        second = tyres["car_front.tir"].at()
        assert (second.B, second.C, second.D, second.E) == (first.B, first.C, first.D, first.E)
        assert pytest.approx(values["B_f"], rel=1e-11) == first.B


def test_relaxation_length_is_held():
    _, tyres = written({"tyre_relaxation": 0.3})
    numbers = tyres["car_front.tir"].numbers
    assert numbers["PTY1"] * numbers["UNLOADED_RADIUS"] == pytest.approx(0.3, rel=1e-15)


def test_every_line_says_what_is_behind_it():
    meant, _ = written(EFFECTS)
    found = {origin.key: origin for origin in origins(meant) if origin.file == "car_front.tir"}
    assert found["PDY1"].behind == "D_f, grip_scale"
    assert found["PKY1"].behind == "B_f C_f D_f, front_stiffness, grip_scale"
    assert found["WIDTH"].why
    assert all(bool(own.behind) != bool(own.why) for own in found.values())


def test_what_cannot_be_held_is_said():
    meant, _ = written({"steering_delay": 0.03})
    assert "A tyre file has no entry for steering_delay, which is left out." in cautions(meant)


@pytest.mark.parametrize(
    ("name", "settings", "said"), [("single_track", {"tyre": "linear"}, "Pacejka's"), ("kinematic", {}, "no tyres")]
)
def test_other_tyres_are_refused(name, settings, said):
    with pytest.raises(BadInput, match=said):
        files(Subject(build(name, settings), "car", None))


def test_a_fit_with_the_error_of_its_form_is_held_as_the_nearest_formula_and_says_so():
    car = vehicle("full_size_car")
    model = build("single_track", {"form": "uncertain"}, {}, car)
    meant = Subject(
        model.with_parameters(model["curve_2_f"].with_value(0.04)), "car", None, source="a test", vehicle=car
    )
    plain = Subject(build("single_track", {}, {}, car), "car", None, source="a test", vehicle=car)
    assert any("form=uncertain" in line for line in cautions(meant))
    assert not any("form=uncertain" in line for line in cautions(plain))
    held, same = (parse_tyre_file(files(one)["car_front.tir"].decode(), "car_front.tir").at() for one in (meant, plain))
    alphas = np.linspace(-0.3, 0.3, 13)
    assert [held.force(a, 4000.0) for a in alphas] == pytest.approx([same.force(a, 4000.0) for a in alphas])
