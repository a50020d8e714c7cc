"""The single-track model against the one of CommonRoad, with matched tyres at small angles.

CommonRoad's "ST" (Althoff & Wuersching, CommonRoad: Vehicle Models, 2020) has F_y = mu C_S F_z alpha with slip angles
linear in the sideslip angle beta, loads that a_x shifts by h / L, and states speed and beta in place of v_x and v_y. To
first order in angles that is ours with tyres of that slope. Two differences remain and are left out of the comparison:

- d(beta)/dt = a_y / v - yaw_rate leaves out -beta dv/dt / v; we compare a_y = v (d(beta)/dt + yaw_rate), free of it;
- below 0.1 m/s it turns into a kinematic model of its own.
"""

import numpy as np
import pytest
from driving import read
from linearised import outputs, rates, run, vector
from scipy.integrate import solve_ivp

from greybox_id.base.errors import BadInput
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build
from greybox_id.models.single_track import single_track
from greybox_id.models.tyres import TYRES

pytest.importorskip("vehiclemodels", reason="commonroad-vehicle-models is not installed; make test installs it")
from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st
from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

G = 9.81
SMALL = 1e-6  # rad


def matched(number, tyre, effects=()):
    """CommonRoad's vehicle, and ours with the same numbers and tyres of the same slope."""
    theirs = setup_vehicle_parameters(number)
    mu, C_S = theirs.tire.p_dy1, -theirs.tire.p_ky1 / theirs.tire.p_dy1
    m, a, b = theirs.m, theirs.a, theirs.b
    load = {"f": m * G * b / (a + b), "r": m * G * a / (a + b)}
    model = single_track(TYRES[tyre])
    for effect in effects:
        model = model + EFFECTS[effect].at(1.0)
    tyres = {
        f"{letter}_{s}": value
        for s in "fr"
        for letter, value in {"C_alpha": mu * C_S * load[s], "mu": mu, "B": C_S / 1.4, "C": 1.4, "D": mu}.items()
    }
    body = {"m": m, "I_z": theirs.I_z, "l_f": a, "l_r": b, "h_cg": theirs.h_s, "c_0": 0.0, "c_1": 0.0, "c_2": 0.0}
    drive = {"force_per_unit": m, "drive_split_front": 0.0, "brake_split_front": 0.0}  # no forces where wheels steer
    stated = {**body, **drive, **tyres}
    return theirs, model, vector(model, **{name: value for name, value in stated.items() if name in model})


def both(number, tyre, v, a_x=0.0, effects=(), scale=SMALL):
    """Lateral and yaw acceleration, theirs and ours, at angles of size `scale`."""
    theirs, model, p = matched(number, tyre, effects)
    steer, beta, yaw_rate = scale, -0.4 * scale, 0.3 * scale * v
    f = vehicle_dynamics_st([0.0, 0.0, steer, v, 0.0, yaw_rate, beta], [0.0, a_x], theirs)
    z = [v * np.cos(beta), v * np.sin(beta), yaw_rate]
    given = {"p": p, "steer": steer, "drive": a_x}
    ours = [outputs(model, z, **given)["a_y"], rates(model, z, **given)["yaw_rate"]]
    return np.array([v * (f[6] + yaw_rate), f[5]]), np.array(ours)


@pytest.mark.parametrize("v", [1.0, 10.0, 40.0])
@pytest.mark.parametrize("tyre", TYRES)
@pytest.mark.parametrize("number", [1, 2, 3])
def test_accelerations_are_commonroads_at_small_angles(number, tyre, v):
    theirs, ours = both(number, tyre, v)
    assert np.allclose(ours, theirs, rtol=1e-4 if tyre == "brush" else 1e-8)  # the brush bends from the very start


def test_what_differs_is_of_third_order_in_the_angles():
    """Odd functions of the angles: ten times the angles, a thousand times the difference."""
    differences = [np.abs(np.subtract(*both(2, "linear", 20.0, scale=scale))) for scale in (1e-3, 1e-2)]
    assert np.allclose(differences[1] / differences[0], 1e3, rtol=0.05)


@pytest.mark.parametrize("a_x", [-6.0, 2.0])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_load_transfer_is_commonroads_with_the_effect_of_that_name(number, a_x):
    theirs, ours = both(number, "pacejka", 20.0, a_x, ("longitudinal_load_transfer",))
    assert np.allclose(ours, theirs, rtol=1e-6)
    assert not np.allclose(both(number, "pacejka", 20.0, a_x)[1], theirs, rtol=1e-2)


def test_a_gentle_step_steer_is_commonroads():
    theirs, model, p = matched(2, "linear")
    steer, v, time = 2e-3, 20.0, np.arange(151) * 0.02

    def f(t, x):
        return vehicle_dynamics_st(x, [0.0, 0.0], theirs)

    x = solve_ivp(f, (0, 3), [0.0, 0.0, steer, v, 0.0, 0.0, 0.0], t_eval=time, rtol=1e-10, atol=1e-12).y
    z = run(model, [v, 0.0, 0.0], 1500, 0.002, p=p, steer=steer, drive=0.0)[::10]
    assert np.allclose(z[:, 2], x[5], atol=1e-3 * np.abs(x[5]).max())
    assert np.allclose(z[:, 1], v * np.sin(x[6]), atol=1e-3 * v * np.abs(x[6]).max())


def test_a_motor_gives_what_its_dead_band_and_its_back_emf_leave():
    model = build("single_track", {"drive": "motor"})
    numbers = {"force_per_unit": 25.0, "motor_damping": 5.0, "dead_band": 0.2}
    for throttle, v_x, force in ((0.1, 1.0, 0.0), (0.5, 2.0, 0.3 * 15), (0.5, 0.0, 0.3 * 25), (-0.6, 2.0, -0.4 * 25)):
        found = read(model, ("drive_force",), {"v_x": v_x}, {"steer": 0.0, "drive": throttle}, **numbers)
        assert found["drive_force"] == pytest.approx(force)


def test_a_motor_without_dead_band_and_back_emf_is_the_linear_drive():
    linear, motor = build("single_track"), build("single_track", {"drive": "motor"})
    assert "dead_band" not in linear
    assert linear.settings == {"tyre": "pacejka"}
    for drive in (-0.7, 0.0, 0.3):
        states, inputs = {"v_x": 12.0, "v_y": 0.3, "yaw_rate": 0.2}, {"steer": 0.05, "drive": drive}
        assert read(linear, ("a_x", "a_y"), states, inputs) == read(motor, ("a_x", "a_y"), states, inputs)


def test_an_unknown_drive_is_refused():
    with pytest.raises(BadInput, match="no drive 'engine'; choose one of linear, motor"):
        build("single_track", {"drive": "engine"})
