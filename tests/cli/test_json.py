"""What `--json` prints is what docs/json.md says, key by key; cheap forms of every command."""

import json
import re

import click
import pytest
from calling import greybox
from documents import page
from driven import driven, written
from made_gaps import clear
from networks import FOLDER

from greybox_id.cli import greybox as root
from greybox_id.datasets.fetch import folder_of
from greybox_id.datasets.public import PUBLIC
from greybox_id.datasets.shipped import shipped

LAP, SHIPPED = "lap.csv", str(shipped("racer_valid"))
TINY = ("--model", "msnn_lat", "--set", "n_delta=3", "--set", "q=4", "--strength", "1", "--columns", "roboracer")
MOTION = ("fit", "--model", "lateral", LAP, "--vehicle", "full_size_car", "--set", "tyre=linear", "--fix", "m",
          "--horizon", "1", "--validate", "lap8.csv", "--out", "run")  # fmt: skip
FORMS = {
    "data check": [("data", "check", LAP)],
    "data map": [("data", "map", SHIPPED)],
    "data convert": [("data", "convert", LAP, "--out", "lap.mat")],
    "datasets list": [("datasets", "list")],
    "datasets make": [("datasets", "make", "virtual_lap")],
    "models": [("models",)],
    "models NAME": [("models", "lateral")],
    "effects": [("effects",)],
    "effects NAME": [("effects", "steering_rate_limit")],
    "fit, equations of motion": [MOTION],
    "fit, maps with memory and hybrids": [("fit", *TINY, SHIPPED, "--solver", "gauss-newton", "--out", "map")],
    "validate": [("validate", "run/fit.json", LAP), ("validate", "net.json", SHIPPED, "--columns", "roboracer")],
    "predict": [("predict", "run/fit.json", LAP), ("predict", "net.json", SHIPPED, "--columns", "roboracer")],
    "simulate": [("simulate", "run/fit.json", LAP)],
    "profile": [("profile", "run/fit.json", "--parameter", "I_z", "--out", "curve.csv")],
    "report": [("report", "run/fit.json")],
    "gap": [("gap", LAP, "--vehicle", "full_size_car", "--held-out", "lap8.csv")],
    "track": [("track", LAP, "--vehicle", "full_size_car", "--model", "lateral", "--tune", "0s")],
    "export": [("export", "run/fit.json", "--target", "casadi", "--out", "car")],
    "import": [("import", str(FOLDER / "lat.json"), "--out", "net2.json")],
}
"""Section of the page -> calls that between them show every key that may not be missing."""
ELSEWHERE = {"datasets fetch", "exam make", "exam run", "exam score"}


def expanded(path):
    """Paths with one of the names in braces each."""
    found = re.search(r"\{(.*?)\}", path)
    if not found:
        return [path]
    names = [name.strip() for name in found[1].split(",")]
    return [own for name in names for own in expanded(path[: found.start()] + name + path[found.end() :])]


def documented():
    """Section -> its tree of keys: a key as written -> the keys below it."""
    sections = {}
    for title, body in re.findall(r"^## greybox (.*?)\n(.*?)(?=^## |\Z)", page("json.md"), re.MULTILINE | re.DOTALL):
        tree = sections.setdefault(title, {})
        for cell in re.findall(r"^\| (`.*?`) \|", body, re.MULTILINE):
            for path in (own for code in re.findall(r"`(.*?)`", cell) for own in expanded(code)):
                node = tree
                for key in path.split("."):
                    node = node.setdefault(key, {})
    return sections


PAGE = documented()


def agree(value, tree, where=""):
    """Where value and page differ; keys of the page that are met are marked by None in the tree."""
    if isinstance(value, list):
        for own in value:
            agree(own, tree, where)
        return
    keys = {key.rstrip("?").removesuffix("[]"): key for key in tree if key is not None}
    if not keys or value is None:
        return
    assert isinstance(value, dict), f"{where} has keys in docs/json.md, but is {value!r:.60}"
    (anything,) = [key for key in keys if key.startswith("<")] or [None]
    for name, own in value.items():
        key = keys.get(name, anything)
        assert key is not None, f"{where}.{name} is missing in docs/json.md"
        written_as = keys[key] if key == anything else key
        assert isinstance(own, list) or "[]" not in written_as, f"{where}.{name} is no list"
        tree[written_as][None] = True
        agree(own, tree[written_as], f"{where}.{name}")
    lacking = {name for name, key in keys.items() if not key.endswith("?") and name != anything} - set(value)
    assert not lacking, f"{where} has no {lacking}, which docs/json.md names"


def never_met(tree, where=""):
    """Keys of the page that no call has shown."""
    for key, below in tree.items():
        if key is not None:
            if None not in below:
                yield f"{where}.{key}"
            yield from never_met(below, f"{where}.{key}")


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
        yield folder


@pytest.fixture(autouse=True)
def _there(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("GREYBOX_COMPILE", "0")
    monkeypatch.setattr("greybox_id.cli.gap.diagnose", lambda *_, **__: clear())


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


def test_keys_of_a_fetch_are_those_of_the_page(monkeypatch):
    monkeypatch.setattr("greybox_id.cli.datasets.fetch", lambda dataset, *_: [folder_of(dataset) / "train.csv"])
    agree(greybox("datasets", "fetch", next(iter(PUBLIC)), "--json").told, PAGE["datasets fetch"])


def test_keys_of_an_examination_are_those_of_the_page(tmp_path):
    exam = tmp_path / "exam"
    agree(greybox("exam", "make", "--out", exam, "--cases", 0, "--nulls", 1, "--json").told, PAGE["exam make"])
    silent = ("--diagnoser", "exam.candidates:silent")
    agree(greybox("exam", "run", exam / "cases", *silent, "--json").told, PAGE["exam run"])
    agree(greybox("exam", "score", exam, "--json").told, PAGE["exam score"])


def test_the_page_has_every_command():
    commands = set()
    for name in root.list_commands(click.Context(root)):
        command = root.get_command(click.Context(root), name)
        commands |= {f"{name} {own}" for own in command.commands} if isinstance(command, click.Group) else {name}
    assert {re.split(r",| NAME", title)[0] for title in PAGE} == commands - {"completion"}
    assert set(PAGE) == {*FORMS, *ELSEWHERE}
