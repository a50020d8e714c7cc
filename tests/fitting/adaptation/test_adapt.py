"""A fit adapted to a changed car: what changed is found, what did not change stays, and what follows is predicted."""

from dataclasses import replace

import numpy as np
import pytest
from calling import greybox, refused
from late_readings import NOISE, car, driven
from toys import drive, without

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import join
from greybox_id.fitting.adaptation.choosing import (
    BETWEEN_RUNS,
    STRENGTHS,
    AdaptedCandidate,
    between_runs,
    chosen,
    foretold,
)  # fmt: skip
from greybox_id.fitting.adaptation.verb import adapt, parted
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.memory import predictions
from greybox_id.fitting.scores.timing import run_delays
from greybox_id.fitting.verb import fit
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build, prepared


@pytest.fixture(scope="module")
def trained():
    return driven(car(), 2000, 1)


@pytest.fixture(scope="module")
def fitted(trained):
    model = prepared("msnn_bench_lat", trained)
    return fit(model, [trained], how=FitOptions(strengths=1.0, solver="gauss-newton"))


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_a_car_whose_steering_was_set_otherwise_is_found_and_what_follows_is_predicted(fitted, trained, seed):
    changed = car() + EFFECTS["steering_offset"].at(-0.03)
    found = adapt(fitted, driven(changed, 900, seed), trained=[trained])
    assert "few" in found.choices["yaw_rate"]
    assert float(found.fit.model["steering_offset"].array) == pytest.approx(-0.03, abs=0.006)
    assert found.chosen.rest["yaw_rate"].rmse < 1.1 * NOISE < found.zero_shot.rest["yaw_rate"].rmse
    low, high = found.chosen.interval["yaw_rate"]
    assert low < found.chosen.rest["yaw_rate"].rmse < high


@pytest.mark.parametrize("known", [True, False])
def test_where_nothing_changed_adapting_costs_nothing(fitted, trained, known):
    for seed in range(10, 15):
        found = adapt(fitted, driven(car(), 700, seed), trained=[trained] if known else None)
        before, after = found.zero_shot.rest["yaw_rate"], found.chosen.rest["yaw_rate"]
        assert after.rmse < before.rmse + before.rmse_sd


@pytest.mark.parametrize("late", [-0.03, 0.02, 0.07])
def test_a_delay_is_found_run_by_run(fitted, late):
    both = join([driven(car(), 300, 20, late), driven(car(), 300, 21, 0.0)], "both")
    first, second = run_delays(fitted.model, both, {"yaw_rate": NOISE})
    assert first.delay == pytest.approx(late, abs=0.005)
    assert second.delay == pytest.approx(0.0, abs=0.005)


def test_timing_is_taken_back_and_calibrated_in_runs_that_follow(fitted, trained):
    both = join([driven(car(), 500, 30, 0.03), driven(car(), 400, 31, -0.02)], "both")
    plain = adapt(fitted, both, trained=[trained])
    assert plain.choices["yaw_rate"].startswith("timing")
    assert plain.delays["1"]["yaw_rate"] == pytest.approx(0.03, abs=0.005)
    timed = adapt(fitted, both, trained=[trained], calibrate=("timing",))
    assert timed.calibrated["2"]["yaw_rate"] == pytest.approx(-0.02, abs=0.006)
    assert timed.chosen.rest["yaw_rate"].rmse < 1.15 * NOISE < plain.zero_shot.rest["yaw_rate"].rmse


def test_an_acceleration_is_never_taken_to_be_early():
    recording = drive(300)
    model = prepared("msnn_bench_long", recording)
    early = recording.with_signals(a_x=np.roll(recording["a_x"], -1))
    assert all(own.delay >= 0 for own in run_delays(model, early, {"a_x": 0.1}))


def test_what_the_new_seconds_do_not_show_is_kept_by_the_training_data(fitted, trained):
    """Slow driving alone must not bend the network where it is fast."""
    slow = driven(car() + EFFECTS["steering_offset"].at(0.02), 900, 40)
    slow = slow.with_signals(v_x=slow["v_x"])
    found = adapt(fitted, slow, trained=[trained], free="all")
    fast = driven(car(), 600, 41)
    error = predictions(found.fit.model, fast)
    assert np.sqrt(np.mean((error.predicted - error.measured) ** 2)) < 3 * NOISE


def test_a_whole_recording_may_be_adapted_to_and_another_one_scored(fitted, trained):
    new, other = driven(car(), 600, 50), driven(car(), 300, 51)
    assert adapt(fitted, new, seconds=30, trained=[trained]).chosen.rest == {}
    scored = adapt(fitted, new, seconds=30, validate=other, trained=[trained])
    assert scored.chosen.rest["yaw_rate"].samples == 300 - 20


def test_standing_does_not_count_as_motion():
    still = drive(300)
    still = still.with_signals(v_x=np.where(np.arange(300) < 100, 0.0, still["v_x"]))
    new, rest = parted(still, 5.0)
    assert (len(new), len(rest)) == (200, 100)
    assert parted(still, 10.0)[1] is None
    with pytest.raises(BadInput, match="holds 10 s of motion, but 11 s"):
        parted(still, 11.0)


def test_the_simplest_candidate_is_taken_that_is_not_surely_worse():
    rng = np.random.default_rng(0)
    pieces = 1 + 0.1 * rng.random(20)
    same = AdaptedCandidate("F", 1.0, False, pieces - 0.001 * (-1) ** np.arange(20))
    better = AdaptedCandidate("all", 1.0, False, pieces - 0.5)
    zero = AdaptedCandidate("", np.inf, False, pieces)
    assert chosen([zero, same]) is zero
    assert chosen([zero, same, better]) is better
    assert STRENGTHS != (0.1, 1.0)  # the old recording is never forgotten altogether
    assert min(STRENGTHS) >= 0.2


def test_the_expected_interval_holds_the_error_of_further_seconds():
    rng, held = np.random.default_rng(3), 0
    for _ in range(300):
        pieces = np.array([np.mean(rng.standard_normal(8) ** 2) for _ in range(60)])
        low, high = foretold(pieces[:20], 40.0)
        held += low <= np.sqrt(np.mean(pieces[20:])) <= high
    assert held / 300 > 0.95


def test_the_expected_interval_is_as_wide_as_runs_of_the_old_car_differ(trained):
    """Two runs that differ by a factor of three in their error make what a third one will do uncertain."""
    part, long = build("msnn_bench_lat", {"v_x": [0.5, 4.0]}), 600
    part = part.with_values(car().values)
    alike = [driven(car(), long, seed, noise=0.05) for seed in (1, 2, 3, 4)]
    unlike = [driven(car(), long, seed, noise=0.05 * size) for seed, size in ((1, 1), (2, 3), (3, 1), (4, 3))]
    assert between_runs(part, None) == between_runs(part, alike[:1]) == BETWEEN_RUNS
    small, large = between_runs(part, alike), between_runs(part, unlike)
    spread = np.log(3) * np.array([-0.5, 0.5, -0.5, 0.5])
    assert large == pytest.approx(np.sqrt((3 * BETWEEN_RUNS**2 + np.sum(spread**2)) / 6), rel=0.1)
    assert small == pytest.approx(np.sqrt(3 * BETWEEN_RUNS**2 / 6), rel=0.1)
    pieces = np.ones(20)
    assert foretold(pieces, 40.0, between=small)[1] < foretold(pieces, 40.0, between=large)[1]


@pytest.mark.parametrize(
    ("call", "says"),
    [
        ({"seconds": 0}, "above zero"),
        ({"seconds": 100.0}, "holds 30 s of motion, but 100 s"),
        ({"free": "FF"}, "neither a set of parameters nor"),
        ({"calibrate": ("time",)}, "Write timing, or timing=8s"),
    ],
)
def test_what_cannot_be_adapted_is_a_sentence(fitted, call, says):
    with pytest.raises(BadInput, match=says):
        adapt(fitted, driven(car(), 600, 60), **call)


def test_a_fit_of_another_kind_and_a_recording_that_lacks_a_signal_are_refused(fitted):
    recording = driven(car(), 600, 61)
    with pytest.raises(BadInput, match="lacks steer"):
        adapt(fitted, without(recording, "steer"))
    other = replace(fitted, model=build("kinematic"))
    with pytest.raises(BadInput, match="No parameter of this fit"):
        adapt(other, recording)
    with pytest.raises(BadInput, match="it holds no covariance"):
        adapt(replace(fitted, model=build("mlp_lateral")), recording)


def test_the_command_writes_an_adapted_fit_and_refuses_in_sentences(fitted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fitted.save("fit.json")
    table = driven(car() + EFFECTS["steering_offset"].at(-0.03), 900, 70).to_pandas().drop(columns="run")
    table.to_csv("new.csv", index=False)
    told = greybox("adapt", "fit.json", "new.csv", "--seconds", 20, "--out", "adapted", "--json").told
    for role in ("chosen", "zero_shot", "adapted"):
        assert set(told[role]["rest"]["yaw_rate"]) >= {"rmse", "stderr"}
        assert len(told[role]["interval"]["yaw_rate"]) == 2
    again = gb.load(told["written"])
    assert again.model.effects == ("steering_ratio", "steering_offset")
    assert greybox("adapt", "fit.json", "new.csv", "--out", "adapted").code == 0  # the same place, again
    assert "holds 45 s of motion" in refused("adapt", "fit.json", "new.csv", "--seconds", 60)
    assert "--free" in refused("adapt", "fit.json", "new.csv", "--free", "nothing")
    assert "nofile.csv" in refused("adapt", "fit.json", "nofile.csv")
