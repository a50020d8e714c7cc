"""What `--json` prints is what docs/json.md says, key by key; cheap forms of every command."""

import json
import re

import click
import pytest
from calling import greybox
from driven import driven, written
from json_pages import PAGE, agree, never_met
from made_gaps import clear
from networks import FOLDER

from greybox_id.cli import greybox as root
from greybox_id.datasets.public import PUBLIC, folder_of
from greybox_id.datasets.shipped import shipped
from greybox_id.gap.gap import CauseClass

LAP, SHIPPED = "lap.csv", str(shipped("racer_valid"))
TINY = ("--model", "msnn_lat", "--set", "n_delta=3", "--set", "q=4", "--strength", "1", "--columns", "roboracer")
MOTION = ("fit", "--model", "lateral", LAP, "--vehicle", "full_size_car", "--set", "tyre=linear", "--fix", "m",
          "--horizon", "1", "--validate", "lap8.csv", "--out", "run")  # fmt: skip
FORMS = {
    "data check": [("data", "check", LAP), ("data", "check", LAP, "--repair", "mended.toml")],
    "data map": [("data", "map", SHIPPED)],
    "data convert": [("data", "convert", LAP, "--out", "lap.mat")],
    "data join": [("data", "join", LAP, "lap8.csv", "--out", "joined.csv")],
    "datasets list": [("datasets", "list")],
    "datasets make": [("datasets", "make", "virtual_lap")],
    "models": [("models",)],
    "models NAME": [("models", "lateral")],
    "effects": [("effects",)],
    "effects NAME": [("effects", "steering_rate_limit")],
    "fit, equations of motion": [MOTION],
    "fit, models with memory and hybrids": [
        ("fit", *TINY, SHIPPED, "--solver", "gauss-newton", "--out", "map"),
        (
            "fit",
            *TINY,
            SHIPPED,
            "--solver",
            "gauss-newton",
            "--out",
            "map",
            "--validate",
            SHIPPED,
            "--calibrate",
            "timing",
        ),
    ],
    "validate": [("validate", "run/fit.json", LAP), ("validate", "net.json", SHIPPED, "--columns", "roboracer")],
    "predict": [
        ("predict", "run/fit.json", LAP),
        ("predict", "net.json", SHIPPED, "--columns", "roboracer"),
        ("predict", "tiny/fit.json", SHIPPED, "--columns", "roboracer", "--calibrate", "timing"),
    ],
    "sample": [("sample", "run/fit.json", "--method", "laplace", "--draws", "50", "--out", "posterior.parquet")],
    "simulate": [("simulate", "run/fit.json", LAP)],
    "profile": [("profile", "run/fit.json", "--parameter", "I_z", "--out", "curve.csv")],
    "grid": [("grid", "msnn_bench_lat", SHIPPED, "--columns", "roboracer", "--set", "q=4,9", "--strength", "1")],
    "adapt": [("adapt", "net.json", SHIPPED, "--columns", "roboracer", "--out", "adapted")],
    "report": [("report", "run/fit.json")],
    "gap": [("gap", LAP, "--vehicle", "full_size_car", "--held-out", "lap8.csv")],
    "track": [("track", LAP, "--vehicle", "full_size_car", "--model", "lateral", "--tune", "0s")],
    "export": [
        ("export", "run/fit.json", "--target", "casadi", "--out", "car"),
        ("export", "--vehicle", "full_size_car", "--target", "autoware", "--out", "aw"),
    ],
    "import": [("import", str(FOLDER / "lat.json"), "--out", "net2.json")],
    "import, vehicles": [("import", "vehicle_info.param.yaml", "--out", "info.toml")],
}
"""Section of the page -> calls that between them show every key that may not be missing."""
FLEET = {f"fleet {name}" for name in ("run", "status", "estimate", "report")}  # held by tests/fleet
ELSEWHERE = {
    "app",
    "bench a2rl",
    "bench abs",
    "bench emps",
    "bench ferrari",
    "fit, tyre",  # held by tests/fitting/test_tyre_rig.py
    "bench loop",
    "bench msnn",
    "bench truck",
    "datasets fetch",
    "design",
    "exam make",
    "exam run",
    "exam score",
    "loop agent",
    "loop demo",
    "serve",
    *FLEET,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two laps, a fit to one of them, and a network."""
    folder = tmp_path_factory.mktemp("json")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("GREYBOX_COMPILE", "0")
        for seed, name in ((0, LAP), (8, "lap8.csv")):
            written(driven("lateral", runs=1, seconds=6.0, seed=seed), folder / name)
        (folder / "fit.out").write_text(greybox(*MOTION, "--json").out)
        greybox("import", FOLDER / "lat.json", "--out", "net.json")
        greybox("fit", *TINY, SHIPPED, "--solver", "gauss-newton", "--out", "tiny")
        (folder / "vehicle_info.param.yaml").write_text("/**:\n  ros__parameters:\n    wheel_base: 2.79\n")
        yield folder


LATE = CauseClass(
    ("steering_delay", "steering_lag"), 0.99, {"steering_delay": 0.95, "steering_lag": 0.04}, "steering_delay"
)
"""The steering acts late: a delay or a lag."""


@pytest.fixture(autouse=True)
def _there(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("GREYBOX_COMPILE", "0")
    monkeypatch.setattr("greybox_id.api.diagnosing.diagnose_gap", lambda *_, **__: clear(classes=(LATE,)))


@pytest.mark.slow
@pytest.mark.parametrize("section", [name for name in FORMS if name != "track"])
def test_keys_are_those_of_the_page(section, folder):
    tree = PAGE[section]
    for call in FORMS[section]:
        told = (folder / "fit.out").read_text() if call == MOTION else greybox(*call, "--json").out
        agree(json.loads(told), tree, section)
    assert list(never_met(tree)) == [own for own in never_met(tree) if own.endswith("?")]


@pytest.mark.slow
def test_keys_of_a_track_are_those_of_the_page(monkeypatch):
    monkeypatch.delenv("GREYBOX_COMPILE")
    (call,) = FORMS["track"]
    agree(greybox(*call, "--json").told, PAGE["track"], "track")
    assert list(never_met(PAGE["track"])) == []


@pytest.mark.slow
def test_keys_of_a_design_are_those_of_the_page(monkeypatch):
    monkeypatch.delenv("GREYBOX_COMPILE")
    part = ("--columns", "roboracer", "--between", "0:20")
    call = ("fit", "--model", "single_track", "--vehicle", "roboracer", SHIPPED, *part, "--out", "st")
    assert greybox(*call).code in (0, 3)
    quick = ("--arena", "disc:12", "--duration", "5", "--effort", "0.03", "--speed-max", "4", "--out", "next")
    agree(greybox("design", "st/fit.json", *quick, "--json").told, PAGE["design"], "design")
    assert list(never_met(PAGE["design"])) == [".separation[].pair", ".separation[].nats", ".separation[].p10"]


def test_keys_of_a_fetch_are_those_of_the_page(monkeypatch):
    monkeypatch.setattr("greybox_id.cli.datasets.fetch", lambda dataset, *_: [folder_of(dataset) / "train.csv"])
    agree(greybox("datasets", "fetch", next(iter(PUBLIC)), "--json").told, PAGE["datasets fetch"])


def test_keys_of_an_examination_are_those_of_the_page(tmp_path):
    exam = tmp_path / "exam"
    agree(greybox("exam", "make", "--out", exam, "--cases", 0, "--nulls", 1, "--json").told, PAGE["exam make"])
    silent = ("--diagnoser", "exam_candidates:silent")
    agree(greybox("exam", "run", exam / "cases", *silent, "--json").told, PAGE["exam run"])
    agree(greybox("exam", "score", exam, "--json").told, PAGE["exam score"])


def test_the_page_has_every_command():
    commands = set()
    for name in root.list_commands(click.Context(root)):
        command = root.get_command(click.Context(root), name)
        commands |= {f"{name} {own}" for own in command.commands} if isinstance(command, click.Group) else {name}
    assert {re.split(r",| NAME", title)[0] for title in PAGE} == commands - {"completion"}
    assert set(PAGE) == {*FORMS, *ELSEWHERE}


@pytest.mark.slow
def test_keys_of_a_bench_are_those_of_the_page(tmp_path, monkeypatch):
    import greybox_lab.papers.msnn as bench

    monkeypatch.setattr(bench, "ENTRIES", bench.ENTRIES[:1])
    monkeypatch.setattr(bench, "_closed", lambda *_: [])
    monkeypatch.setattr(bench, "QUICK_GRIDS", {})
    for name, shipped_as in (("train", "racer_train"), ("valid", "racer_valid"), ("tire_set_1", "racer_valid")):
        (tmp_path / f"{name}.csv").write_bytes(shipped(shipped_as).read_bytes())
    told = greybox("bench", "msnn", "--data", tmp_path, "--quick", "--out", tmp_path / "bench.json", "--json").told
    agree(told, PAGE["bench msnn"], "bench msnn")
    protocols = {(row["table"], row["protocol"]) for row in told["rows"]}
    assert protocols == {(1, "published"), (1, "honest"), (3, "published"), (3, "honest")}
    assert {row["paper"] for row in told["rows"] if row["table"] == 1 and row["split"] == "valid"} == {
        0.154, 0.158, 0.181
    }  # fmt: skip
