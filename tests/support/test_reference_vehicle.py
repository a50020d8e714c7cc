"""The reference vehicle against closed forms: what checks our models must itself be right."""

import numpy as np
import pytest
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, NULL, RACER, simulate, simulate_lateral

G = 9.81
FINE = 5e-4
CARS = {"full size": FULL_SIZE_CAR, "racer": RACER}
SOME = {
    "grip_scale": 0.8, "front_stiffness": 0.8, "rear_stiffness": 1.2, "tyre_relaxation": 0.3, "combined_slip": 0.9,
    "load_sensitivity": 0.2, "longitudinal_load_transfer": 1.0, "tyre_temperature": 0.2, "mass_change": 1.1,
    "cog_shift": 0.02, "yaw_inertia": 1.2, "roll_dynamics": 0.005, "steering_delay": 0.0313, "steering_lag": 0.05,
    "steering_bandwidth": 3.0,
    "steering_rate_limit": 0.2, "steering_offset": 0.01, "steering_ratio": 0.9, "steering_backlash": 0.005,
    "motor_lag": 0.1, "motor_saturation": 0.5, "motor_gain": 0.9, "brake_bias": 0.2, "aero_drag": 0.3,
    "rolling_resistance": 5.0, "road_slope": 0.03, "road_bank": 0.03, "wind_gust": 5.0, "downforce": 0.5,
    "yaw_rate_bias": 0.01, "yaw_rate_scale": 1.05, "accel_bias_x": 0.1, "accel_bias_y": 0.1, "imu_mount_pitch": 0.03,
    "imu_mount_roll": 0.03, "imu_mount_yaw": 0.05, "imu_lever_arm": 0.3, "velocity_lever_arm": 0.3,
    "wheel_speed_scale": 1.03, "sensor_latency_yaw": 0.0117, "sensor_latency_vx": 0.0117, "sensor_latency_imu": 0.0117,
    "timestamp_jitter": 0.003, "dropped_samples": 0.1,
}  # fmt: skip
READ = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")

HEAVY = {"mass_change": 2.0**30, "yaw_inertia": 2.0**30}
"""So heavy that a `slippery` car does not move aside: slip is the steering angle."""


def slippery(car):
    """Tyres that carry as much sideways under the `HEAVY` load as the car's own under its own."""
    return car | {name: car[name] / HEAVY["mass_change"] for name in ("D_f", "D_r")}


def drive(car, effects=None, duration=6.0, fine=FINE, changed=None, **settings):
    """Through the mixed manoeuvre of `car`; parameters `changed` against it."""
    commands, car = manoeuvre("mixed", car, seed=3, duration=duration), car | (changed or {})
    return simulate(car, commands, effects, start=(commands["v_x"][0], 0, 0), fine=fine, **settings)


def straight(v_x, duration, steer=0.0, rate=50.0, drive=0.0):
    time = np.arange(int(duration * rate) + 1) / rate
    return {
        "time": time, "steer": np.full(len(time), steer), "drive": np.full(len(time), drive),
        "v_x": np.full(len(time), v_x),
    }  # fmt: skip


def stepped(v_x, steer, duration=1.0, at=5):
    commands = straight(v_x, duration)
    commands["steer"] = np.where(np.arange(len(commands["time"])) < at, 0.0, steer)
    return commands, np.maximum(commands["time"] - commands["time"][at], 0.0)


# ---- the nominal vehicle


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
def test_steady_circle_has_the_understeer_gradient_of_its_tyres(car):
    steer, v = 1e-3, 0.4 * car["v_max"]
    found = simulate_lateral(car, straight(v, 20.0, steer), fine=FINE, tyre="linear")
    L = car["l_f"] + car["l_r"]
    K = (1 / (car["B_f"] * car["C_f"] * car["D_f"]) - 1 / (car["B_r"] * car["C_r"] * car["D_r"])) / G
    assert found["yaw_rate"][-1] == pytest.approx(v * steer / (L + K * v**2), rel=1e-5)
    assert found["a_y"][-1] == pytest.approx(v * found["yaw_rate"][-1], rel=1e-9)


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
def test_coasting_down_follows_the_closed_form(car):
    car = car | {"c_1": 0.0}
    found = simulate(car, straight(0, 10.0), start=(0.5 * car["v_max"], 0, 0), fine=FINE)
    c_0, c_2, m = car["c_0"], car["c_2"], car["m"]
    angle = np.arctan(0.5 * car["v_max"] * np.sqrt(c_2 / c_0)) - found["time"] * np.sqrt(c_0 * c_2) / m
    v = np.sqrt(c_0 / c_2) * np.tan(angle)
    fast = v > 1.5  # resistance is whole
    assert np.allclose(found["v_x"][fast], v[fast], rtol=1e-9)
    assert np.allclose(found["a_x"][fast], (-(c_0 + c_2 * v**2) / m)[fast], rtol=1e-9)


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
def test_kinetic_energy_changes_by_the_work_of_the_forces(car):
    commands = manoeuvre("mixed", car, seed=3, duration=8.0, rate=1000.0)
    got = simulate(car, commands, hold="linear", start=(commands["v_x"][0], 0, 0), fine=FINE)
    v_x, v_y, r, steer = got["v_x"], got["v_y"], got["yaw_rate"], got["road_wheel"]
    front = v_y + car["l_f"] * r
    power = got["F_xf"] * (v_x * np.cos(steer) + front * np.sin(steer)) + got["F_xr"] * v_x
    power += got["F_yf"] * (front * np.cos(steer) - v_x * np.sin(steer)) + got["F_yr"] * (v_y - car["l_r"] * r)
    power -= (car["c_0"] + car["c_1"] * v_x + car["c_2"] * v_x**2) * v_x
    energy = 0.5 * car["m"] * (v_x**2 + v_y**2) + 0.5 * car["I_z"] * r**2
    work = np.concatenate([[0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(got["time"]))])
    assert np.allclose(energy - energy[0], work, atol=2e-5 * np.ptp(energy))


@pytest.mark.parametrize("tyre", ["pacejka", "linear", "dugoff", "brush"])
def test_tyres_share_cornering_stiffness_and_peak(tyre):
    car = FULL_SIZE_CAR | {"E_f": 0.0}
    F_zf = car["m"] * G * car["l_r"] / (car["l_f"] + car["l_r"])
    small, large = (
        simulate_lateral(slippery(car), straight(20, 0.1, a), HEAVY, tyre=tyre)["F_yf"][-1] for a in (1e-5, 0.5)
    )
    assert small == pytest.approx(car["B_f"] * car["C_f"] * car["D_f"] * F_zf * 1e-5, rel=1e-3)
    if tyre != "linear":
        assert 0.85 * car["D_f"] * F_zf < large <= car["D_f"] * F_zf


def test_standstill_stays_and_brakes_do_not_blow_up():
    at_rest = simulate(RACER, straight(0, 2.0, steer=0.3), fine=FINE)
    assert not np.any(at_rest["v_x"])
    assert not np.any(at_rest["yaw_rate"])
    crawling = simulate(RACER, straight(0, 5.0, steer=0.3), start=(1.0, 0, 0), fine=FINE)
    assert np.all(np.isfinite(crawling["a_y"]))
    assert abs(crawling["v_x"][-1]) < 0.05


# ---- time


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_steps_of_the_integration_do_not_show(car, hold):
    random = {"timestamp_jitter", "dropped_samples"}
    all_at_once = {name: value for name, value in SOME.items() if name not in random}
    coarse, fine = (drive(car, effects=all_at_once, hold=hold, fine=step) for step in (5e-4, 1e-4))
    for name in READ:
        assert np.allclose(coarse[name], fine[name], atol=5e-4 * np.ptp(fine[name])), name


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_delay_is_the_command_shifted_by_it(hold):
    commands, tau = manoeuvre("slalom", duration=6.0) | {"drive": np.zeros(300)}, 0.0137
    late = simulate(FULL_SIZE_CAR, commands, {"steering_delay": tau}, hold, start=(20, 0, 0))
    both = np.sort(np.concatenate([commands["time"], commands["time"] + tau]))
    asked = commands["time"] + tau
    steer = np.interp(both, asked, commands["steer"])
    if hold == "zero":
        steer = commands["steer"][np.maximum(np.searchsorted(asked, both, side="right") - 1, 0)]
    commands_late = {"time": both, "steer": steer, "drive": 0 * both}
    shifted = simulate(FULL_SIZE_CAR, commands_late, None, hold, start=(20, 0, 0))
    rows = np.searchsorted(both, commands["time"])
    for name in READ:
        assert np.allclose(late[name], shifted[name][rows], atol=1e-10)


def test_a_row_is_measured_just_after_its_commands_are_applied():
    commands, since = stepped(20.0, 0.02)
    found = simulate_lateral(FULL_SIZE_CAR, commands)
    row = np.flatnonzero(commands["steer"])[0]
    assert since[row] == 0
    assert found["yaw_rate"][row] == 0
    assert found["a_y"][row] > 1
    assert found["a_y"][row - 1] == 0


def test_the_speed_given_is_the_speed_driven():
    commands = manoeuvre("mixed", RACER, duration=6.0)
    found = simulate_lateral(RACER, commands, {"steering_delay": 0.0137, "sensor_latency_imu": 0.0051}, fine=FINE)
    assert np.allclose(found["v_x"], commands["v_x"], atol=1e-12)
    free = simulate(RACER, commands, start=(commands["v_x"][0], 0, 0), fine=FINE)
    given = simulate_lateral(RACER, commands | {"v_x": free["v_x"]}, fine=FINE)
    assert np.allclose(given["yaw_rate"], free["yaw_rate"], atol=3e-3 * np.ptp(free["yaw_rate"]))


# ---- effects


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
def test_null_effects_are_none(car):
    plain, null = drive(car), drive(car, effects=NULL)
    assert all(np.array_equal(plain[name], null[name]) for name in plain)


@pytest.mark.parametrize("effect", sorted(NULL))
def test_every_effect_has_one(effect):
    plain, changed = drive(FULL_SIZE_CAR), drive(FULL_SIZE_CAR, effects={effect: SOME[effect]})
    assert any(not np.allclose(plain[name], changed[name], atol=1e-4) for name in READ)


@pytest.mark.parametrize(
    ("effects", "parameters"),
    [
        ({"grip_scale": 0.8}, {"D_f": 0.8, "D_r": 0.8 * 1.02}),
        ({"front_stiffness": 0.8, "rear_stiffness": 1.1}, {"B_f": 0.8 * 9.3, "B_r": 1.1 * 10.5}),
        ({"cog_shift": 0.1}, {"l_f": 1.196, "l_r": 1.565}),
        ({"yaw_inertia": 1.2}, {"I_z": 1.2 * 2274.0}),
        ({"motor_gain": 0.9}, {"force_per_unit": 0.9 * 1457.2}),
        ({"brake_bias": 0.1}, {"brake_split_front": 0.72}),
        ({"aero_drag": 0.2, "rolling_resistance": 50.0}, {"c_0": 258.0, "c_2": 0.65}),
    ],
)
def test_effects_on_parameters_are_parameters(effects, parameters):
    changed = drive(FULL_SIZE_CAR, changed=parameters)
    found = drive(FULL_SIZE_CAR, effects=effects)
    for name in set(found) - {"friction"}:  # which is said of D
        values = found[name]
        assert np.allclose(values, changed[name], atol=1e-9 * np.max(np.abs(values)))


def test_steering_lags_limits_and_plays_in_closed_form():
    commands, since = stepped(20.0, 0.1)

    def wheel(**effects):
        return simulate_lateral(FULL_SIZE_CAR, commands, effects, fine=1e-3)["road_wheel"]

    assert np.allclose(wheel(steering_lag=0.004), 0.1 * (1 - np.exp(-since / 0.004)), atol=1e-12)
    assert np.allclose(wheel(steering_rate_limit=0.3), np.minimum(0.3 * since, 0.1), atol=1e-12)
    assert np.allclose(wheel(steering_backlash=0.01), np.where(commands["steer"] > 0, 0.09, 0))
    assert np.allclose(wheel(steering_ratio=1.1, steering_offset=0.01), 1.1 * commands["steer"] + 0.01)


def test_slip_angles_relax_over_the_relaxation_length():
    commands, since = stepped(20.0, 0.05)
    for sigma in (0.5, 0.01):
        found = simulate_lateral(slippery(FULL_SIZE_CAR), commands, HEAVY | {"tyre_relaxation": sigma}, fine=1e-3)
        assert np.allclose(found["alpha_f"], 0.05 * (1 - np.exp(-20 / sigma * since)), atol=1e-4)


def test_loads_shift_and_friction_falls_with_load():
    car, k = FULL_SIZE_CAR, 0.2
    found = drive(car, effects={"load_sensitivity": k, "longitudinal_load_transfer": 1.0, "downforce": 0.5})
    L, down = car["l_f"] + car["l_r"], 0.5 * found["v_x"] ** 2
    assert np.allclose(found["F_zf"] + found["F_zr"], car["m"] * G + down)
    shifted = car["m"] * found["a_x"] * car["h_cg"] / L
    assert np.allclose(found["F_zr"], (car["m"] * G + down) * car["l_f"] / L + shifted, atol=1)

    sensitive = drive(car, effects={"load_sensitivity": k})
    F_z0 = car["m"] * G * car["l_r"] / L / 2
    shift = 0.55 * car["m"] * sensitive["a_y"] * car["h_cg"] / car["track_f"]
    slip = car["B_f"] * sensitive["alpha_f"]
    curve = np.sin(car["C_f"] * np.arctan(slip - car["E_f"] * (slip - np.arctan(slip))))
    assert np.allclose(sensitive["F_yf"], car["D_f"] * (2 * F_z0 - 2 * k * shift**2 / F_z0) * curve, atol=1)


def test_friction_ellipse_and_tyre_temperature():
    plain = drive(FULL_SIZE_CAR)
    found = drive(FULL_SIZE_CAR, effects={"combined_slip": 0.9, "tyre_temperature": 0.3})
    assert np.allclose(found["friction"], 1 - 0.3 * (1 - np.exp(-found["work"] / 2e4)))
    slip = FULL_SIZE_CAR["B_r"] * found["alpha_r"]
    curve = np.sin(FULL_SIZE_CAR["C_r"] * np.arctan(slip - 0.2 * (slip - np.arctan(slip))))
    most = found["friction"] * FULL_SIZE_CAR["D_r"] * found["F_zr"]
    assert np.allclose(found["F_yr"], most * curve * np.sqrt(1 - (0.9 * found["F_xr"] / most) ** 2))
    sliding = sum(np.abs(plain[f"F_y{axle}"] * np.sin(plain[f"alpha_{axle}"])) for axle in "fr")
    power = sliding * np.hypot(plain["v_x"], plain["v_y"])
    work = np.sum((power[1:] + power[:-1]) / 2 * np.diff(plain["time"]))
    assert plain["work"][-1] == pytest.approx(work, rel=0.01)


def test_motor_lags_and_saturates():
    car = FULL_SIZE_CAR | {"c_0": 0.0, "c_2": 0.0}
    commands = straight(0, 10.0, drive=5.0)
    commands["drive"][:5] = 0.0
    since = np.maximum(commands["time"] - 0.1, 0)
    lagging = simulate(car, commands, {"motor_lag": 0.2}, start=(10, 0, 0), fine=1e-3)
    assert np.allclose(lagging["a_x"], 5 * (1 - np.exp(-since / 0.2)), atol=1e-9)
    weak = simulate(car, commands, {"motor_saturation": 3.0, "motor_saturation_v_b": 15.0}, start=(10, 0, 0), fine=1e-3)
    assert np.allclose(weak["a_x"][5:], 3 * np.minimum(1, 15 / weak["v_x"][5:]))
    braking = simulate(car, straight(0, 1.0, drive=-5.0), {"motor_saturation": 3.0}, start=(10, 0, 0), fine=1e-3)
    assert np.allclose(braking["a_x"], -5)


def test_gravity_moves_the_car_and_not_the_accelerometer():
    smooth = FULL_SIZE_CAR | {"c_0": 0.0, "c_2": 0.0}
    found = simulate(smooth, straight(0, 2.0), {"road_slope": 0.05}, start=(20, 0, 0), fine=1e-3)
    assert np.allclose(found["v_x"], 20 - G * np.sin(0.05) * found["time"])
    assert not np.any(found["a_x"])
    banked = simulate_lateral(FULL_SIZE_CAR, straight(20, 10.0), {"road_bank": 0.05}, fine=1e-3)
    expected = banked["yaw_rate"][-1] * 20 + G * np.sin(0.05)
    assert banked["yaw_rate"][-1] < 0
    assert banked["a_y"][-1] == pytest.approx(expected, abs=1e-6)


def test_wind_carries_a_car_along_until_it_is_as_fast():
    sail = FULL_SIZE_CAR | {"c_0": 0.0, "c_2": 100.0}
    along = simulate(sail, straight(0, 200.0, rate=10), {"wind_gust": 8.0}, start=(1, 0, 0), fine=1e-2)
    assert along["v_x"][-1] == pytest.approx(8, abs=0.2)
    across = simulate_lateral(sail, straight(20, 0.02), {"wind_gust": 8.0, "wind_direction": np.pi / 2})
    assert across["a_y"][0] == pytest.approx(100 * np.hypot(20, 8) * 8 / sail["m"])
    round_it = drive(sail, {"wind_gust": 8.0, "wind_direction": 1.0})
    air = round_it["v_x"] + 1j * round_it["v_y"] - 8 * np.exp(1j * (1.0 - round_it["yaw"]))
    tyres = (round_it["F_xf"] + 1j * round_it["F_yf"]) * np.exp(1j * round_it["road_wheel"])
    tyres += round_it["F_xr"] + 1j * round_it["F_yr"]
    assert np.ptp(round_it["yaw"]) > 0.3
    assert np.allclose(sail["m"] * (round_it["a_x"] + 1j * round_it["a_y"]), tyres - 100 * np.abs(air) * air)


def test_the_body_rolls_outwards_and_the_accelerometer_with_it():
    commands, _ = stepped(20.0, 0.02, duration=10.0)
    found = simulate_lateral(FULL_SIZE_CAR, commands, {"roll_dynamics": 0.006}, fine=1e-3)
    a_y = found["true_a_y"]
    assert found["roll"][-1] == pytest.approx(0.006 * a_y[-1], rel=1e-6)
    assert found["a_y"][-1] == pytest.approx(a_y[-1] * (1 + 0.006 * G), rel=1e-6)
    w = 2 * np.pi * 1.5
    first = np.flatnonzero(a_y)[0]  # roll'' leaps with a_y, roll cannot
    assert found["a_y"][first] == pytest.approx(a_y[first] * (1 - 0.55 * w**2 * 0.006))


# ---- sensors


def test_late_sensors_read_what_was_true_before():
    late = drive(FULL_SIZE_CAR, effects={"sensor_latency_yaw": 0.02, "sensor_latency_imu": 0.04})
    late_v = drive(FULL_SIZE_CAR, effects={"sensor_latency_vx": 0.02})
    assert np.array_equal(late["yaw_rate"][3:], late["true_yaw_rate"][:-3])
    assert np.array_equal(late["a_y"][2:], late["true_a_y"][:-2])
    assert np.array_equal(late_v["v_x"][1:], late_v["true_v_x"][:-1])
    assert np.array_equal(late["v_y"], late["true_v_y"])


def test_sensors_turned_tilted_and_off_centre():
    found = drive(FULL_SIZE_CAR, effects={"imu_mount_pitch": 0.03, "imu_mount_roll": 0.02, "imu_mount_yaw": 0.1})
    a = (found["true_a_x"] + 1j * found["true_a_y"]) * np.exp(-0.1j)
    assert np.allclose(found["a_x"], a.real - G * np.sin(0.03))
    assert np.allclose(found["a_y"], a.imag + G * np.sin(0.02))
    found = drive(FULL_SIZE_CAR, effects={"imu_lever_arm": 0.5, "velocity_lever_arm": -0.4})
    assert np.allclose(found["a_x"], found["true_a_x"] - 0.5 * found["yaw_rate"] ** 2)
    assert np.allclose(found["a_y"], found["true_a_y"] + 0.5 * found["yaw_acceleration"])
    assert np.allclose(found["v_y"], found["true_v_y"] - 0.4 * found["yaw_rate"])


def test_jitter_and_drops_are_drawn_from_a_seed():
    dropped = drive(RACER, effects={"dropped_samples": 0.2}, duration=60.0)
    stale = np.flatnonzero(np.diff(dropped["yaw_rate"]) == 0)
    assert 0.17 < len(stale) / 3000 < 0.23
    assert np.array_equal(dropped["a_x"][stale], dropped["a_x"][stale + 1])
    first, again, other = (
        drive(RACER, effects={"timestamp_jitter": 0.004}, seed=s, hold="linear", duration=60.0) for s in (0, 0, 1)
    )
    assert np.array_equal(first["yaw_rate"], again["yaw_rate"])
    assert not np.array_equal(first["yaw_rate"], other["yaw_rate"])
    moved = (first["v_x"] - first["true_v_x"])[1:-1] / np.gradient(first["true_v_x"], 0.02)[1:-1]
    assert np.median(np.abs(moved)) == pytest.approx(0.6745 * 0.004, rel=0.1)


def test_an_unknown_effect_is_refused():
    with pytest.raises(ValueError, match="warp_drive"):
        drive(RACER, effects={"warp_drive": 1.0})
