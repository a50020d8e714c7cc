"""Parameter files: the published equations of their readers, with our numbers, move as our model does."""

import numpy as np
import pytest
import yaml
from calling import greybox
from exported import points, subject

from greybox_id.export.equations import Equations
from greybox_id.export.subject import Subject
from greybox_id.export.target_f1tenth import cautions, files
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.tyres import TYRES
from greybox_id.models.vehicle import Vehicle

G = 9.81
SMALL = Vehicle("small car", {name: Stated(value) for name, value in {
    "m": 3.5, "I_z": 0.05, "l_f": 0.16, "l_r": 0.17, "h_cg": 0.07, "C_alpha_f": 80.0, "C_alpha_r": 95.0,
}.items()}, steer_max=0.4)  # fmt: skip
HELD = {"mass_change": 1.2, "yaw_inertia": 0.8, "cog_shift": 0.01, "front_stiffness": 1.3, "grip_scale": 0.7}


def written(model, vehicle=SMALL, name="car"):
    made = files(Subject(model, name, source="a test", vehicle=vehicle))
    return {file: yaml.safe_load(text) for file, text in made.items()}


def of_the_gym(x, steer, acceleration, p):
    """f1tenth_gym's single track above 0.5 m/s: derivatives of yaw rate and sideslip at a speed, x = (v, r, beta)."""
    v, r, beta = x
    L = p["lf"] + p["lr"]
    front = p["C_Sf"] * (G * p["lr"] - acceleration * p["h"])
    rear = p["C_Sr"] * (G * p["lf"] + acceleration * p["h"])
    turning = (
        p["lf"] * front * (steer - beta) + p["lr"] * rear * beta - (p["lf"] ** 2 * front + p["lr"] ** 2 * rear) * r / v
    )
    across = front * (steer - beta) - rear * beta + (rear * p["lr"] - front * p["lf"]) * r / v
    return p["mu"] * p["m"] / (p["I"] * L) * turning, p["mu"] / (v * L) * across - r


def steady_yaw_rate(p, v, steer):
    """Where the gym's yaw rate settles at a speed."""
    at = np.array([of_the_gym((v, *own), s, 0.0, p) for *own, s in ([1, 0, 0], [0, 1, 0], [0, 0, 1])]).T
    return np.linalg.solve(at[:, :2], -at[:, 2] * steer)[0]


@pytest.mark.parametrize("effects", [{}, HELD], ids=["as it is", "with effects"])
@pytest.mark.parametrize("tyre", TYRES)
def test_the_gym_settles_at_our_yaw_rate(tyre, effects):
    model = build("lateral", {"tyre": tyre}, effects, SMALL)
    p, equations = written(model)["car_gym.yaml"], Equations(model)
    speed, steer = 4.0, 1e-8
    x, dt = np.zeros(2), 0.01
    for _ in range(300):
        x = np.array(equations.step(x, [steer, speed], model.values, dt)).ravel()
    assert x[1] == pytest.approx(steady_yaw_rate(p, speed, steer), rel=1e-6)


@pytest.mark.parametrize("tyre", TYRES)
def test_the_gyms_derivatives_are_ours_at_small_angles(tyre):
    model = build("lateral", {"tyre": tyre}, {}, SMALL)
    p, equations = written(model)["car_gym.yaml"], Equations(model)
    rng = np.random.default_rng(0)
    for v in (1.0, 3.0, 9.0):
        v_y, r, steer = 1e-11 * rng.standard_normal(3)
        r_dot, beta_dot = of_the_gym((v, r, v_y / v), steer, 0.0, p)
        found = np.array(equations.ode([v_y, r], [steer, v], model.values)).ravel()
        np.testing.assert_allclose(found, [v * beta_dot, r_dot], rtol=1e-8)


def test_our_wording_of_the_gyms_equations_is_commonroads():
    pytest.importorskip("vehiclemodels", reason="commonroad-vehicle-models is not installed; make test installs it")
    from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st
    from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

    car = setup_vehicle_parameters(2)
    C_S = -car.tire.p_ky1 / car.tire.p_dy1
    p = {
        "mu": car.tire.p_dy1,
        "C_Sf": C_S,
        "C_Sr": C_S,
        "lf": car.a,
        "lr": car.b,
        "h": car.h_s,
        "m": car.m,
        "I": car.I_z,
    }
    v, r, beta, steer, acceleration = 12.0, 0.2, 0.03, 0.05, 1.5
    theirs = vehicle_dynamics_st([0.0, 0.0, steer, v, 0.0, r, beta], [0.0, acceleration], car)
    np.testing.assert_allclose(of_the_gym((v, r, beta), steer, acceleration, p), theirs[5:7], rtol=1e-12)


@pytest.mark.parametrize("C_f", [0.8, 1.4])
@pytest.mark.parametrize("effects", [{}, HELD], ids=["as it is", "with effects"])
def test_the_race_stacks_tyres_pull_as_ours(effects, C_f):
    model = build("lateral", {"tyre": "pacejka"}, effects, SMALL).with_parameters()
    model = model.with_parameters(
        model["C_f"].with_value(C_f), model["E_f"].with_value(0.3), model["E_r"].with_value(-0.5)
    )
    made, equations = written(model), Equations(model)
    p = made["car_pacejka.txt"]
    x, u = points(equations, 50)
    u[:, 0], u[:, 1] = 0.0, 1.0 + np.abs(u[:, 1])

    def force(shape, alpha, load):
        B, C, D, E = shape
        return p["mu"] * load * D * np.sin(C * np.arctan(B * alpha - E * (B * alpha - np.arctan(B * alpha))))

    for (v_y, r), (_, v_x) in zip(x, u, strict=True):
        F_f = force(p["C_Pf"], -np.arctan((v_y + r * p["l_f"]) / v_x), p["m"] * G * p["l_r"] / p["l_wb"])
        F_r = force(p["C_Pr"], -np.arctan((v_y - r * p["l_r"]) / v_x), p["m"] * G * p["l_f"] / p["l_wb"])
        found = np.array(equations.ode([v_y, r], [0.0, v_x], model.values)).ravel()
        expected = [(F_f + F_r) / p["m"] - v_x * r, (p["l_f"] * F_f - p["l_r"] * F_r) / p["I_z"]]
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-9)
    assert [made["pacejka.yaml"][f"{letter}f"] for letter in "BCDE"] == p["C_Pf"]
    assert {"friction_coeff", "floor"} < set(made["pacejka.yaml"])


def test_limits_come_from_the_vehicle_file_and_from_effects():
    effects = {"steering_rate_limit": 2.5, "motor_saturation": 4.0, "steering_lag": 0.06}
    made = written(build("single_track", {}, effects, SMALL))
    gym = made["car_gym.yaml"]
    assert (gym["s_min"], gym["s_max"], gym["sv_min"], gym["sv_max"]) == (-0.4, 0.4, -2.5, 2.5)
    assert (gym["a_max"], gym["v_switch"]) == (4.0, 10.0)
    assert (made["car_model.yaml"]["tau_steer"], made["car_model.yaml"]["max_steering_velocity"]) == (0.06, 2.5)


GYM_KEYS = {"mu", "C_Sf", "C_Sr", "lf", "lr", "h", "m", "I", "s_min", "s_max", "sv_min", "sv_max", "v_switch", "a_max",
            "v_min", "v_max", "width", "length"}  # fmt: skip


def test_what_is_not_known_is_borrowed_for_small_cars_and_said():
    meant = Subject(build("single_track", {}, {}, SMALL), "car", vehicle=SMALL)
    text = files(meant)["car_gym.yaml"].decode()
    assert set(yaml.safe_load(text)) == GYM_KEYS
    assert "v_max: 20.0  # m/s, speed; value of f1tenth_gym's 1:10 car; not known for this vehicle" in text
    assert "s_max: 0.4  # rad, steering angle\n" in text
    assert any(
        "the values of f1tenth_gym's 1:10 car are used: sv_min, sv_max" in sentence for sentence in cautions(meant)
    )


def test_what_is_not_known_of_a_large_car_is_left_open():
    meant = subject(build("single_track"))
    text = files(meant)["car_gym.yaml"].decode()
    assert set(yaml.safe_load(text)) == {"mu", "C_Sf", "C_Sr", "lf", "lr", "h", "m", "I"}
    assert "# width:  # m\n" in text
    assert any("to be filled in for f1tenth_gym: s_min, s_max" in sentence for sentence in cautions(meant))


def test_what_the_files_cannot_hold_is_said_with_its_size():
    model = build("single_track", {}, {"steering_delay": 0.031, "steering_lag": 0.05, "mass_change": 1.1}, SMALL)
    model = model.with_parameters(model["S_h_f"].with_value(0.02))
    meant = Subject(model, "car", vehicle=SMALL)
    gone = "steering_delay 0.031 s, steering_lag 0.05 s, S_h_f 0.02 rad, which is left out."
    assert f"f1tenth_gym has no entry for {gone}" in cautions(meant)
    gone = "steering_delay 0.031 s, S_h_f 0.02 rad, which is left out."
    assert f"The ForzaETH race stack has no entry for {gone}" in cautions(meant)
    assert (
        "# This file has no entry for steering_delay 0.031 s, steering_lag 0.05 s"
        in files(meant)["car_gym.yaml"].decode()
    )


def test_a_cars_name_in_the_race_stack_has_no_underscore():
    assert written(build("lateral", {}, {}, SMALL), name="my_car")["mycar_pacejka.txt"]["model_name"] == "mycar"


def test_numbers_with_exponents_are_read_as_numbers():
    model = build("lateral", {}, {}, SMALL)
    model = model.with_parameters(model["I_z"].with_value(5e5), model["E_f"].with_value(-2e-7))
    made = written(model)
    assert made["car_gym.yaml"]["I"] == 5e5
    assert made["car_pacejka.txt"]["C_Pf"][3] == -2e-7


def test_the_command_takes_limits_from_the_vehicle_file_and_warns(tmp_path):
    asked = ("--vehicle", "roboracer", "--with", "steering_delay=31ms", "--target", "f1tenth")
    called = greybox("export", *asked, "--out", tmp_path / "car")
    assert called.code == 0
    assert "warning: f1tenth_gym has no entry for steering_delay 0.031 s, which is left out." in called.err
    assert yaml.safe_load((tmp_path / "car" / "car_gym.yaml").read_text())["s_max"] == 0.419
