"""`greybox fit`, `predict`, `validate` and `models` as a user calls them."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from calling import greybox, refused

from greybox_id.datasets.shipped import shipped

GREYBOX = [sys.executable, "-c", "from greybox_id.cli import main; main()"]
SMALL_LAT = ["--set", "n_delta=3", "--set", "q=4", "--strength", "1", "--solver", "gauss-newton"]
SMALL_FULL = [
    *("--set", "lat.n_delta=3", "--set", "lat.q=4", "--set", "long.gamma=3", "--set", "long.eta=2"),
    *("--strength", "1", "--solver", "gauss-newton"),
]


@pytest.fixture(scope="module")
def short(tmp_path_factory) -> Path:
    """The first 20 s of the shipped recording."""
    path = tmp_path_factory.mktemp("data") / "short.csv"
    path.write_text("".join(shipped("racer_valid").open().readlines()[:400]))
    return path


@pytest.fixture(scope="module")
def full(short, tmp_path_factory) -> tuple[Path, dict]:
    """A small closed-loop fit, and what it printed."""
    out = tmp_path_factory.mktemp("full")
    done = greybox(
        "fit", "--model", "msnn_full", short, "--columns", "roboracer", "--validate", short, "--out", out, "--json",
        *SMALL_FULL,
    )  # fmt: skip
    assert done.code == 0, done.err
    return out / "fit.json", done.told


def test_json_holds_what_the_contract_names(full):
    _, told = full
    for output in ("yaw_rate", "a_x"):
        for protocol in ("honest", "published", "closed_loop"):
            error = told["metrics"]["validate"][protocol][output]
            assert error["rmse"] > 0
            assert error["fvu"] > 0
    assert all(told["cpu_seconds"][stage] > 0 for stage in ("lat", "long", "full"))
    assert told["parameters"]["lat"] == 4 * 3 * 2 * 2 + 5 * 2 * 2
    assert told["parameters"]["lat"] + told["parameters"]["long"] == told["parameters"]["full"]
    assert told["mode"] == "given"


@pytest.mark.slow
def test_a_fit_predicts_and_validates(full, short, tmp_path):
    fit, told = full
    done = greybox("validate", fit, short, "--columns", "roboracer", "--json")
    assert done.code == 0
    assert done.told["metrics"][str(short)] == told["metrics"]["validate"]
    for suffix in ("csv", "parquet"):
        out = tmp_path / f"p.{suffix}"
        done = greybox("predict", fit, short, "--columns", "roboracer", "--out", out)
        assert done.code == 0
        assert out.stat().st_size > 1000
    header = (tmp_path / "p.csv").read_text().splitlines()[0]
    assert header == "time,run,yaw_rate,yaw_rate_predicted,a_x,a_x_predicted"


def test_a_person_sees_units_uncertainty_and_what_was_written(short, tmp_path):
    done = greybox("fit", "--model", "msnn_lat", short, "--columns", "roboracer", "--out", tmp_path, *SMALL_LAT)
    assert done.code == 0
    assert "rad/s" in done.out
    assert "±" in done.out
    assert str(tmp_path / "fit.json") in done.out


def test_fits_with_the_same_seed_are_the_same(short, tmp_path):
    for name in ("a", "b"):
        done = greybox(
            "fit", "--model", "msnn_lat", short, "--columns", "roboracer", "--out", tmp_path / name, *SMALL_LAT,
            "--starts", "2", "--seed", "3",
        )  # fmt: skip
        assert done.code == 0
    a, b = (json.loads((tmp_path / name / "fit.json").read_text())["parameters"] for name in ("a", "b"))
    assert a == b


def test_early_stopping_says_which_mode_was_used(short, tmp_path):
    done = greybox(
        "fit", "--model", "msnn_lat", short, "--columns", "roboracer", "--validate", short, "--out", tmp_path,
        "--early-stopping", "--set", "n_delta=3", "--set", "q=4", "--json",
    )  # fmt: skip
    assert done.code == 0
    assert done.told["mode"] == "early stopping"


BAD_MAP = 'name = "bad"\n[time]\ncolumn = "t"\nunit = "s"\n[signals.yaw_rate]\ncolumn = "yaw_rate"\nunit = "m/s"\n'


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda d, _: (d / "missing.csv", "roboracer"), "missing.csv"),
        (lambda d, _: (d, "roboracer"), "folder"),
        (lambda d, _: (_written(d / "empty.csv", ""), "roboracer"), "empty.csv"),
        (lambda d, s: (_written(d / "nocol.csv", s.read_text().replace("current", "amps")), "roboracer"), "current"),
        (lambda d, s: (_written(d / "text.csv", s.read_text() + "1,2,x,4,5,6,7,8,9,10\n"), "roboracer"), "row 401"),
        (lambda d, s: (s, str(_written(d / "bad.toml", BAD_MAP))), "m/s"),
        (lambda d, s: (s, "canonical"), "time"),
        (lambda d, s: (s, "roboracr"), "roboracer"),
    ],
    ids=["no file", "directory", "empty", "missing column", "text", "wrong unit", "wrong map", "no map"],
)
def test_bad_input_is_a_sentence_and_exit_code_2(make, says, short, tmp_path):
    file, columns = make(tmp_path, short)
    assert says in refused("fit", "--model", "msnn_lat", file, "--columns", columns, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--model", "msnn_lta"], "Did you mean msnn_lat?"),
        (["--model", "msnn_lat", "--set", "n_dlta=3"], "Did you mean n_delta?"),
        (["--model", "msnn_lat", "--set", "n_delta=two"], "two"),
        (["--model", "msnn_lat", "--set", "n_delta=0"], "between 1 and 50"),
        (["--model", "msnn_lat", "--with", "steering_rate_limt=2"], "Did you mean steering_rate_limit?"),
        (["--model", "msnn_lat", "--early-stopping"], "--validate"),
        (["--model", "msnn_lat", "--set", "sample_time=0.01"], "sampled every"),
    ],
)
def test_wrong_use_is_a_sentence_and_exit_code_2(arguments, says, short, tmp_path):
    assert says in refused("fit", short, "--columns", "roboracer", "--out", tmp_path / "out", *arguments)


def test_output_that_cannot_be_written_is_a_sentence(short, tmp_path):
    (tmp_path / "file").write_text("in the way")
    done = greybox(
        "fit", "--model", "msnn_lat", short, "--columns", "roboracer", "--out", tmp_path / "file", *SMALL_LAT
    )
    assert done.code == 2
    assert "cannot be written" in done.err


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.1, 0.9, 1.6])
def test_ctrl_c_keeps_the_best_so_far(seconds, tmp_path):
    """While the second part is fitted, and later, wherever it may be by then."""
    arguments = ["fit", "--model", "msnn_full", shipped("racer_train"), "--columns", "roboracer", "--strength", "1"]
    process = subprocess.Popen(
        [*GREYBOX, *map(str, arguments), "--out", str(tmp_path / "out"), "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_heeds_interrupts,
    )  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:  # the first part is done
        if line.startswith("msnn_lat"):
            break
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=120)
    saved = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert len(saved["stages"]) > 1
    if seconds > 0.1:
        assert process.returncode in (130, 0, -signal.SIGINT)  # the last two: it had ended
        return
    assert process.returncode == 130
    assert any("interrupted" in stage["status"] for stage in json.loads(printed)["stages"])


def _heeds_interrupts():
    """What shells start in the background ignores interrupts, and hands that on to its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_models_lists_every_model_with_its_size():
    done = greybox("models", "--json")
    told = done.told["models"]
    assert {name: told[name]["parameters"] for name in ("msnn_lat", "msnn_long", "msnn_full")} == {
        "msnn_lat": 160, "msnn_long": 384, "msnn_full": 544,
    }  # fmt: skip


def _written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path
