"""The lateral model against linear theory, in python-control, and against the reference vehicle."""

import control
import numpy as np
import pytest
from linearised import matrices, outputs, rates, run, vector
from reference_vehicle import FULL_SIZE_CAR, RACER, simulate_lateral

from greybox_id.models.single_track import lateral, single_track
from greybox_id.models.tyres import TYRES

CARS = {
    "understeering": {"m": 1457.2, "I_z": 2274.0, "l_f": 1.296, "l_r": 1.465, "C_f": 90e3, "C_r": 105e3},
    "neutral": {"m": 1500.0, "I_z": 2500.0, "l_f": 1.4, "l_r": 1.4, "C_f": 100e3, "C_r": 100e3},
    "oversteering": {"m": 982.0, "I_z": 1600.0, "l_f": 1.33, "l_r": 1.07, "C_f": 90e3, "C_r": 70e3},
    "1:10": {"m": 3.5, "I_z": 0.05, "l_f": 0.16, "l_r": 0.17, "C_f": 75.0, "C_r": 77.0},
}


def bicycle(v, m, I_z, l_f, l_r, C_f, C_r):
    """Closed-form bicycle from steer to v_y, yaw rate and a_y (Rajamani, 2nd ed., Sec. 2.3)."""
    n_1, n_2 = l_f * C_f - l_r * C_r, l_f**2 * C_f + l_r**2 * C_r
    A = np.array([[-(C_f + C_r) / (m * v), -v - n_1 / (m * v)], [-n_1 / (I_z * v), -n_2 / (I_z * v)]])
    B = np.array([[C_f / m], [l_f * C_f / I_z]])
    C = np.array([[1.0, 0.0], [0.0, 1.0], [A[0, 0], A[0, 1] + v]])
    return control.ss(A, B, C, [[0.0], [0.0], [C_f / m]])


def understeer_gradient(m, I_z, l_f, l_r, C_f, C_r):
    return m / (l_f + l_r) * (l_r / C_f - l_f / C_r)


def linearised(car, v, tyre="linear"):
    model = lateral(TYRES[tyre])
    body = {name: car[name] for name in ("m", "I_z", "l_f", "l_r")}
    p = vector(model, **body, C_alpha_f=car["C_f"], C_alpha_r=car["C_r"])
    return control.ss(*matrices(model, [0.0, 0.0], "steer", p=p, v_x=v))


@pytest.mark.parametrize("v", [0.5, 5.0, 20.0])
@pytest.mark.parametrize("tyre", ["linear", "dugoff", "brush"])
@pytest.mark.parametrize("car", CARS)
def test_frequency_response_is_that_of_the_closed_form_bicycle(car, tyre, v):
    omega = np.append(0.0, np.logspace(-1, 2, 50))
    ours = linearised(CARS[car], v, tyre).frequency_response(omega).frdata
    theory = bicycle(v, **CARS[car]).frequency_response(omega).frdata
    assert np.allclose(ours, theory, rtol=1e-9, atol=1e-9)


def test_an_oversteering_car_is_unstable_above_its_critical_speed():
    car = CARS["oversteering"]
    critical = np.sqrt(-(car["l_f"] + car["l_r"]) / understeer_gradient(**car))
    assert np.all(linearised(car, 0.99 * critical).poles().real < 0)
    assert np.any(linearised(car, 1.01 * critical).poles().real > 0)


@pytest.mark.parametrize("tyre", TYRES)
def test_reported_stiffness_and_understeer_gradient_are_those_of_the_linearised_model(tyre):
    model = lateral(TYRES[tyre])
    named = {parameter.name: float(parameter.array) for parameter in model.parameters}
    p = type("p", (), named)
    told = {combination.name: float(combination.of(p)) for combination in model.combinations}
    gain = control.ss(*matrices(model, [0.0, 0.0], "steer", v_x=20.0)).dcgain().ravel()[1]
    assert gain == pytest.approx(20.0 / (told["l_f + l_r"] + told["K_us"] * 400), rel=1e-9)


@pytest.mark.parametrize("tyre", TYRES)
def test_it_is_the_single_track_model_at_a_given_speed(tyre):
    """The same v_y, yaw rate and a_y from the same motion, where nothing drives or brakes."""
    whole, part = single_track(TYRES[tyre]), lateral(TYRES[tyre])
    given, z = {"steer": 0.05}, [0.4, -0.2]
    full = {**rates(whole, [18.0, *z], drive=0.0, **given), **outputs(whole, [18.0, *z], drive=0.0, **given)}
    own = {**rates(part, z, v_x=18.0, **given), **outputs(part, z, v_x=18.0, **given)}
    assert set(own) == {"v_y", "yaw_rate", "a_y"}
    assert all(own[name] == pytest.approx(full[name], rel=1e-12) for name in own)


@pytest.mark.parametrize("tyre", TYRES)
@pytest.mark.parametrize(("car", "v", "steer"), [(FULL_SIZE_CAR, 25.0, 0.06), (RACER, 3.0, 0.2)])
def test_a_step_steer_near_the_limit_is_that_of_the_reference_vehicle(car, v, steer, tyre):
    model = lateral(TYRES[tyre])
    names = [parameter.name for parameter in model.parameters]
    L = car["l_f"] + car["l_r"]
    load = {"f": car["m"] * 9.81 * car["l_r"] / L, "r": car["m"] * 9.81 * car["l_f"] / L}
    slopes = {f"C_alpha_{s}": car[f"B_{s}"] * car[f"C_{s}"] * car[f"D_{s}"] * load[s] for s in "fr"}
    stated = {**car, **slopes, "mu_f": car["D_f"], "mu_r": car["D_r"]}
    p = vector(model, **{name: stated[name] for name in names if name in stated})
    time = np.arange(51) * 0.01
    reference = simulate_lateral(
        car, {"time": time, "steer": np.full(51, steer), "v_x": np.full(51, v)}, tyre=tyre, fine=1e-3
    )
    start = [reference["v_y"][0], reference["yaw_rate"][0]]
    found = run(model, start, 500, 1e-3, p=p, v_x=v, steer=steer)[::10]
    assert np.allclose(found[:, 0], reference["v_y"], atol=1e-5)
    assert np.allclose(found[:, 1], reference["yaw_rate"], atol=1e-5)
