"""A body that rolls on its springs: its equation integrated by another solver, and what its roll rate tells."""

from dataclasses import replace

import numpy as np
import pytest
from driving import driven, on_vehicle
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, G
from scipy.integrate import solve_ivp

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build, vehicle_parameters
from greybox_id.models.single_track import ROLLING, lateral, single_track, with_roll
from greybox_id.models.vehicle import Vehicle

START = {"v_y": 0.0, "yaw_rate": 0.0}
I_X, STIFFNESS, DAMPER = (float(own.array) for own in ROLLING)
M, H = FULL_SIZE_CAR["m"], FULL_SIZE_CAR["h_cg"]


def given(seconds=8.0):
    commands = manoeuvre("mixed", FULL_SIZE_CAR, duration=seconds, rate=100.0)
    return {name: values for name, values in commands.items() if name != "drive"}


@pytest.mark.parametrize("body", [lateral, single_track])
def test_the_roll_rate_is_that_of_its_equation(body):
    stiff, commands = on_vehicle(body(), FULL_SIZE_CAR), manoeuvre("mixed", FULL_SIZE_CAR, duration=8.0, rate=100.0)
    start = START if body is lateral else {"v_x": commands["v_x"][0], **START}
    found = driven(with_roll(stiff), commands, start, hold="linear")
    time, bare = np.asarray(commands["time"]), driven(stiff, commands, start, hold="linear")

    def rates(t, state):
        moment = M * H * (np.interp(t, time, bare["a_y"]) + G * state[0]) - STIFFNESS * state[0] - DAMPER * state[1]
        return state[1], moment / (I_X + M * H**2)

    truth = solve_ivp(rates, (0, time[-1]), (0.0, 0.0), t_eval=time, max_step=0.005, rtol=1e-8).y
    size = np.sqrt(np.mean(truth[1] ** 2))
    assert size > 0.01
    assert np.sqrt(np.mean((found["roll_rate"] - truth[1]) ** 2)) < 0.01 * size
    for name in ("yaw_rate", "v_y"):
        np.testing.assert_allclose(found[name], bare[name], atol=1e-12)
    body_reads = bare["a_y"] + G * truth[0] - H * np.gradient(truth[1], time)
    smooth = np.abs(np.gradient(bare["a_y"], time)) < 5.0  # where it jumps, so does the gradient
    assert np.max(np.abs(found["a_y"] - body_reads)[smooth]) < 0.05


def test_a_steady_turn_leans_as_springs_and_weight_say():
    time = np.arange(600) / 100
    turn = {"time": time, "steer": np.full(600, 0.02), "v_x": np.full(600, 20.0)}
    model = with_roll(on_vehicle(lateral(), FULL_SIZE_CAR))
    found = driven(model, turn, START)
    bare = driven(on_vehicle(lateral(), FULL_SIZE_CAR), turn, START)
    lean = M * H * bare["a_y"][-1] / (STIFFNESS - M * H * G)
    assert found["a_y"][-1] - bare["a_y"][-1] == pytest.approx(G * lean, rel=1e-3)
    assert found["roll_rate"][-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_the_roll_rate_tells_the_mass_that_lateral_motion_does_not():
    model = with_roll(on_vehicle(lateral(), FULL_SIZE_CAR))
    commands, rng = given(20.0), np.random.default_rng(5)
    readings = driven(model, commands, START)
    noise = {"v_y": 0.02, "yaw_rate": 0.005, "a_y": 0.1, "roll_rate": 0.005}
    read = {name: values + noise[name] * rng.standard_normal(len(values)) for name, values in readings.items()}
    free = ("m", "D_f", "D_r", "I_z")
    wrong = model.with_parameters(
        *(replace(p, fixed=p.name not in free) for p in model.parameters if p.name != "m"),
        replace(model["m"].with_value(1.1 * M), fixed=False),
    )
    known = {"steer": commands["steer"], "v_x": commands["v_x"], **read}
    deaf = {name: values for name, values in known.items() if name != "roll_rate"}
    how = FitOptions(solver="gauss-newton", noise=noise)
    with_it, without = (fit(wrong, [Recording("drive", commands["time"], each)], how=how) for each in (known, deaf))
    assert float(with_it.model["m"].array) == pytest.approx(M, rel=0.03)
    assert with_it.sd["m"] < 0.3 * without.sd["m"]


def test_it_is_a_setting_whose_numbers_a_vehicle_states():
    assert build("lateral", {"body": "rolling"}).outputs == ("v_y", "yaw_rate", "a_y", "roll_rate")
    assert build("single_track", {"body": "rolling"}).settings["body"] == "rolling"
    assert {own.name for own in ROLLING} <= set(vehicle_parameters())
    with pytest.raises(BadInput, match="stiff or rolling, not 'rolls'"):
        build("lateral", {"body": "rolls"})


def test_a_body_that_its_springs_do_not_hold_up_is_refused():
    tall = Vehicle("tall truck", {"m": Stated(17000.0), "h_cg": Stated(1.4)})
    with pytest.raises(BadInput, match=r"tips over, since roll_stiffness is .*2\.33·10⁵ N m/rad"):
        build("single_track", {"body": "rolling"}, vehicle=tall)
    springs = Vehicle("tall truck", {**tall.values, "roll_stiffness": Stated(1e6)})
    assert build("single_track", {"body": "rolling"}, vehicle=springs)["roll_stiffness"].array == 1e6
