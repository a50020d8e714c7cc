"""The longitudinal model against formulas: the paper's, coasting down, slopes, brakes and lag."""

import numpy as np
import pytest
from linearised import outputs, rates, run, vector
from reference_vehicle import FULL_SIZE_CAR, simulate

from greybox_id.models.effects import EFFECTS
from greybox_id.models.longitudinal import effective_mass
from greybox_id.models.registry import build

MODEL = build("longitudinal")
CAR = {"m": 1457.2, "c_0": 208.0, "c_1": 3.0, "c_2": 0.45, "force_per_unit": 1457.2, "I_w": 1.2, "wheel_radius": 0.32}
WHEELS = 4 * CAR["I_w"] / CAR["wheel_radius"] ** 2


def test_acceleration_is_that_of_the_paper():
    """Mungiello et al., Eq. 12 with T = F r, c_r = c_0 / (m g), on a slope; straight ahead, so without F_yf."""
    v, drive, slope, r = 14.0, 1.3, 0.04, CAR["wheel_radius"]
    T_t = CAR["force_per_unit"] * drive * r
    c_r = CAR["c_0"] / (CAR["m"] * 9.81)
    N = (T_t / r - CAR["c_2"] * v**2 - CAR["c_1"] * v) / CAR["m"] - c_r * 9.81 * np.cos(slope) - 9.81 * np.sin(slope)
    D = 1 + 2 * (CAR["I_w"] + CAR["I_w"]) / (CAR["m"] * r**2)
    given = {"p": vector(MODEL, **CAR), "drive": drive, "road_slope": slope}
    assert rates(MODEL, [v, drive], **given)["v_x"] == pytest.approx(N / D, rel=1e-12)
    assert outputs(MODEL, [v, drive], **given)["a_x"] == pytest.approx(N / D + 9.81 * np.sin(slope), rel=1e-12)


def test_coasting_down_follows_its_closed_form():
    """m dv/dt = -(c_0 + c_2 v^2) has v = sqrt(c_0 / c_2) tan(phi_0 - sqrt(c_0 c_2) t / m)."""
    p = vector(MODEL, **CAR | {"c_1": 0.0})
    m, c_0, c_2, v_0 = CAR["m"] + WHEELS, CAR["c_0"], CAR["c_2"], 40.0
    time = np.arange(1001) * 0.05
    expected = np.sqrt(c_0 / c_2) * np.tan(np.arctan(v_0 * np.sqrt(c_2 / c_0)) - np.sqrt(c_0 * c_2) / m * time)
    assert np.allclose(run(MODEL, [v_0, 0.0], 1000, 0.05, p=p)[:, 0], expected, rtol=1e-8)


def test_a_road_is_flat_unless_the_recording_says_otherwise():
    assert dict(MODEL.defaults) == {"road_slope": 0.0}


def test_rolling_freely_downhill_the_accelerometer_reads_the_resistance_and_not_gravity():
    p = vector(MODEL, **CAR | {"c_0": 0.0, "c_1": 0.0, "c_2": 0.0, "I_w": 0.0})
    given = {"p": p, "road_slope": -0.1}
    assert rates(MODEL, [10.0, 0.0], **given)["v_x"] == pytest.approx(9.81 * np.sin(0.1))
    assert outputs(MODEL, [10.0, 0.0], **given)["a_x"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("v_0", [0.0, 5.0, -2.0])
def test_brakes_bring_a_vehicle_to_rest_and_no_further(v_0):
    found = run(MODEL, [v_0, 0.0], 2000, 0.005, p=vector(MODEL, **CAR), drive=-4.0)[:, 0]
    assert abs(found[-1]) < 1e-6
    assert np.all(np.sign(found) * np.sign(v_0) >= 0)


def test_drive_follows_its_command_with_the_lag():
    p = vector(MODEL, **CAR | {"c_0": 0.0, "c_1": 0.0, "c_2": 0.0, "drive_lag": 0.2})
    found = run(MODEL, [10.0, 0.0], 100, 0.01, p=p, drive=1.0)
    time = np.arange(101) * 0.01
    a = CAR["force_per_unit"] / (CAR["m"] + WHEELS)
    assert np.allclose(found[:, 1], 1 - np.exp(-time / 0.2), atol=1e-9)
    assert np.allclose(found[:, 0], 10 + a * (time - 0.2 * (1 - np.exp(-time / 0.2))), atol=1e-9)


def test_brakes_have_their_own_gain():
    p = vector(MODEL, **CAR | {"brake_gain": 2.0, "c_0": 0.0, "c_1": 0.0, "c_2": 0.0})
    assert rates(MODEL, [10.0, -1.0], p=p, drive=-1.0)["v_x"] == pytest.approx(
        -2 * rates(MODEL, [10.0, 1.0], p=p, drive=1.0)["v_x"]
    )


def test_reported_combinations_are_what_the_motion_tells():
    named = type("p", (), {**{q.name: float(q.array) for q in MODEL.parameters}, **CAR})
    told = {combination.name: combination.of(named) for combination in MODEL.combinations}
    assert told["m_eff"] == pytest.approx(effective_mass(named)) == pytest.approx(CAR["m"] + WHEELS)
    p = vector(MODEL, **CAR)
    pushed = rates(MODEL, [10.0, 1.0], p=p, drive=1.0)["v_x"] - rates(MODEL, [10.0, 0.0], p=p)["v_x"]
    assert pushed == pytest.approx(told["force_per_unit / m_eff"])


def test_without_wheels_it_drives_as_the_reference_vehicle_straight_ahead():
    names = ("m", "c_0", "c_1", "c_2", "force_per_unit")
    p = vector(MODEL, **{name: FULL_SIZE_CAR[name] for name in names}, I_w=0.0, drive_lag=0.1)
    time = np.arange(101) * 0.02
    commands = {"time": time, "steer": np.zeros(101), "drive": np.where(time < 1, 2.0, -3.0)}
    reference = simulate(FULL_SIZE_CAR, commands, {"motor_lag": 0.1}, start=(15.0, 0.0, 0.0), fine=1e-3)
    first = run(MODEL, [15.0, 2.0], 500, 0.002, p=p, drive=2.0)
    then = run(MODEL, first[-1], 500, 0.002, p=p, drive=-3.0)
    assert np.allclose(np.concatenate([first[:-1:10, 0], then[::10, 0]]), reference["true_v_x"], atol=1e-6)


def test_brakes_hold_no_more_than_the_road():
    icy = MODEL + EFFECTS["grip_scale"].at(0.25)
    for model, grip in ((MODEL, 1.0), (icy, 0.25)):
        p = vector(model, **CAR | {"friction": 0.9, "I_w": 0.0, "c_0": 0.0, "c_1": 0.0, "c_2": 0.0})
        most = 0.9 * grip * 9.81
        assert outputs(model, [20.0, -30.0], p=p)["a_x"] == pytest.approx(-most, rel=1e-3)
        assert outputs(model, [20.0, -0.3 * most], p=p)["a_x"] == pytest.approx(-0.3 * most, rel=1e-3)
