"""Tracking vehicles that were simulated without our models, whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from compiled import needs_compiler
from filter_cases import (
    C_F,
    C_R,
    NOISES,
    WALKS,
    car,
    changed,
    shaken,
    simrod,
    swerving,
    true_simrod,
)  # fmt: skip
from motion import commands
from reference_vehicle import FULL_SIZE_CAR, simulate
from toys import without

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording, join
from greybox_id.filters import filtering
from greybox_id.filters.how import TrackOptions
from greybox_id.filters.verb import track
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

pytestmark = needs_compiler

both_kinds = pytest.mark.parametrize("kind", ["ekf", "ukf"])
QUIET = {"walk_v_y": 0.02, "walk_yaw_rate": 0.01, "noise_yaw_rate": 0.01, "noise_a_y": 0.2}
TWO = ("C_alpha_f", "C_alpha_r")
TWO_WALK = {f"walk_{name}": 0.02 for name in TWO}


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def swerve():
    return swerving(30.0)


def wrong():
    return simrod(C_alpha_f=0.8 * C_F, C_alpha_r=1.2 * C_R)


@both_kinds
@pytest.mark.parametrize("smooth", [False, True])
def test_sideslip_lies_within_its_bands_as_often_as_they_say(kind, smooth):
    recording, truth = shaken(80.0)
    found = track(true_simrod(), recording, how=TrackOptions(kind, smooth, noise=WALKS | NOISES))
    off, sd = found.values["sideslip"] - truth, found.sds["sideslip"]
    assert np.mean(np.abs(off) < 2 * sd) == pytest.approx(0.954, abs=0.03)
    assert np.mean(np.abs(off) < sd) == pytest.approx(0.683, abs=0.06)
    for own in found.consistency.values():
        assert own.nis == pytest.approx(1.0, abs=0.05)
        assert abs(own.correlation) < 2 * own.correlation_bound
    assert 1.0 <= found.widened < 1.03


@both_kinds
def test_smoothing_is_nearer_to_the_truth_and_knows_it(kind):
    recording, truth = shaken()
    causal, smooth = (
        track(true_simrod(), recording, how=TrackOptions(kind, smooth, noise=WALKS | NOISES))
        for smooth in (False, True)
    )
    assert rms(smooth.values["sideslip"] - truth) < 0.95 * rms(causal.values["sideslip"] - truth)
    assert np.median(smooth.sds["sideslip"]) < 0.95 * np.median(causal.sds["sideslip"])
    assert smooth.log_likelihood == causal.log_likelihood


@both_kinds
def test_tracked_stiffness_becomes_that_of_the_vehicle_where_slip_excites_it(kind, swerve):
    recording, truth = swerve
    found = track(wrong(), recording, TWO, how=TrackOptions(kind, noise=QUIET | TWO_WALK))
    late = found.time > 15.0
    for name, true in zip(TWO, (C_F, C_R), strict=True):
        value, sd = found.values[name][late], found.sds[name][late]
        assert np.abs(np.median(value) / true - 1) < 0.03
        assert np.all(np.abs(value - true) < 4 * sd)
        assert np.max(sd) < 0.1 * true
        assert found.told[name] > 0.9
    assert found.tracked == TWO
    assert rms(found.values["sideslip"][late] - truth.sideslip[late]) < np.radians(0.1)
    assert found.sentences == ()


@pytest.mark.parametrize("smooth", [False, True])
def test_ekf_and_ukf_agree(swerve, smooth):
    ekf, ukf = (
        track(wrong(), swerve[0], TWO, how=TrackOptions(kind, smooth, noise=QUIET, tune=0)) for kind in ("ekf", "ukf")
    )
    late = ekf.time > 2.0
    for name in ("sideslip", "yaw_rate", *TWO, "F_yf", "F_yr"):
        assert np.all(np.abs(ekf.values[name] - ukf.values[name])[late] < 0.5 * ekf.sds[name][late])
    assert (ekf.kind, ukf.kind, ekf.smoothed) == ("ekf", "ukf", smooth)


@both_kinds
def test_tracked_forces_become_those_of_the_axles(kind):
    """Whatever the tyres are thought to be."""
    recording, truth = swerving(30.0, amplitude=0.04)
    how = TrackOptions(kind, smooth=True, readings=("yaw_rate", "a_y", "v_y"), noise={"noise_v_y": 0.05})
    found = track(wrong(), recording, ("F_yf", "F_yr"), how=how)
    for name in ("F_yf", "F_yr"):
        true = getattr(truth, name)
        assert rms(found.values[name] - true) < 0.05 * np.max(np.abs(true))
        assert np.mean(np.abs(found.values[name] - true) < 2 * found.sds[name]) > 0.85


@both_kinds
def test_driving_straight_leaves_the_stiffness_open_and_says_so(kind):
    recording, _ = swerving(24.0, straight=12.0)
    found = track(simrod(C_alpha_f=C_F, C_alpha_r=C_R), recording, TWO, how=TrackOptions(kind, noise=QUIET, tune=0))
    straight, swerved = found.time < 11.9, found.time > 14.0
    for name in TWO:
        share = found.sds[name] / found.values[name]
        assert np.all(share[straight] > 0.15)
        assert np.all(share[swerved] < 0.1)
        assert 0.3 < found.told[name] < 0.6
        (said,) = (sentence for sentence in found.sentences if sentence.startswith(f"{name}: "))
        assert "of the rows, mostly where the slip angle is below 0." in said
        assert f"Even in these rows, the lateral force F_y{name[-1]} is identifiable." in said


def test_a_stiffness_that_a_factor_scales_is_left_open_in_the_same_words():
    recording, _ = swerving(12.0, straight=20.0)
    found = track(car("lateral"), recording, TWO, noise=QUIET, tune=0)
    assert found.tracked == ("stiffness_f", "stiffness_r")
    assert [s.split(":")[0] for s in found.sentences] == ["C_alpha_f", "C_alpha_r"]
    assert ": not identifiable in 100 % of the rows;" in found.sentences[0]
    np.testing.assert_allclose(found.sds["C_alpha_f"] / found.values["C_alpha_f"], found.sds["stiffness_f"] /
                               found.values["stiffness_f"], rtol=1e-6)  # fmt: skip


def test_what_is_tracked_is_carried_over_from_run_to_run():
    """Each run starts from its readings, but knows the tyres."""
    first, second = swerving(15.0)[0], swerving(5.0, seed=1)[0]
    both = join([first, second], "two laps")
    how = TrackOptions(noise=QUIET, tune=0)
    found = track(wrong(), both, TWO, how=how)
    alone, new = (track(wrong(), own, TWO, how=how) for own in (first, second))
    at = len(first)
    np.testing.assert_array_equal(found.run, np.repeat([0, 1], [at, len(second)]))
    np.testing.assert_array_equal(found.rows, np.arange(len(both)))
    for name in TWO:
        np.testing.assert_allclose(found.values[name][:at], alone.values[name], rtol=1e-12)
        assert found.values[name][at] == pytest.approx(alone.values[name][-1], rel=0.02)
        assert found.sds[name][at] < 0.5 * new.sds[name][0]
    assert found.sds["sideslip"][at] > 2 * found.sds["sideslip"][at - 1]


@both_kinds
def test_a_long_gap_in_an_input_begins_a_new_run(kind):
    recording, _ = swerving(10.0)
    steer = recording["steer"].copy()
    steer[200:300] = np.nan
    found = track(true_simrod(), changed(recording, steer=steer), how=TrackOptions(kind, noise=QUIET))
    np.testing.assert_array_equal(found.rows, [*range(200), *range(300, 500)])
    assert list(np.unique(found.run)) == [0, 1]
    assert any("starts anew" in sentence for sentence in found.sentences)


@both_kinds
def test_a_long_recording_is_tracked_part_by_part_alike(kind, monkeypatch):
    first, second = shaken(8.0)[0], shaken(5.0, seed=3)[0]
    how = TrackOptions(kind, noise=WALKS | NOISES)
    once = track(wrong(), join([first, second], "two runs"), TWO, how=how)
    monkeypatch.setattr(filtering, "PART", 37)
    parts = track(wrong(), join([first, second], "two runs"), TWO, how=how)
    for name in once.values:
        np.testing.assert_allclose(parts.values[name], once.values[name], rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(parts.sds[name], once.sds[name], rtol=1e-8)
    for name in once.innovations:
        np.testing.assert_allclose(parts.innovations[name], once.innovations[name], rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(parts.expected[name], once.expected[name], rtol=1e-8)
    assert parts.log_likelihood == pytest.approx(once.log_likelihood)
    assert parts.sentences == once.sentences


@both_kinds
def test_a_glitch_of_the_steering_is_bridged_and_said_and_moves_nothing(kind):
    recording, _ = shaken(20.0)
    steer = recording["steer"].copy()
    steer[400] += 0.2
    clean, glitch = (
        track(true_simrod(), own, how=TrackOptions(kind, noise=WALKS | NOISES))
        for own in (recording, changed(recording, steer=steer))
    )
    (said,) = glitch.sentences
    assert "t = 8.00 s" in said
    assert "These values are treated as missing and are bridged." in said
    off = np.abs(glitch.values["sideslip"] - clean.values["sideslip"])
    assert np.all(off < 0.1 * clean.sds["sideslip"])
    np.testing.assert_array_equal(np.delete(glitch.recording["steer"], 400), np.delete(steer, 400))


@both_kinds
def test_a_glitch_of_a_reading_is_gated(kind):
    recording, _ = shaken(20.0)
    a_y = recording["a_y"].copy()
    a_y[500] += 50 * NOISES["noise_a_y"]
    clean, glitch = (
        track(true_simrod(), own, how=TrackOptions(kind, noise=WALKS | NOISES))
        for own in (recording, changed(recording, a_y=a_y))
    )
    off = np.abs(glitch.values["sideslip"] - clean.values["sideslip"])
    assert np.all(off < 0.5 * clean.sds["sideslip"])
    assert glitch.consistency["a_y"].gated == clean.consistency["a_y"].gated + 1


def test_readings_that_are_not_named_are_not_used():
    """Measured sideslip and v_y may be there, or wrong, or missing."""
    recording, _ = swerving(10.0)
    found = track(wrong(), recording, TWO, noise=QUIET, tune=5.0)
    for other in (without(recording, "v_y"), changed(recording, v_y=recording["v_y"] + 3.0, sideslip=recording["a_y"])):
        again = track(wrong(), other, TWO, noise=QUIET, tune=5.0)
        for name in found.values:
            np.testing.assert_array_equal(again.values[name], found.values[name])
            np.testing.assert_array_equal(again.sds[name], found.sds[name])
    assert set(found.innovations) == {"yaw_rate", "a_y"}


def test_missing_readings_are_done_without():
    recording, truth = shaken()
    sparse = np.where(np.arange(len(recording)) % 5 == 0, recording["a_y"], np.nan)
    found = track(true_simrod(), changed(recording, a_y=sparse), noise=WALKS | NOISES)
    assert found.consistency["a_y"].count == len(recording) // 5
    assert np.mean(np.abs(found.values["sideslip"] - truth) < 2 * found.sds["sideslip"]) > 0.9
    no_a_y = track(true_simrod(), without(recording, "a_y"), noise=WALKS | NOISES)
    assert set(no_a_y.consistency) == {"yaw_rate"}
    assert np.median(found.sds["sideslip"]) < np.median(no_a_y.sds["sideslip"])


@pytest.mark.parametrize("what", [np.inf, -np.inf])
def test_a_reading_that_is_not_finite_counts_as_missing(what):
    recording, _ = shaken(10.0)
    missing, odd = (
        track(true_simrod(), changed(recording, a_y=np.where(np.arange(len(recording)) == 100, v, recording["a_y"])),
              noise=WALKS | NOISES) for v in (np.nan, what)
    )  # fmt: skip
    np.testing.assert_array_equal(odd.values["sideslip"], missing.values["sideslip"])


def test_a_belief_in_parameters_widens_the_bands():
    recording, _ = shaken(10.0)
    model = true_simrod()
    certain = track(model, recording, noise=WALKS | NOISES)
    model = model.with_parameters(replace(model["C_alpha_r"], fixed=False, prior=Prior(0.1 * C_R)))
    doubted = track(model, recording, noise=WALKS | NOISES)
    np.testing.assert_array_equal(doubted.values["sideslip"], certain.values["sideslip"])
    moved = track(true_simrod(C_alpha_r=1.1 * C_R), recording, noise=WALKS | NOISES).values["sideslip"]
    expected = np.hypot(certain.sds["sideslip"], moved - certain.values["sideslip"])
    np.testing.assert_allclose(doubted.sds["sideslip"], expected, rtol=1e-9)


def test_a_fit_s_covariance_takes_the_place_of_beliefs():
    recording, _ = shaken(10.0)
    model, moves = true_simrod(), np.zeros((1, true_simrod().size))
    moves[0, [p.name for p in model.parameters].index("C_alpha_r")] = 0.1 * C_R
    doubted = model.with_parameters(replace(model["C_alpha_r"], fixed=False, prior=Prior(0.1 * C_R)))
    by_fit = track(model, recording, noise=WALKS | NOISES, uncertain=moves)
    by_belief = track(doubted, recording, noise=WALKS | NOISES)
    np.testing.assert_allclose(by_fit.sds["sideslip"], by_belief.sds["sideslip"], rtol=1e-12)


@pytest.fixture(scope="module")
def reference():
    """The full-size car with its nonlinear tyres and no drive recorded, and what it went through."""
    given = commands(seconds=20.0)
    read = simulate(FULL_SIZE_CAR, given, None, start=(given["v_x"][0], 0.0, 0.0))
    random = np.random.default_rng(0)
    noise = {"v_x": 0.02, "yaw_rate": 0.005, "a_y": 0.1}
    signals = {n: read[n] + sd * random.standard_normal(len(read[n])) for n, sd in noise.items()}
    return Recording("reference", given["time"], {"steer": given["steer"], **signals}), read


@both_kinds
def test_an_independent_vehicle_is_tracked_with_a_driving_force_nobody_recorded(kind, reference):
    recording, truth = reference
    found = track(build("single_track", None, None, vehicle("full_size_car")), recording, how=TrackOptions(kind))
    assert found.tracked == ("drive_force",)
    off = found.values["sideslip"] - np.arctan2(truth["true_v_y"], truth["true_v_x"])
    late = found.time > 2.0
    assert rms(off[late]) < np.radians(0.3)
    assert np.mean(np.abs(off) < 2 * found.sds["sideslip"]) > 0.9
    for axle in "fr":
        assert rms(found.values[f"F_y{axle}"] - truth[f"F_y{axle}"]) < 0.06 * np.max(np.abs(truth[f"F_y{axle}"]))


def test_progress_is_told(swerve):
    said = []
    track(wrong(), swerve[0], TWO, tune=3.0, say=said.append)
    assert said[0].startswith("tuning ")
    assert "EKF over 1500 rows" in said


def test_a_table_holds_every_estimate_with_its_sd(swerve):
    found = track(wrong(), swerve[0], TWO, tune=0)
    table = found.table()
    names = ("sideslip", "v_y", "yaw_rate", "C_alpha_f", "C_alpha_r", "F_yf", "F_yr", "alpha_f", "alpha_r")
    assert set(found.values) == set(names)
    assert list(table)[:4] == ["time", "run", "sideslip", "sideslip_sd"]
    assert set(table) == {"time", "run", *names, *(f"{name}_sd" for name in names)}
    assert found.units["sideslip"] == "rad"
    assert found.units["C_alpha_f"] == "N/rad"
    assert found.units["F_yr"] == "N"
    assert np.all(np.isfinite(table.to_numpy()))
    np.testing.assert_array_equal(table["time"], swerve[0].time)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"parameters": ("C_alpha_g",)}, "could be tracked. Did you mean C_alpha_"),
        ({"readings": ("yaw_rate", "a_yy")}, "lateral has no output a_yy to be read. Did you mean a_y?"),
        ({"coloured": ("ay",)}, "ay"),
        ({"readings": ("a_y",), "drop": ("a_y",)}, "has none of a_y, which the filter is to read"),
        ({"noise": {"walk_vy": 1.0}}, "There is no noise walk_vy. Did you mean walk_v_y?"),
    ],
)
def test_names_that_mean_nothing_are_sentences(swerve, more, said):
    more = dict(more)
    recording = without(swerve[0], *more.pop("drop", ()))
    with pytest.raises(BadInput) as caught:
        track(simrod(), recording, tune=0, **more)
    assert said in str(caught.value)


def test_an_effect_is_tracked_without_being_in_the_model():
    recording, _ = shaken(30.0)
    tilted = changed(recording, a_y=recording["a_y"] + 0.4)
    noise = WALKS | NOISES | {"walk_accel_bias_y": 0.01}
    found = track(true_simrod(), tilted, ("accel_bias_y",), effects=EFFECTS, noise=noise)
    assert found.values["accel_bias_y"][-1] == pytest.approx(0.4, abs=3 * found.sds["accel_bias_y"][-1])
    assert found.sds["accel_bias_y"][-1] < 0.15


def test_in_plain_python_it_is_the_same(monkeypatch):
    recording, _ = shaken(2.0)
    compiled = {kind: track(wrong(), recording, TWO, how=TrackOptions(kind, tune=0)) for kind in ("ekf", "ukf")}
    monkeypatch.setenv("GREYBOX_COMPILE", "0")
    for kind, expected in compiled.items():
        found = track(wrong(), recording, TWO, how=TrackOptions(kind, tune=0))
        for name in expected.values:
            np.testing.assert_allclose(found.values[name], expected.values[name], rtol=1e-8, atol=1e-9)
            np.testing.assert_allclose(found.sds[name], expected.sds[name], rtol=1e-7)
