"""What the form of a single track's equations leaves open."""

import json

import numpy as np
import pytest
from linearised import rates, segment, vector

from greybox_id.base.errors import BadInput
from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.models.form import CURVE_SD, KNOTS
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.roughness import with_roughness
from greybox_id.models.tyres import TYRES, axle
from greybox_id.models.vehicle import Vehicle

TURNING = (12.0, -0.3, 0.5)
"""v_x, v_y and yaw rate of a turn to the left."""
CURVES = [name for name in TYRES if name != "linear"]


def forces(model, z=TURNING, steer=0.1, **given):
    """F_yf (along the car's y) and F_yr."""
    p = {parameter.name: float(parameter.array) for parameter in model.parameters if parameter.shape == ()}
    found = rates(model, z, p=vector(model, **given), steer=steer, drive=0.0)
    across, turning = p["m"] * (found["v_y"] + z[2] * z[0]), found["yaw_rate"] * p["I_z"]
    L = p["l_f"] + p["l_r"]
    return (p["l_r"] * across + turning) / L, (p["l_f"] * across - turning) / L


@pytest.mark.parametrize("tyre", CURVES)
@pytest.mark.parametrize("name", ["single_track", "lateral"])
def test_numbers_of_the_form_have_priors_and_leave_the_equations_alone_at_none(name, tyre):
    exact, model = build(name, {"tyre": tyre}), build(name, {"tyre": tyre, "form": "uncertain"})
    own = [p for p in model.parameters if p.name not in exact and not p.fixed]
    assert len(own) == 2 * KNOTS + 3
    assert all(p.prior is not None for p in own)
    if name == "single_track":
        p = vector(model, steered_wheels=0.0, turning_wheels=0.0)
        assert rates(model, TURNING, p=p, steer=0.1, drive=0.5) == rates(exact, TURNING, steer=0.1, drive=0.5)


def test_it_is_rebuilt_from_its_settings_as_json():
    model = build("single_track", {"form": "uncertain", "drive": "motor"})
    assert build("single_track", json.loads(json.dumps(dict(model.settings)))).parameters == model.parameters


def sliding(model, slips, **given):
    """F_yr over F_z at these slips, in units of the rear curve's own."""
    p = {parameter.name: float(parameter.array) for parameter in model.parameters if parameter.shape == ()}
    load = p["m"] * 9.81 * p["l_f"] / (p["l_f"] + p["l_r"])
    v_y = [-20.0 * np.tan(s * p["curve_slip_r"]) for s in slips]
    z = np.stack([np.full(len(v_y), 20.0), v_y, np.zeros(len(v_y))])
    found = np.array(MotionTrace(model).rates(z, segment(model), vector(model, turning_wheels=0.0, **given)))
    return (p["l_f"] * p["m"] * found[1] - p["I_z"] * found[2]) / (p["l_f"] + p["l_r"]) / load


def test_an_error_of_the_curve_is_odd_and_a_bump_less_what_slope_and_peak_would_make_of_it():
    """Fitted to a magic formula with one more share of the friction after the other, the error leaves B and D alone."""
    car = {"m": 1450.0, "l_f": 1.3, "l_r": 1.46, "B_r": 10.0, "C_r": 1.4, "D_r": 1.0}
    model = build("single_track", {"form": "uncertain"}, vehicle=Vehicle("car", {n: Stated(v) for n, v in car.items()}))
    assert float(model["curve_slip_r"].array) == pytest.approx(1 / 14)
    shares = (np.arange(60) + 0.5) / 60
    slips = 1.4 * np.tan(np.arcsin(shares) / 1.4)
    base = sliding(model, slips)
    assert base == pytest.approx(shares, rel=1e-6)
    J = np.stack([sliding(model, slips, **{name: 1.001 * car[name]}) - base for name in ("B_r", "D_r")], axis=1) / 1e-3
    for k in range(1, KNOTS + 1):
        error = sliding(model, slips, **{f"curve_{k}_r": 0.02}) - base
        assert sliding(model, -slips, **{f"curve_{k}_r": 0.02}) == pytest.approx(-(base + error), abs=1e-9)
        moved = np.linalg.lstsq(J, error, rcond=None)[0]
        assert np.abs(moved).max() < 0.03 * 0.02
        bump = sliding(model, [np.tan(0.5 * np.pi * k / (KNOTS + 1))], **{f"curve_{k}_r": 0.02})
        assert bump > sliding(model, [np.tan(0.5 * np.pi * k / (KNOTS + 1))])


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


@pytest.mark.parametrize("ackermann", [0.0, 1.0])
@pytest.mark.parametrize("steer", [0.15, -0.15])
def test_wheels_slip_where_they_stand_and_weigh_as_their_loads_and_the_outer_front_one_turns_the_car_back(
    steer, ackermann
):
    """Four wheels written out; the force of an axle is that at the mean slip of its wheels, along their mean angle."""
    model = build("single_track", {"form": "uncertain"})
    given = {"ackermann": ackermann, "steered_wheels": 1.0, "turning_wheels": 0.03}
    p = {parameter.name: float(parameter.array) for parameter in model.parameters if parameter.shape == ()} | given
    L, side, v_x = p["l_f"] + p["l_r"], np.sign(steer), 12.0
    v_y, yaw_rate = -0.2 * side, 0.4 * side
    force, toe, weights = {}, 0.5 * p["track_f"] * ackermann * steer**2 / L, {}
    for axle_, share, x, other in (("f", 0.55, p["l_f"], p["l_r"]), ("r", 0.45, -p["l_r"], p["l_f"])):
        load, track = p["m"] * 9.81 * other / L, p[f"track_{axle_}"]
        right = share * p["m"] * v_x * yaw_rate * p["h_cg"] / track / load
        weights[axle_] = np.array([0.5 - right, 0.5 + right])
        angles = steer + toe * np.array([1, -1]) if axle_ == "f" else np.zeros(2)
        y = 0.5 * track * np.array([1, -1])
        slip = weights[axle_] @ (angles - np.arctan2(v_y + x * yaw_rate, v_x - y * yaw_rate))
        B, C, D, E = (p[f"{letter}_{axle_}"] for letter in "BCDE")
        force[axle_] = load * D * np.sin(C * np.arctan(B * slip - E * (B * slip - np.arctan(B * slip))))
    middle = weights["f"] @ (steer + toe * np.array([1, -1]))
    along = force["f"] * np.cos(middle)
    right = 0.55 * sum(force.values()) * p["h_cg"] / p["track_f"] / (p["m"] * 9.81 * p["l_r"] / L)
    turning = p["l_f"] * along - p["l_r"] * force["r"]
    turning += 0.5 * p["track_f"] * force["f"] * (
        (0.5 - right) * np.sin(steer + toe) - (0.5 + right) * np.sin(steer - toe)
    )  # fmt: skip
    found = rates(model, (v_x, v_y, yaw_rate), p=vector(model, **given), steer=steer, drive=0.0)
    resisting = p["I_z"] + 0.03 * p["m"] * p["track_f"] * p["track_r"] / 4
    # the moment takes the wheels' angles about their mean in place of the steering's: second order in toe
    assert found["yaw_rate"] == pytest.approx(turning / resisting, rel=max(ackermann * 5e-3, 1e-9))
    assert found["v_y"] + yaw_rate * v_x == pytest.approx((along + force["r"]) / p["m"], rel=1e-6)


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
