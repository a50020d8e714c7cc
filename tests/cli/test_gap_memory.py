"""`greybox gap --fit` on a fit of a model with memory, diagnosis included."""

import json

import numpy as np
import pytest
from calling import greybox, refused
from driven import without, written
from toys import drive, tiny

from greybox_id.datasets.recording import join
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.memory import predictions
from greybox_id.fitting.verb import fit
from greybox_id.models.effects import EFFECTS


def made(late, seed):
    """Two runs of the map itself, read with noise, and late."""
    model = tiny("msnn_full") + EFFECTS["sensor_latency_imu"].at(late)
    given, rng = join([drive(300, 2 * seed + k) for k in (0, 1)], "made"), np.random.default_rng(seed)
    found = predictions(model, given, "closed_loop")
    read = {name: np.array(given[name]) for name in model.outputs}
    for k, name in enumerate(model.outputs):
        read[name][found.rows] = found.predicted[:, k] + 0.1 * rng.standard_normal(len(found.rows))
    return given.with_signals(**read)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A small fit, laps whose sensors are late, and one whose are not."""
    folder = tmp_path_factory.mktemp("memory")
    found = fit(tiny("msnn_full"), [made(0.0, 0)], how=FitOptions(strengths=1.0, solver="gauss-newton"))
    laps = [written(made(late, seed), folder / f"lap{seed}.csv") for seed, late in ((1, 0.05), (2, 0.05), (3, 0.0))]
    return found.save(folder / "fit.json"), *laps


def test_a_gap_is_told_as_of_any_other_model(files, tmp_path):
    fitted, lap, other, _ = files
    called = greybox("gap", lap, "--fit", fitted, "--held-out", other, "--out", tmp_path / "gap", "--json")
    assert called.code == 0, called.err
    told = called.told
    assert told["gap_detected"]
    assert told["applied"] == ["sensor_latency_imu"]
    assert told["ranking"][0]["magnitude"] == pytest.approx(0.05, abs=0.01)
    assert set(told) >= {"p_value", "unknown_probability", "where", "ranking", "applied", "gap", "held_out"}
    assert told["held_out"]["closed"] > 0.7
    assert {file.name for file in (tmp_path / "gap").iterdir()} == {"gap.json", "gap.png", "gap.pdf"}
    assert json.loads((tmp_path / "gap" / "gap.json").read_text())["gap"] == told["gap"]
    assert "closed.toml is not written" in called.err


def test_no_gap_is_told_to_people(files):
    fitted, *_, same = files
    called = greybox("gap", same, "--fit", fitted, "--check")
    assert called.code == 0, called.err
    assert "No gap" in called.out


def test_bad_input_is_a_sentence(files, tmp_path):
    fitted, lap, *_ = files
    assert "no place for the weights of msnn_full" in refused(
        "gap", lap, "--fit", fitted, "--apply", tmp_path / "c.toml"
    )
    assert not (tmp_path / "c.toml").exists()
    blind = written(without(made(0.0, 5), "motor_current"), tmp_path / "blind.csv")
    assert "motor_current" in refused("gap", blind, "--fit", fitted)
    assert "motor_current" in refused("gap", lap, "--fit", fitted, "--held-out", blind)
    short = written(drive(4), tmp_path / "short.csv")
    assert "no unbroken run" in refused("gap", short, "--fit", fitted)
    assert "--fit" in refused("gap", lap, "--vehicle", "roboracer", "--model", "msnn_lat")
    assert "same data" in refused("gap", lap, "--fit", fitted, "--held-out", lap)
