"""The controllers of examples/nmpc: with a perfect model they follow the path, and better than with a nominal one."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

EXAMPLE = Path(__file__).parents[3] / "examples" / "nmpc"
sys.path.insert(0, str(EXAMPLE))

from follow import followed  # noqa: E402
from learned import LearnedPrediction  # noqa: E402
from prediction import Prediction  # noqa: E402
from race import driven  # noqa: E402
from scene import PAIRS, PERIOD, Scene  # noqa: E402

from greybox_id.models.registry import model_of, with_effects  # noqa: E402
from greybox_id.models.vehicle import parse_vehicle  # noqa: E402
from greybox_lab.driving.learned.injection import injected  # noqa: E402
from greybox_lab.driving.learned.training import train_actuator_net  # noqa: E402
from greybox_lab.driving.racing.stage import stage  # noqa: E402
from greybox_lab.driving.racing.track import Usage, track  # noqa: E402
from greybox_lab.virtual.virtual_vehicle import SteppedCar, drive, vehicle_file_text  # noqa: E402

FIRST_BENDS = 12.0
"""m."""


@pytest.fixture(scope="module")
def scene():
    return Scene(PAIRS[0])


@pytest.fixture(scope="module")
def models(scene):
    nominal = model_of(parse_vehicle(vehicle_file_text(scene.stated), Path("car.toml")))
    return {"nominal": nominal, "true": with_effects(nominal, scene.effects)}


def test_curvature_is_the_turn_of_the_line():
    one = track(1.3, 0.3, Usage(8.0, 3.0, 5.0, 7.0))
    turns = np.gradient(one.yaw, one.s)
    assert np.abs(turns - one.curvature)[1:-1].max() < 2e-3 * np.abs(one.curvature).max()
    steps = np.hypot(np.diff(one.x), np.diff(one.y))
    assert np.ptp(steps) < 1e-3 * one.spacing
    assert np.abs(one.curvature).max() == pytest.approx(1 / 1.3, rel=1e-3)


def test_speeds_stay_within_the_friction_ellipse():
    one = track(1.3, 0.3, Usage(8.0, 3.0, 5.0, 7.0))
    a_x = (np.roll(one.speed, -1) ** 2 - one.speed**2) / (2 * one.spacing)
    a_y = one.speed**2 * one.curvature
    assert np.all((a_x / np.where(a_x > 0, 3.0, 5.0)) ** 2 + (a_y / 8.0) ** 2 < 1.02)


def test_a_pose_is_found_again_on_the_track():
    one = track(1.3, 0.3, Usage(8.0, 3.0, 5.0, 7.0))
    k, off, turned = 1200, 0.15, 0.2
    x, y = one.x[k] - off * np.sin(one.yaw[k]), one.y[k] + off * np.cos(one.yaw[k])
    found = one.project(x, y, one.yaw[k] + turned, one.s[k] + 0.3)
    assert found == pytest.approx((one.s[k], off, turned), abs=1e-3)


def test_a_stage_foretells_the_vehicle_with_commands_that_are_late(scene, models):
    """A delay of 40 ms exactly, one of 33 ms as the mean of what acts in a period."""
    for late, tolerance in ((0.04, 1e-3), (0.033, 1e-2)):
        effects = {**scene.effects, "steering_delay": late}
        believed = with_effects(models["nominal"], effects)
        prediction = Prediction(believed, PERIOD, np.ones(2))
        ride = SteppedCar(scene.car, 4.0, 1.0, 1 / PERIOD, effects)
        z = prediction.started(4.0, 0.0)
        commands = np.zeros(2)
        for k in range(40):
            wanted = np.array([0.1 * np.sin(0.4 * k), 2.0])
            z = np.asarray(prediction.stage(z, (wanted - commands) / PERIOD, np.zeros(3))).ravel()
            ride.step(*wanted)
            commands = wanted
        motion = ride.motion
        names = ("v_x", "v_y", "yaw_rate", "x", "y", "yaw")  # on a straight path s, e_y and e_psi are the pose
        assert [motion[name] for name in names] == pytest.approx(z[:6], abs=tolerance, rel=tolerance)


def test_a_stage_with_networks_foretells_what_drivers_learn_on(scene, models):
    """Yaw rate, which the network says, and speed, which follows from it, over 40 periods; the network acts."""
    car = models["nominal"]
    driven_before = drive(scene.car, "mixed", 12.0, 100.0, scene.effects, "nominal", 3)[0]
    model = injected(car, train_actuator_net(driven_before, sample_time=PERIOD, steps=20))
    prediction, own, physics = LearnedPrediction(model, PERIOD, np.ones(2)), stage(model, PERIOD), stage(car, PERIOD)
    z, driven_on = prediction.started(3.0, 0.0), np.zeros((1, own.size + 3))
    driven_on[0, : own.size] = own.begun(3.0, own.equations.values)[0]
    alone, before = np.zeros((1, physics.size + 3)), np.zeros(2)
    alone[0, : physics.size] = physics.begun(3.0, physics.equations.values)[0]
    at, most = own.states.index("yaw_rate"), 0.0
    for k in range(40):
        wanted = np.array([0.15 * np.sin(0.3 * k), 0.2])
        z = np.asarray(prediction.stage(z, (wanted - before) / PERIOD, np.zeros(3))).ravel()
        given = wanted[None], np.zeros((1, 3))
        driven_on = own.advance(driven_on, *given, own.equations.values[None])
        alone = physics.advance(alone, *given, physics.equations.values[None])
        before, most = wanted, max(most, abs(alone[0, at] - z[at]))
        assert z[at] == pytest.approx(driven_on[0, at], abs=2e-3)
    assert most > 2e-2


def test_the_perfect_model_follows_the_path_and_the_nominal_one_does_worse(scene, models):
    laps = {name: driven(scene, model, until=FIRST_BENDS) for name, model in models.items()}
    wheelbase = scene.stated.size.length
    assert all(own.finished for own in laps.values())
    assert laps["true"].failures == 0
    assert laps["true"].rms < 0.02 * wheelbase
    assert laps["nominal"].rms > 3 * laps["true"].rms


def test_commands_keep_their_bounds(scene, models):
    own = driven(scene, models["true"], until=FIRST_BENDS)
    wishes = scene.wishes
    assert np.all((own.commands >= wishes.low - 1e-6) & (own.commands <= wishes.high + 1e-6))
    rates = np.diff(own.commands, axis=0) / PERIOD
    assert np.all(np.abs(rates) <= wishes.fastest * (1 + 1e-6))


def test_a_designed_plan_is_driven_wherever_it_lies(scene, models):
    """Path and speed of a plan.csv, whose arena has other axes than the vehicle that begins it."""
    time = np.arange(0.0, 4.0, PERIOD)
    speed = 3.0 - 0.4 * time
    yaw = 0.5 * np.sin(1.5 * time)
    line = np.cumsum(speed * np.exp(1j * yaw)) * PERIOD * np.exp(2.0j) + (5.0 - 3.0j)
    own = followed(
        pd.DataFrame({"x": line.real, "y": line.imag, "yaw": yaw + 2.0, "v_x": speed}), scene, models["nominal"]
    )
    assert own.finished
    assert own.failures == 0
    assert own.rms < 0.05 * scene.stated.size.length
    assert own.time == pytest.approx(4.0, abs=0.2)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.slow
def test_the_controller_in_c_drives_as_well(scene, models, tmp_path):
    own = driven(scene, models["true"], tmp_path, until=FIRST_BENDS)
    wishes = scene.wishes
    assert own.finished
    assert own.failures == 0
    assert own.rms < 0.02 * scene.stated.size.length
    assert np.all((own.commands >= wishes.low - 1e-9) & (own.commands <= wishes.high + 1e-9))
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{tmp_path / 'car'}"]
    for source in (EXAMPLE / "c").glob("*.c"):
        subprocess.run(["cc", *flags, "-c", str(source), "-o", str(tmp_path / "checked.o")], check=True)


@pytest.mark.examination
@pytest.mark.slow
def test_closing_the_gap_removes_most_of_the_excess_path_error(tmp_path):
    command = [sys.executable, str(EXAMPLE / "race.py"), "--out", str(tmp_path), "--pairs", "0", "1"]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    races = json.loads((tmp_path / "race.json").read_text())
    assert len(re.findall(r"removes +\d+%", " ".join(said.split()))) == 2
    for race in races:
        assert race["laps"]["true"]["finished"]
        assert race["removed"]["rms"] >= 0.7
    assert len(list(tmp_path.glob("*/race.svg"))) == 2
