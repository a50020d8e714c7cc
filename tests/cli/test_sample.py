"""`greybox sample` and `greybox predict --posterior`: as a person uses them."""

import pandas as pd
import pytest
from calling import greybox, refused
from driven import driven, written


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A fit of a small model to a recording beside it, and another recording."""
    folder = tmp_path_factory.mktemp("sampled")
    for seed in (0, 10):
        written(driven("lateral", seed=seed, seconds=4.0), folder / f"lap{seed}.csv")
    called = greybox(
        "fit", "--model", "lateral", folder / "lap0.csv", "--vehicle", "full_size_car", "--set", "tyre=linear",
        "--fix", "m", "--start-from", "measured", "--solver", "gauss-newton", "--out", folder,
    )  # fmt: skip
    assert called.code == 0, called.err
    return folder / "fit.json"


@pytest.fixture(scope="module")
def sampled(fitted):
    out = fitted.parent / "posterior.parquet"
    called = greybox("sample", fitted, "--draws", "200", "--out", out, "--json")
    assert called.code == 0, called.err
    return out, called.told


def test_it_tells_what_was_drawn(sampled):
    out, told = sampled
    assert told["draws"] == 200
    assert told["complete"]
    assert 0 < told["acceptance"] < 1
    assert told["r_hat"] < 1.5
    assert told["ess"] > 20
    assert told["cpu_seconds"] > 0
    own = told["parameters"]["C_alpha_f"]
    assert own["low"] < own["low_noise_alone"] < own["mean"] < own["high_noise_alone"] < own["high"]
    assert own["sd"] > own["sd_noise_alone"]
    frame = pd.read_parquet(out)
    assert list(frame)[:4] == ["chain", "draw", "weight", "log_posterior"]
    assert len(frame) == 200


def test_the_same_command_again_finds_it_done(fitted, sampled):
    out, told = sampled
    again = greybox("sample", fitted, "--draws", "200", "--out", out, "--json")
    assert again.code == 0, again.err
    assert again.told["parameters"] == told["parameters"]


def test_a_person_sees_a_table(fitted, tmp_path):
    called = greybox("sample", fitted, "--method", "laplace", "--draws", "500", "--out", tmp_path / "p.parquet")
    assert called.code == 0, called.err
    assert "500 draws of lateral by laplace" in called.out
    assert "C_alpha_f" in called.out


def test_predictions_have_a_band(fitted, sampled, tmp_path):
    out = tmp_path / "predicted.csv"
    lap = fitted.parent / "lap10.csv"
    called = greybox("predict", fitted, lap, "--posterior", sampled[0], "--out", out, "--json")
    assert called.code == 0, called.err
    assert called.told["posterior"]["level"] == 0.95
    assert all(0.85 < share <= 1 for share in called.told["posterior"]["coverage"].values())
    table = pd.read_csv(out)
    assert (table["v_y_predicted_low"] < table["v_y_predicted"]).all()
    assert (table["v_y_predicted"] < table["v_y_predicted_high"]).all()


def test_other_recordings_than_those_fitted_are_refused(fitted, tmp_path):
    out = tmp_path / "p.parquet"
    said = refused("sample", fitted, fitted.parent / "lap10.csv", "--method", "laplace", "--out", out)
    assert "none of the recordings given" in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--draws", "2"], "draws: a whole number from 10"),
        (["--out", "posterior.csv"], "a posterior is saved as a .parquet file"),
    ],
)
def test_bad_options_are_sentences(fitted, options, words):
    assert words in refused("sample", fitted, *options)


def test_what_is_no_posterior_is_refused(fitted, tmp_path):
    lap = fitted.parent / "lap10.csv"
    out = tmp_path / "p.csv"
    assert "is not a posterior" in refused("predict", fitted, lap, "--posterior", fitted, "--out", out)
    assert "is not there" in refused("predict", fitted, lap, "--posterior", tmp_path / "no.parquet", "--out", out)
    assert not out.exists()


def test_a_network_has_no_posterior(fitted, tmp_path):
    laps = driven("lateral", runs=3, seconds=4.0)
    lap = written(laps, tmp_path / "laps.csv")
    called = greybox(
        "fit", "--model", "mlp_lateral", lap, "--set", "hidden=[4]", "--set", "integrator=euler", "--out", tmp_path
    )
    assert called.code in (0, 3), called.err
    assert "the weights of a network" in refused("sample", tmp_path / "fit.json", "--out", tmp_path / "p.parquet")
