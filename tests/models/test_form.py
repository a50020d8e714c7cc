"""What the form of a single track's equations leaves open."""

import json

import numpy as np
import pytest
from linearised import rates, vector

from greybox_id.errors import BadInput
from greybox_id.models.form import CURVE_SD, KNOTS
from greybox_id.models.registry import build
from greybox_id.models.roughness import with_roughness
from greybox_id.models.tyres import TYRES, axle
from greybox_id.vehicle import Stated, Vehicle

TURNING = (12.0, -0.3, 0.5)
"""v_x, v_y and yaw rate of a turn to the left."""
CURVES = [name for name in TYRES if name != "linear"]


def forces(model, z=TURNING, steer=0.1, **given):
    """F_yf (along the car's y) and F_yr."""
    p = {own.name: float(own.array) for own in model.parameters if own.shape == ()}
    found = rates(model, z, p=vector(model, **given), steer=steer, drive=0.0)
    across, turning = p["m"] * (found["v_y"] + z[2] * z[0]), found["yaw_rate"] * p["I_z"]
    L = p["l_f"] + p["l_r"]
    return (p["l_r"] * across + turning) / L, (p["l_f"] * across - turning) / L


@pytest.mark.parametrize("tyre", CURVES)
@pytest.mark.parametrize("name", ["single_track", "lateral"])
def test_numbers_of_the_form_have_priors_about_none_and_leave_the_equations_alone_there(name, tyre):
    exact, model = build(name, {"tyre": tyre}), build(name, {"tyre": tyre, "form": "uncertain"})
    own = [p for p in model.parameters if p.name not in exact and not p.fixed]
    assert len(own) == 2 * KNOTS + 2
    assert all(float(p.array) == 0.0 and p.prior is not None for p in own)
    if name == "single_track":
        assert rates(model, TURNING, steer=0.1, drive=0.5) == rates(exact, TURNING, steer=0.1, drive=0.5)


def test_it_is_rebuilt_from_its_settings_as_json():
    model = build("single_track", {"form": "uncertain", "drive": "motor"})
    assert build("single_track", json.loads(json.dumps(dict(model.settings)))).parameters == model.parameters


def test_an_error_of_the_curve_is_that_share_of_the_load_at_its_slip_and_none_at_its_neighbours():
    car = Vehicle("car", {n: Stated(v) for n, v in {"m": 1450.0, "l_f": 1.3, "l_r": 1.46, "B_r": 10.0, "C_r": 1.4,
                                                   "D_r": 1.0}.items()})  # fmt: skip
    model = build("single_track", {"form": "uncertain"}, vehicle=car)
    assert float(model["curve_slip_r"].array) == pytest.approx(1 / 14)
    load = 1450.0 * 9.81 * 1.3 / 2.76
    for k in range(1, KNOTS + 1):
        alpha = np.tan(0.5 * np.pi * k / (KNOTS + 1)) / 14
        z = (20.0, -20.0 * np.tan(alpha), 0.0)
        _, before = forces(model, z)
        for other in range(1, KNOTS + 1):
            _, after = forces(model, z, **{f"curve_{other}_r": 0.02})
            expected = 0.02 * load if other == k else 0.0
            assert after - before == pytest.approx(expected, abs=1e-6 * load)
            _, left = forces(model, (z[0], -z[1], 0.0), **{f"curve_{other}_r": 0.02})
            _, none = forces(model, (z[0], -z[1], 0.0))
            assert left - none == pytest.approx(-expected, abs=1e-6 * load)


def test_the_slope_at_no_slip_is_the_formulas():
    model = build("single_track", {"form": "uncertain"})
    everywhere = {f"curve_{k}_{axle}": 0.05 for k in range(1, KNOTS + 1) for axle in "fr"}
    z = (20.0, -20.0 * 1e-5, 0.0)
    assert forces(model, z, steer=0.0, **everywhere)[1] == pytest.approx(forces(model, z, steer=0.0)[1], rel=1e-3)


def test_formulas_of_one_slope_and_one_peak_differ_by_as_much_as_a_curve_is_uncertain():
    """Between 0.3 and 2 of the slip of the peak, spread about their mean over the peak, root mean square."""
    slope, peak = 14.0, 1.0
    alphas = np.linspace(0.3, 2.0, 30) * peak / slope
    own = {
        "pacejka": {"B_f": slope / 1.4, "C_f": 1.4, "D_f": peak, "E_f": 0.0, "S_h_f": 0.0, "S_v_f": 0.0},
        "brush": {"C_alpha_f": slope, "mu_f": peak}, "dugoff": {"C_alpha_f": slope, "mu_f": peak},
    }  # fmt: skip
    from types import SimpleNamespace

    curves = np.array([
        [float(TYRES[name].force(a, 1.0, axle(SimpleNamespace(**p), "f"), 1.0, 1.0)) for a in alphas]
        for name, p in own.items()
    ])  # fmt: skip
    spread = np.sqrt(np.mean((curves - curves.mean(axis=0)) ** 2))
    assert spread == pytest.approx(CURVE_SD, rel=0.25)


@pytest.mark.parametrize("steer", [0.15, -0.15])
def test_steered_alike_the_loaded_outer_wheel_slips_more_than_the_axle(steer):
    """Two wheels where they stand, slips and loads written out; the axle's slip is their mean weighed by loads."""
    model = build("single_track", {"form": "uncertain"})
    p = {own.name: float(own.array) for own in model.parameters if own.shape == ()}
    L = p["l_f"] + p["l_r"]
    v, side = 12.0, np.sign(steer)
    yaw_rate = v * np.tan(steer) / L
    transfer = 0.55 * p["m"] * v * yaw_rate * p["h_cg"] / p["track_f"]
    load = p["m"] * 9.81 * p["l_r"] / L
    slips = [steer - np.arctan2(p["l_f"] * yaw_rate + p["l_r"] * yaw_rate, v + s * 0.5 * p["track_f"] * yaw_rate)
             for s in (-1, 1)]  # fmt: skip
    weighed = sum((0.5 + s * transfer / load) * own for s, own in zip((-1, 1), slips, strict=True))
    middle = steer - np.arctan2(L * yaw_rate, v)
    z = (v, p["l_r"] * yaw_rate, yaw_rate)
    before, after = (forces(model, z, steer, parallel_steering=k)[0] for k in (0.0, 1.0))
    slope = (forces(model, (v, z[1] - 1e-6 * v, yaw_rate), steer)[0] - before) / 1e-6
    assert (weighed - middle) * side > 0
    assert (after - before) / slope == pytest.approx(weighed - middle, rel=0.15)


def test_what_does_not_go_together_is_a_sentence():
    for settings, words in (
        ({"form": "sure"}, "exact or uncertain"),
        ({"form": "uncertain", "tyre": "linear"}, "linear"),
    ):
        with pytest.raises(BadInput, match=words):
            build("single_track", settings)


def test_a_diagnosis_does_not_add_what_the_form_has_already():
    stated = Vehicle("car", {"B_f": Stated(10.0, 0.2), "C_f": Stated(1.4, 0.01)})
    model = build("single_track", {"form": "uncertain"}, vehicle=stated)
    rough = with_roughness(model, stated, {"speed": 15.0, "steer": 0.1, "drive": 2.0})
    assert "steered_wheels" not in rough.effects
