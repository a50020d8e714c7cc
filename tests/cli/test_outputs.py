"""No output of any command destroys what the command reads, nor a result of another kind.

Commands and their options are found by walking them: a new one fails here until it says what it reads and writes.
"""

import os
from pathlib import Path

import click
import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from driven import driven, written
from networks import FOLDER as NETWORKS

from greybox_id.base.guard import content_of
from greybox_id.cli import greybox as root
from greybox_id.cli.commands import WRITTEN, Guarded

READ = (
    "--columns", "--vehicle", "--fit", "--train", "--validate", "--held-out", "--own", "--data", "--since",
    "--pretrain", "--posterior", "--arena", "--limits", "--token-file", "--home",
)  # fmt: skip
"""Options that name a file, a folder or something shipped that is read."""

CALLS = {
    "fit": ("fit --model lateral --vehicle {car} --columns {map} --validate {other} --horizon 1 {lap}", {"--out": ""}),
    "predict": ("predict {fit} {lap} --columns {map}", {"--out": ".csv"}),
    "simulate": ("simulate {fit} {lap} --columns {map}", {"--out": ".csv"}),
    "profile": ("profile {fit} {lap} --parameter I_z --columns {map}", {"--out": ".csv"}),
    "track": (
        "track {lap} --vehicle {car} --model lateral --columns {map} --tune 0s",
        {"--out": ".csv", "--figures": "", "--apply": ".toml"},
    ),
    "report": (
        "report {fit} --train {lap} --validate {other} --columns {map}",
        {"--out": ".html", "--figures": ""},
    ),
    "gap": (
        "gap {lap} --vehicle {car} --model lateral --columns {map} --held-out {other}",
        {"--out": "", "--report": ".html", "--apply": ".toml"},
    ),
    "export": ("export {fit} --target f1tenth", {"--out": ""}),
    "import": ("import {net}", {"--out": ".json"}),
    "models": ("models lateral --vehicle {car}", {"--out": ".toml"}),
    "data map": ("data map {lap}", {"--out": ".toml"}),
    "data check": ("data check {degrees} --columns {map}", {"--repair": ".toml"}),
    "data convert": ("data convert {lap} --columns {map}", {"--out": ".csv"}),
    "data join": ("data join {lap} {other} --columns {map}", {"--out": ".csv"}),
    "datasets make": ("datasets make virtual_lap", {"--out": ""}),
    "datasets fetch": ("datasets fetch roboracer", {"--out": ""}),
    "exam make": ("exam make --cases 1 --nulls 0", {"--out": ""}),
    "sample": ("sample {fit} --method laplace --draws 50", {"--out": ".parquet"}),
    "grid": ("grid msnn_bench_lat {lap} --columns {map} --set q=4,9", {"--out": ".parquet"}),
    "adapt": ("adapt {fit} {lap} --columns {map}", {"--out": ""}),
    "design": ("design {fit} --arena disc:60", {"--out": ""}),
    "fleet run": ("fleet run {lap}", {"--out": ""}),
    "fleet report": ("fleet report {lap}", {"--out": ".html"}),
    "loop demo": ("loop demo --quick", {"--out": ""}),
    "loop agent": ("loop agent http://127.0.0.1:1 --token-file {lap}", {"--out": ""}),
    "serve": ("serve --token-file {lap} --port 0", {"--out": ""}),
    "bench loop": ("bench loop --quick", {"--out": ""}),
    "bench msnn": ("bench msnn --data {lap}", {"--out": ".json", "--report": ""}),
    "bench a2rl": ("bench a2rl --data {lap}", {"--report": ""}),
    "bench ferrari": ("bench ferrari --data {lap}", {"--report": ""}),
    "bench abs": ("bench abs --data {lap}", {"--report": ""}),
    "bench emps": ("bench emps --data {lap}", {"--report": ""}),
    "bench truck": ("bench truck --data {lap}", {"--out": ".json", "--report": ""}),
}  # fmt: skip
"""Command -> a call of it, and how a file that each of its outputs names has to end."""
SPELLINGS = ("as it is", "relative", "missing folder", "symbolic link", "hard link", "folder behind a link")


def commands(command=root, name=()):
    """Full name of every command, and the command."""
    context = click.Context(command)
    if isinstance(command, click.Group):
        for own in command.list_commands(context):
            yield from commands(command.get_command(context, own), (*name, own))
    else:
        yield " ".join(name), command


COMMANDS = dict(commands())


pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A file of each kind that a command reads."""
    folder = tmp_path_factory.mktemp("read")
    found = {
        "lap": written(driven("lateral", runs=1, seconds=4.0, seed=1), folder / "lap.csv"),
        "other": written(driven("lateral", runs=1, seconds=4.0, seed=2), folder / "other.csv"),
        "degrees": folder / "degrees.csv",
        "car": folder / "car.toml",
        "map": folder / "map.toml",
        "net": folder / "net.json",
    }
    written(driven("lateral", runs=1, seconds=20.0, seed=1), found["degrees"])
    table = pd.read_csv(found["degrees"])
    table.assign(yaw_rate=np.degrees(table.yaw_rate)).to_csv(found["degrees"], index=False)
    found["car"].write_bytes(Path("greybox_id/datasets/vehicles/full_size_car.toml").read_bytes())
    found["map"].write_bytes(Path("greybox_id/datasets/columns/canonical.toml").read_bytes())
    found["net"].write_bytes((NETWORKS / "lat_small.json").read_bytes())
    called = greybox("fit", "--model", "lateral", "--vehicle", found["car"], found["lap"], "--validate", found["other"],
                     "--solver", "gauss-newton", "--horizon", "1", "--columns", found["map"],
                     "--out", folder / "run")  # fmt: skip
    assert called.code == 0, called.err
    return found | {"fit": folder / "run" / "fit.json"}


def words(name, files):
    """A call of a command, its outputs left out."""
    return CALLS[name][0].format(**files).split()


def named(name):
    """What a call of a command reads, by the keys of `files`."""
    return [key for key in ("lap", "other", "car", "map", "net", "fit") if f"{{{key}}}" in CALLS[name][0]]


def spelled(how, file, suffix, folder, monkeypatch):
    """The same file under another name, which ends as an output's name has to."""
    if how == "as it is":
        return file
    if how == "relative":
        monkeypatch.chdir(file.parent)
        return Path(".") / file.name
    if how == "missing folder":
        return f"{file.parent}/missing/../{file.name}"
    if how == "folder behind a link":
        (folder / "behind").symlink_to(file.parent)
        return folder / "behind" / file.name
    link = folder / f"link{suffix}"
    if how == "hard link":
        os.link(file, link)
    else:
        link.symlink_to(file)
    return link


def test_every_option_that_names_a_place_is_written_or_read():
    for name, command in COMMANDS.items():
        for own in command.params:
            assert isinstance(own.type, (Guarded, click.Choice)) or not isinstance(
                own.type, (click.types.StringParamType, click.Path)
            ), f"{name} {own.opts} escapes the guard"
            if isinstance(own, click.Option) and any(word in str(own.metavar) for word in ("FILE", "FOLDER", ".toml")):
                assert {*own.opts} & {*WRITTEN, *READ}, (
                    f"{name} {own.opts}: is it written (cli/paths.py) or read (here)?"
                )


def test_every_command_that_writes_is_tried_here():
    writing = {
        name: {own.type.written for own in command.params if isinstance(own.type, Guarded) and own.type.written}
        for name, command in COMMANDS.items()
    }
    assert {name: found for name, found in writing.items() if found} == {
        name: set(outputs) for name, (_, outputs) in CALLS.items()
    }
    for name in CALLS:
        assert any("--overwrite" in own.opts for own in COMMANDS[name].params), name


@pytest.mark.parametrize("how", SPELLINGS)
@pytest.mark.parametrize("name", [name for name in CALLS if named(name)])
def test_no_output_is_ever_an_input(name, how, files, tmp_path, monkeypatch):
    before = {key: file.read_bytes() for key, file in files.items()}
    for option, suffix in CALLS[name][1].items():
        for k, key in enumerate(named(name)):
            if (option, key, how) == ("--repair", "map", "as it is"):
                continue  # a map is repaired in its place, and kept as it was (tests/datasets/test_repair.py)
            folder = tmp_path / f"{option}{k}"
            folder.mkdir()
            out = spelled(how, files[key], suffix, folder, monkeypatch)
            for more in ([], ["--overwrite"]):
                said = refused(*words(name, files), option, out, *more)
                if not suffix or str(out).endswith(suffix):
                    assert "is read by this command" in said or "named by" in said, said
    assert {key: file.read_bytes() for key, file in files.items()} == before


def test_a_recording_that_only_the_fit_names_is_not_written_over(files, tmp_path):
    table = files["lap"].read_bytes()
    said = refused("profile", files["fit"], "--parameter", "I_z", "--out", files["lap"], "--overwrite")
    assert "is read by this command" in said
    (tmp_path / "lap.html").hardlink_to(files["lap"])
    said = refused("report", files["fit"], "--out", tmp_path / "lap.html", "--overwrite")
    assert "is read by this command" in said
    assert files["lap"].read_bytes() == table


def test_a_file_is_the_same_in_another_case_where_the_file_system_says_so(files):
    shouted = files["lap"].with_name("LAP.csv")
    if not shouted.exists():
        pytest.skip("this file system tells cases apart")
    assert "is read by this command" in refused("data", "convert", files["lap"], "--out", shouted, "--overwrite")


def test_nothing_is_written_into_the_folder_of_a_bag(files, tmp_path):
    pytest.importorskip("rosbags")
    bag = tmp_path / "bag"
    bag.mkdir()
    assert greybox("data", "convert", files["lap"], "--out", bag / "lap.mcap").code == 0
    said = refused("data", "convert", bag, "--out", bag / "more.csv")
    assert "lies in" in said


OTHERS = {
    "fit.json": '{\n "format": "greybox-fit",\n "model": {\n  "name": "single_track" } }',
    "gap.json": '{"mine": 1}',
    "closed.toml": 'name = "mine"\n',
    "gap.png": "\x89PNG mine",
    "gap.pdf": "%PDF-1.4 mine",
    ".csv": "time,v_x,yaw_rate\n0,1,2\n",
    ".parquet": "time,v_x,yaw_rate\n0,1,2\n",
    ".html": "<!DOCTYPE html><p>mine",
    ".toml": 'name = "mine"\n',
    ".json": '{"mine": 1}',
}
SLOW = (
    "gap",
    "exam make",
    "datasets fetch",
    "grid",
    "adapt",
    "design",
    "fleet run",
    "fleet report",
    "bench loop",
    "bench msnn",
    "bench truck",
    "bench a2rl",
    "bench ferrari",
    "bench abs",
    "bench emps",
    "loop agent",
    "loop demo",
    "serve",
)
"""Commands that take long to come to their end, ask the net, or take other files than those here."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CALLS if name not in (*SLOW, "export", "datasets make")])
def test_what_is_of_another_kind_is_replaced_only_when_told_to(name, files, tmp_path):
    fixed = {"fit": "fit.json"}
    for option, suffix in CALLS[name][1].items():
        if option == "--figures":
            continue
        folder = tmp_path / option
        folder.mkdir()
        out = folder if name in fixed else folder / f"mine{suffix}"
        kept = folder / fixed[name] if name in fixed else out
        kept.write_text(OTHERS[fixed.get(name, suffix)])
        before = kept.read_bytes()
        suffix_beside = None if option == "--out" else CALLS[name][1].get("--out")
        beside = ["--out", folder / f"table{suffix_beside}"] if suffix_beside else []
        call = [*words(name, files), option, out, *beside]
        assert "already exists" in refused(*call)
        assert kept.read_bytes() == before
        called = greybox(*call, "--overwrite")
        assert called.code == 0, called.err
        assert kept.read_bytes() != before
        assert (
            greybox(*call, *(["--overwrite"] if name in ("data map", "data check") else [])).code == 0
        )  # its own kind


@pytest.mark.parametrize("kept", ["gap.json", "closed.toml", "gap.png", "gap.pdf"])
def test_a_gap_replaces_no_file_of_another_kind(kept, files, tmp_path):
    (tmp_path / kept).write_text(OTHERS[kept], encoding="latin-1")
    assert "already exists" in refused(*words("gap", files), "--out", tmp_path)


@pytest.mark.slow
def test_a_figure_of_another_hand_is_kept(files, tmp_path):
    call = [*words("report", files), "--out", tmp_path / "report.html", "--figures", tmp_path]
    assert greybox(*call).code == 0
    figure = next(tmp_path.glob("*.svg"))
    assert greybox(*call).code == 0
    figure.write_text("<svg>mine</svg>")
    before = (tmp_path / "report.html").read_bytes()
    assert "already exists" in refused(*call)
    assert figure.read_text() == "<svg>mine</svg>"
    assert (tmp_path / "report.html").read_bytes() == before


def test_an_export_of_another_model_or_target_is_kept(files, tmp_path):
    out = tmp_path / "car"
    call = ["export", files["fit"], "--out", out, "--target"]
    assert greybox(*call, "f1tenth").code == 0
    assert greybox(*call, "f1tenth").code == 0
    before = sorted(file.name for file in out.iterdir())
    assert "an export of lateral for f1tenth" in refused(*call, "casadi")
    assert "f1tenth" in refused("export", "--vehicle", "roboracer", "--out", out, "--target", "f1tenth")
    assert sorted(file.name for file in out.iterdir()) == before
    assert greybox(*call, "casadi", "--overwrite").code == 0


def test_made_recordings_replace_only_themselves(tmp_path):
    call = ["datasets", "make", "virtual_lap", "--seed", "3", "--out", tmp_path]
    assert greybox(*call).code == 0
    (made,) = tmp_path.iterdir()
    assert greybox(*call).code == 0
    made.write_text("time,v_x\n0,1\n")
    assert "already exists" in refused(*call)
    assert made.read_text() == "time,v_x\n0,1\n"
    assert greybox(*call, "--overwrite").code == 0


def test_an_empty_file_may_be_replaced_and_a_folder_may_not(files, tmp_path):
    (tmp_path / "empty.csv").touch()
    assert greybox(*words("predict", files), "--out", tmp_path / "empty.csv").code == 0
    assert content_of(tmp_path / "empty.csv").words == "a table of predictions"
    (tmp_path / "folder.csv").mkdir()
    assert "folder.csv" in refused(*words("predict", files), "--out", tmp_path / "folder.csv")


def test_parquet_tables_are_told_apart_like_csv(files, tmp_path):
    out = tmp_path / "table.parquet"
    assert greybox(*words("predict", files), "--out", out).code == 0
    assert "a table of predictions" in refused(*words("simulate", files), "--out", out)
    pd.read_csv(files["lap"]).to_parquet(out)
    assert "already exists" in refused(*words("predict", files), "--out", out)


def test_the_sentence_names_the_option_that_is_to_be_changed(files, tmp_path):
    (tmp_path / "file").touch()
    for name, option, more in (
        ("track", "--apply", ["--out", tmp_path / "t.csv"]),
        ("report", "--figures", ["--out", tmp_path / "r.html"]),
        ("datasets fetch", "--out", []),
    ):
        said = refused(*words(name, files), option, tmp_path / "file" / f"x{CALLS[name][1][option]}", *more)
        assert f"with {option}" in said
