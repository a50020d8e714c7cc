"""Motion from poses: an independent vehicle's velocities within their sd, and what is no reading counts as none."""

import numpy as np
import pandas as pd
import pytest
from reference_manoeuvres import manoeuvre
from reference_vehicle import RACER, simulate

from greybox_id.base.errors import BadInput
from greybox_id.datasets.checks import check
from greybox_id.datasets.column_map import Reference, parse_column_map
from greybox_id.datasets.poses import MADE, motion
from greybox_id.datasets.read import read

AT = Reference(forward=0.022, left=-0.01, heading=-0.0077)
NOISE = 0.0005, 0.001  # m, rad
VELOCITIES = ("v_x", "v_y", "yaw_rate")


def drive(name="steps", rate=100.0, duration=20.0, seed=1):
    """Poses of the reference vehicle as a camera sees them: time, x, y, yaw within a turn; and the truth."""
    commands = manoeuvre(name, RACER, seed=seed, duration=duration, rate=rate)
    effects = {"steering_lag": 0.08, "motor_lag": 0.08, "tyre_relaxation": 0.03}
    truth = simulate(RACER, commands, effects, start=(commands["v_x"][0], 0.0, 0.0), fine=1e-3)
    return (truth["time"], *seen(truth["x"], truth["y"], truth["yaw"], seed)), truth


def seen(x, y, yaw, seed=1):
    rng, n = np.random.default_rng(seed), len(x)
    c, s = np.cos(yaw), np.sin(yaw)
    place, turn = NOISE
    return (
        x + AT.forward * c - AT.left * s + place * rng.standard_normal(n),
        y + AT.forward * s + AT.left * c + place * rng.standard_normal(n),
        np.angle(np.exp(1j * (yaw + AT.heading + turn * rng.standard_normal(n)))),
    )


def circle(rate=100.0, duration=6.0, speed=1.5, turning=2.0):
    """Poses on a circle about which the reference point swings; the truth is two numbers and nothing across."""
    time = np.arange(round(duration * rate)) / rate
    yaw = turning * time
    return time, *seen(speed / turning * np.sin(yaw), -speed / turning * np.cos(yaw), yaw)


@pytest.fixture(scope="module")
def driven():
    poses, truth = drive()
    return motion(*poses, AT, "drive"), truth


def test_velocities_lie_within_their_stated_sd(driven):
    found, truth = driven
    within = {name: np.abs(found.signals[name] - truth[f"true_{name}"]) < 1.96 * found.sd[name] for name in VELOCITIES}
    assert 0.90 < np.mean(list(within.values())) < 0.98
    for name in VELOCITIES:
        assert np.mean(within[name]) > 0.90, name


def test_they_are_far_better_than_plain_differences(driven):
    found, truth = driven
    time, x, y, _ = drive()[0]
    plain = np.hypot(np.gradient(x, time), np.gradient(y, time))
    speed = np.hypot(found.signals["v_x"], found.signals["v_y"])
    errors = [np.sqrt(np.mean((own - np.hypot(truth["true_v_x"], truth["true_v_y"])) ** 2)) for own in (speed, plain)]
    assert errors[0] < 0.3 * errors[1]


def test_accelerations_are_those_of_the_centre_of_gravity(driven):
    found, truth = driven
    for name in ("a_x", "a_y"):
        e = found.signals[name] - truth[f"true_{name}"]
        assert np.sqrt(np.mean(e**2)) < 0.3 * np.std(truth[f"true_{name}"]), name


def test_a_steady_circle_is_free_of_the_lever_arm():
    found = motion(*circle(), AT, "circle")
    middle = slice(100, -100)
    for name, true in {"v_x": 1.5, "v_y": 0.0, "yaw_rate": 2.0, "a_x": 0.0, "a_y": 3.0}.items():
        e = np.mean(found.signals[name][middle]) - true
        assert abs(e) < 0.02, name
    at_the_pose = motion(*circle(), Reference(heading=AT.heading), "circle")
    assert np.mean(at_the_pose.signals["v_y"][middle]) == pytest.approx(2.0 * AT.forward, abs=0.01)


def test_held_poses_are_no_readings():
    (time, *poses), _ = drive(rate=20.0, duration=15.0)
    fresh = motion(time, *poses, AT, "fresh")
    held = motion(np.arange(5 * len(time)) / 100.0, *(np.repeat(values, 5) for values in poses), AT, "held")
    assert "1200 of 1500 poses repeat the previous pose" in held.notes[0]
    for name in VELOCITIES:
        apart = np.abs(held.signals[name][::5] - fresh.signals[name])
        assert np.mean(apart < fresh.sd[name]) > 0.99, name


def test_a_turn_at_few_poses_a_second_biases_no_speed():
    time, x, y, yaw = circle(rate=20.0, duration=20.0, turning=5.0)  # a quarter of a radian from pose to pose
    found = motion(time, x, y, yaw, AT, "fast circle")
    assert np.mean(found.signals["v_x"][20:-20]) == pytest.approx(1.5, abs=1e-3)
    assert np.mean(found.signals["a_y"][20:-20]) == pytest.approx(7.5, abs=0.02)


def test_a_gap_begins_a_run_that_knows_nothing_of_the_one_before():
    time, x, y, yaw = circle()
    later = np.where(time >= 3.0, time + 2.0, time)  # the poses go on as if the gap were none
    found = motion(later, x, y, yaw, AT, "gap")
    edge = np.flatnonzero(np.diff(later) > 1.0)[0]
    assert np.all(found.sd["v_x"][[edge, edge + 1]] > 2 * np.median(found.sd["v_x"]))
    assert abs(found.signals["v_x"][edge + 20] - 1.5) < 0.05
    assert found.time[edge + 1] - found.time[edge] > 1.5


def test_a_glitch_is_left_out_and_said():
    time, x, y, yaw = circle()
    yaw[300] += 0.3
    x[300] += 0.05
    found = motion(time, x, y, yaw, AT, "glitch")
    assert any("were left out: no plausible motion passes" in note for note in found.notes)
    assert abs(found.signals["yaw_rate"][300] - 2.0) < 0.2


def test_stamps_that_scatter_about_even_steps_give_way_to_them():
    time, *poses = circle()
    stamps = time + 3e-4 * np.random.default_rng(0).standard_normal(len(time))
    found = motion(stamps, *poses, AT, "stamps")
    assert "the time was set to even steps" in found.notes[0]
    np.testing.assert_allclose(np.diff(found.time), 0.01, rtol=1e-3)


def test_poses_at_uneven_instants_keep_them():
    rng = np.random.default_rng(0)
    time = np.cumsum(0.01 * (1 + 0.2 * rng.uniform(-1, 1, 600)))
    yaw = 2.0 * time
    found = motion(time, *seen(0.75 * np.sin(yaw), -0.75 * np.cos(yaw), yaw), AT, "uneven")
    np.testing.assert_array_equal(found.time, time)


def test_missing_poses_are_bridged_with_a_larger_sd():
    (time, x, y, yaw), truth = drive(duration=10.0)
    x[500:530] = np.nan
    found = motion(time, x, y, yaw, AT, "missing")
    assert found.sd["v_x"][515] > 1.2 * found.sd["v_x"][400]
    assert abs(found.signals["v_x"][515] - truth["true_v_x"][515]) < 4 * found.sd["v_x"][515]


@pytest.mark.parametrize("rows", [0, 5])
def test_too_few_poses_are_refused(rows):
    time, *poses = circle()
    with pytest.raises(BadInput, match="too few to estimate motion from"):
        motion(time[:rows], *(values[:rows] for values in poses), AT, "few.csv")
    with pytest.raises(BadInput, match="too few"):
        motion(time, *(np.full(len(time), 1.0) for _ in poses), AT, "still.csv")


def test_all_that_is_made_has_an_sd(driven):
    found, truth = driven
    for name in (*MADE, "x", "y", "yaw"):
        assert found.signals[name].shape == found.sd[name].shape == truth["time"].shape
        assert np.all(found.sd[name] > 0)


def test_standard_deviations_are_recorded_beside_the_signals_and_not_checked_as_such(tmp_path):
    time, x, y, yaw = circle()
    file = tmp_path / "lap.csv"
    pd.DataFrame({"time": time, "x": x, "y": y, "yaw": yaw}).to_csv(file, index=False)
    text = "".join(f'[signals.{name}]\nunit="{unit}"\n' for name, unit in (("x", "m"), ("y", "m"), ("yaw", "rad")))
    recording = read(file, parse_column_map(f'[poses]\nforward=0.022\n[time]\nunit="s"\n{text}', "own.toml"))
    assert recording.unit("sd_v_x") == "m/s"
    assert set(recording.signals) >= {name for made in MADE for name in (made, f"sd_{made}")}
    assert not [finding for finding in check(recording) if finding.where.channel.startswith("sd_")]
