"""The bicycle of Table II as its authors coded it: written out once more; what its sampling leaves in the tables."""

import json

import numpy as np
import pytest
from json_pages import PAGE, agree
from made_up_truck import truck_file
from scipy.stats import norm

from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import quiet
from greybox_id.fitting.posterior import abc_smc
from greybox_lab.papers import truck as bench
from greybox_lab.papers import truck_authors
from greybox_lab.papers.bench import KeptBench
from greybox_lab.papers.truck import _of_authors
from greybox_lab.papers.truck_authors import PRIORS, WindowDistances, authors_errors, authors_particles

TYPICAL = dict(zip(PRIORS, [1.2e5, 9.7, 5.2, 0.4, 0.6, 7, 1.5, 0.8, -2, 6, 1.2, 0.9, -1], strict=True))


def driven(seed=0, runs=2, rows=50):
    rng = np.random.default_rng(seed)
    signals = {"v_x": 15 + rng.normal(0, 1, runs * rows), "steer": rng.normal(0, 0.05, runs * rows),
               "v_y": rng.normal(0, 0.1, runs * rows), "yaw_rate": rng.normal(0, 0.05, runs * rows)}  # fmt: skip
    return Recording("made up", 0.05 * np.arange(runs * rows), signals,
                     runs=tuple((k * rows, (k + 1) * rows) for k in range(runs)))  # fmt: skip


def followed(state, inputs, p):
    """Forward Euler, one number after the other."""
    v_y, r = state
    found = []
    for v_x, steer in inputs:
        l_r = p["l"] - p["l_f"]
        y, x = v_y + (p["l_f"] + p["a"]) * r, v_x + (1.25 + p["b"]) * r
        along = x * np.cos(steer) + (y + p["l_f"] * r) * np.sin(steer)
        across = (y + p["l_f"] * r) * np.cos(steer) - x * np.sin(steer)
        slips = {"f": steer - np.arctan(across / along), "r": -np.arctan((y - l_r * r) / x)}
        force = {}
        for axle, length in (("f", p["l_f"]), ("r", l_r)):
            B, C, D, E = (p[f"{letter}_{axle}"] for letter in "BCDE")
            z = B * np.clip(slips[axle], -1, 1)
            force[axle] = 18781 * 9.81 * length / p["l"] * D * np.sin(C * np.arctan(z - E * (z - np.arctan(z))))
        force["f"] *= np.cos(steer)
        turning = (p["l_f"] * force["f"] - l_r * force["r"]) / p["I_z"]
        v_y += 0.05 * ((force["f"] + force["r"]) / 18781 - (p["l_f"] + p["a"]) * turning)
        r += 0.05 * turning
        found.append((v_y, r))
    return np.array(found)


def test_it_is_what_its_equations_say_of_every_trajectory_from_its_first_row():
    recording, p = driven(), np.array(list(TYPICAL.values()))
    found = authors_errors(recording, [p.tolist()])
    assert found.shape == (1, 2, 49, 2)
    for k, (a, b) in enumerate(recording.runs):
        read = np.column_stack([recording["v_y"], recording["yaw_rate"]])[a:b]
        inputs = np.column_stack([recording["v_x"], recording["steer"]])[a : b - 1]
        np.testing.assert_allclose(found[0, k], followed(read[0], inputs, TYPICAL) - read[1:], rtol=1e-9, atol=1e-12)


def test_windows_do_not_overlap_and_stay_in_their_trajectory():
    recording, p = driven(), np.array(list(TYPICAL.values()))
    assert WindowDistances(recording, 20).errors(p).shape == (4, 20, 2)  # two of the 49 steps of each trajectory
    scale = [np.std(recording[name]) for name in ("v_y", "yaw_rate")]
    away = WindowDistances(recording, 49)(np.array([p, p * np.nan]))
    assert away[0] == pytest.approx(np.sqrt(np.mean((authors_errors(recording, [p])[0] / scale) ** 2)))
    assert away[1] == np.inf


@pytest.fixture
def few(tmp_path, monkeypatch):
    """A folder of small recordings, and a short schedule."""
    for k, split in enumerate(("train", "val")):
        truck_file(tmp_path / f"{split}.parquet", 3, k)
    monkeypatch.setattr(abc_smc, "TARGETS", (0.5, 0.3))
    for name, value in (("PILOT", 100), ("FEWEST_ACCEPTED", 20)):
        monkeypatch.setattr(abc_smc, name, value)
    monkeypatch.setattr(truck_authors, "PARTICLES", 40)
    monkeypatch.setattr(truck_authors, "TRIALS", 100)
    return tmp_path


@pytest.mark.slow
def test_particles_come_nearer_and_rows_are_of_the_fifteen_nearest(few):
    kept = KeptBench("truck", few / "kept.json")
    rows = _of_authors(few, quiet, kept)
    assert [(row["model"].split(", ")[-1], row["split"]) for row in rows] == [
        (horizon, split) for horizon in ("1 s", "0.5 s", "0.05 s", "1 s") for split in ("train", "val")
    ]
    assert {row["table"] for row in rows} == {"II"}
    assert {(row["parameters"], row["particles"], row["trajectories"]) for row in rows} == {(13, 15, 3)}
    assert all(row["v_y_sd_over_particles"] > 0 for row in rows)
    agree(rows, PAGE["bench truck"]["rows[]"], "bench truck")
    again = _of_authors(few, quiet, KeptBench("truck", few / "kept.json", minutes=0.0))
    assert again == rows
    assert ["as published" in row["model"] for row in rows] == [True] * 6 + [False] * 2
    prior = WindowDistances(bench.splits(few, bench.published_signs, False)["train"].recording, 20)
    rng = np.random.default_rng(1)
    drawn = np.array([mean + sd * rng.standard_normal(100) for mean, sd in PRIORS.values()]).T
    for told in json.loads((few / "kept.json").read_text())["trainings"].values():
        assert (told["population"], len(told["x"])) == (2, 15)
        if told["about"]["horizon"] == 1.0:
            assert np.max(prior(np.array(told["x"]))) < np.quantile(prior(drawn), 0.3)


@pytest.mark.slow
def test_test_is_scored_by_what_train_alone_sampled(few):
    before = _of_authors(few, quiet, KeptBench("truck"))
    truck_file(few / "test.parquet", 3, 7)
    after = _of_authors(few, quiet, KeptBench("truck"))
    without = [
        {name: own for name, own in row.items() if name != "cpu_seconds"} for row in after if row["split"] != "test"
    ]
    assert without == [{name: own for name, own in row.items() if name != "cpu_seconds"} for row in before]
    assert sum(row["split"] == "test" for row in after) == 4


def test_ctrl_c_says_where_trainings_are(few, monkeypatch):
    said = []

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(bench, "authors_particles", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _of_authors(few, lambda line, **_: said.append(line), KeptBench("truck", few / "kept.json"))
    assert "kept.json" in said[-1]


@pytest.mark.parametrize("as_published", [pytest.param(True, marks=pytest.mark.slow), False])
def test_the_same_seed_draws_the_same(few, as_published):
    train = bench.splits(few, bench.published_signs, False)["train"].recording
    one, other, third = (authors_particles(train, 0.5, seed, as_published)["x"] for seed in (0, 0, 1))
    assert one == other != third


def test_published_weights_divide_by_a_sum_over_parameters():
    rng = np.random.default_rng(3)
    before = abc_smc.ParticleSet(1, rng.standard_normal((5, 3)), rng.dirichlet(np.ones(5)), np.zeros(5), 1.0, 1.0)
    at = rng.standard_normal((4, 3))
    by_hand = [
        norm.pdf(own).prod()
        / sum(w * norm.pdf(own, b, 0.1).sum() for w, b in zip(before.weight, before.at, strict=True))
        for own in at
    ]
    found = truck_authors._published_weights(at, before)
    np.testing.assert_allclose(found, np.array(by_hand) / np.sum(by_hand), rtol=1e-9)
