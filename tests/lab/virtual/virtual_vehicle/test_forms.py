"""Other functional forms: as good a description of the same vehicle, and effects mean the same in them."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_lab.virtual.virtual_vehicle import Forms, drive, random_vehicle, replay
from greybox_lab.virtual.virtual_vehicle.effects import complete
from greybox_lab.virtual.virtual_vehicle.record import CHOICES, EFFECTS_ALREADY, FAR_OFF, NOMINAL, other, record
from greybox_lab.virtual.virtual_vehicle.tyres import curve

SINGLE = [(what, choice) for what, choices in CHOICES.items() for choice in choices[1:]]
EVERYTHING = {
    "tyre_relaxation": 0.3, "combined_slip": 0.7, "load_sensitivity": 0.15, "tyre_temperature": 0.2,
    "steering_lag": 0.04, "steering_rate_limit": 0.5, "steering_backlash": 0.003, "motor_saturation": 1.8,
    "roll_dynamics": 0.004, "wind_gust": 6.0, "wind_direction": 1.0, "sensor_latency_imu": 0.02,
}  # fmt: skip


def driven(forms, effects=None, seconds=15.0):
    car = random_vehicle(12, "car")
    recording, truth = drive(car, "mixed", seconds, seed=3, noise=0.0)
    start = {name: float(truth.states[name][0]) for name in ("v_x", "v_y", "yaw_rate")}
    return replay(car, recording, start, effects or {}, forms)[1].readings


@pytest.mark.parametrize(("what", "choice"), SINGLE)
def test_each_form_is_near_that_of_models_and_not_the_same(what, choice):
    plain, found = driven(NOMINAL, EVERYTHING), driven(Forms(**{what: choice}), EVERYTHING)
    off = {name: np.sqrt(np.mean((found[name] - plain[name]) ** 2)) / np.std(plain[name]) for name in plain}
    assert max(off.values()) > 1e-5
    assert max(off["yaw_rate"], off["a_y"]) < 0.12


@pytest.mark.parametrize("tyre", CHOICES["tyre"][1:])
@pytest.mark.parametrize("kind", ["racer", "car", "truck", "sports"])
def test_tyres_are_laid_on_the_magic_formula(tyre, kind):
    """At a given slip, within a few percent of the peak force."""
    car = random_vehicle(31, kind)
    _, truth = drive(car, "laps", 15.0, forms=Forms(tyre=tyre), seed=1, noise=0.0)
    p, states = car.parameters, truth.states
    for axle, wheels in (("f", ("fl", "fr")), ("r", ("rl", "rr"))):
        slip = p[f"B_{axle}"] * states[f"alpha_{wheels[0]}"]
        bent = slip - p[f"E_{axle}"] * (slip - np.arctan(slip))
        load = sum(states[f"F_z_{wheel}"] for wheel in wheels)
        nominal = p[f"D_{axle}"] * load * np.sin(p[f"C_{axle}"] * np.arctan(bent))
        most = 0.1 if tyre in FAR_OFF["tyre"] else 0.05
        assert np.max(np.abs(states[f"F_y{axle}"] - nominal)) < most * p[f"D_{axle}"] * np.mean(load)


@pytest.mark.parametrize("tyre", CHOICES["tyre"][1:])
@pytest.mark.parametrize("kind", ["racer", "car", "truck", "sports"])
def test_cornering_stiffness_and_friction_are_those_that_are_stated(tyre, kind):
    """Otherwise a mere form would be an effect, front_stiffness or front_grip."""
    car = random_vehicle(31, kind)
    p, effects = car.parameters, complete({}, car.size)
    one = record(car, effects, Forms(tyre=tyre))
    for axle in "fr":
        slips = np.array([1e-6, *np.linspace(0.02, 1.0, 300)])
        shares = np.array([curve(one, axle == "f", alpha, 1.0) for alpha in slips])
        assert shares[0] / slips[0] == pytest.approx(p[f"B_{axle}"] * p[f"C_{axle}"], rel=0.031)
        assert np.max(shares) == pytest.approx(1.0, abs=0.03)


def test_another_form_of_everything_is_drawn_but_of_what_is_an_effect_by_name():
    drawn = other(np.random.default_rng(1))
    for what, choices in CHOICES.items():
        assert (getattr(drawn, what) == choices[0]) == (what in EFFECTS_ALREADY)
    assert "dugoff" not in {other(np.random.default_rng(k)).tyre for k in range(40)}
    _, truth = drive(random_vehicle(2), duration=2.0, forms="other", seed=4)
    assert truth.forms != NOMINAL
    with pytest.raises(BadInput, match="one of"):
        Forms(tyre="square")
    with pytest.raises(BadInput, match="not"):
        drive(random_vehicle(2), duration=2.0, forms="strange")


def test_a_lag_of_second_order_is_as_late_as_one_of_first():
    car = random_vehicle(12, "car")
    time = np.arange(300) / 100.0
    ramp = Recording("ramp", time, {"steer": 0.01 * time, car.drive_channel: np.zeros(300)})
    for form in ("first_order", "second_order"):
        _, truth = replay(car, ramp, {"v_x": 20.0}, {"steering_lag": 0.05}, Forms(steering_lag=form))
        assert 0.01 * time[-1] - truth.states["steer"][-1] == pytest.approx(0.01 * (0.05 + 0.005), rel=0.12)


def test_rotating_wheels_carry_the_force_that_is_asked_for():
    found, plain = (driven(forms) for forms in (Forms(wheels="rotating"), NOMINAL))
    for name, most in {"v_x": 0.02, "yaw_rate": 0.01, "a_x": 0.1}.items():
        assert np.sqrt(np.mean((found[name] - plain[name]) ** 2)) < most * np.std(plain[name])


@pytest.mark.parametrize("kind", ["racer", "car", "truck"])
def test_rotating_wheels_add_nothing_to_the_mass(kind):
    car = random_vehicle(12, kind)
    rows = 400
    pulse = 0.3 * np.sin(2 * np.pi * np.arange(rows) / 100.0) * car.size.drive * car.parameters["m"]
    given = Recording(
        "straight", np.arange(rows) / 100.0,
        {"steer": np.zeros(rows), car.drive_channel: pulse / car.parameters["force_per_unit"]},
    )  # fmt: skip
    start = {"v_x": 0.5 * car.size.top_speed}
    found, plain = (
        replay(car, given, start, {}, forms)[1].states["v_x"] for forms in (Forms(wheels="rotating"), NOMINAL)
    )
    moved, asked = found - np.mean(found), plain - np.mean(plain)
    assert np.sum(moved * asked) / np.sum(asked**2) == pytest.approx(1.0, abs=0.003)


@pytest.mark.parametrize("steer", [0.2, -0.2])
def test_the_inner_front_wheel_is_steered_further(steer):
    car = random_vehicle(12, "racer")
    turn = Recording("turn", np.arange(200) / 100.0, {"steer": np.full(200, steer), car.drive_channel: np.zeros(200)})
    states = replay(car, turn, {"v_x": 2.0}, {}, Forms(geometry="each_wheel"))[1].states
    p, across = car.parameters, states["v_y"] + car.parameters["l_f"] * states["yaw_rate"]
    along = {side: states["v_x"] - sign * states["yaw_rate"] * p["track_f"] / 2 for side, sign in (("l", 1), ("r", -1))}
    left, right = (states[f"alpha_f{side}"] + np.arctan2(across, along[side]) for side in "lr")
    halfway = 0.5 * p["track_f"] / (p["l_f"] + p["l_r"]) * steer**2
    np.testing.assert_allclose((left - right)[100:], halfway, rtol=0.02)
    np.testing.assert_allclose((left + right)[100:] / 2, steer, rtol=0.01)
