"""Files take their places whole or not at all, and what killed processes leave behind is swept."""

import os
import subprocess
import sys
import time

import pytest

from greybox_id.base import files
from greybox_id.base.errors import BadInput
from greybox_id.base.files import (
    NAME,
    SET_ASIDE,
    at_once,
    ensure_writable,
    held,
    near_file,
    new_folder,
    replacing,
    scratch_folder,
    scratch_name,
    write_atomically,
)
from greybox_id.base.guard import allow_overwriting, claim, guarding, protect

KILLED = """
import os, pathlib, signal, sys
sys.path[:] = {path!r}
from greybox_id.base.files import at_once, held, new_folder, replacing, scratch_folder
folder = pathlib.Path({folder!r})
with {what}:
    {body}
    os.kill(os.getpid(), signal.SIGKILL)
"""


def killed(folder, what, body="pass"):
    code = KILLED.format(path=sys.path, folder=str(folder), what=what, body=body)
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -9


@pytest.fixture(autouse=True)
def _as_at_the_start():
    files._swept.clear()


@pytest.mark.parametrize(
    "what", ["replacing(folder / 'lap.csv') as beside", "scratch_folder(folder)", "new_folder(folder / 'car') as made"]
)
def test_what_a_killed_process_leaves_is_swept_at_the_next_start(what, tmp_path):
    (tmp_path / "lap.csv").write_text("old")
    killed(tmp_path, what)
    assert any(NAME.fullmatch(path.name) for path in tmp_path.iterdir())
    assert (tmp_path / "lap.csv").read_text() == "old"
    ensure_writable(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["lap.csv"]


def test_what_a_living_process_is_at_is_left_alone(tmp_path):
    code = "import os, sys; sys.path[:] = {!r}; from greybox_id.base.files import scratch_name; "
    code += "from pathlib import Path; "
    code += "scratch_name(Path({!r})).touch(); print(flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", code.format(sys.path, str(tmp_path))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        ensure_writable(tmp_path)
        assert len(list(tmp_path.iterdir())) == 1
        other.stdin.close()
    files._swept.clear()
    ensure_writable(tmp_path)
    assert not list(tmp_path.iterdir())


def test_files_of_other_machines_and_of_people_are_left_alone(tmp_path):
    own = scratch_name(tmp_path).name.split("-")
    kept = [".greybox-" + "-".join(["0" * 8, "999999", "1", own[4]]), ".greybox-mine", ".lap.csv"]
    for name in kept:
        (tmp_path / name).touch()
    ensure_writable(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == set(kept)


def test_a_folder_set_aside_by_a_killed_process_comes_back(tmp_path):
    left = tmp_path / f".greybox-{files._machine()}-4194304-1-{'0' * 12}"
    (left / SET_ASIDE / "car").mkdir(parents=True)
    (left / SET_ASIDE / "car" / "car.h").write_text("old")
    ensure_writable(tmp_path)
    assert (tmp_path / "car" / "car.h").read_text() == "old"
    assert not left.exists()


def test_a_folder_is_replaced_in_one_step(tmp_path, monkeypatch):
    folder = tmp_path / "car"
    for exchange in (files._exchanged, lambda one, other: False):
        monkeypatch.setattr(files, "_exchanged", exchange)
        for text in ("one", "two"):
            with new_folder(folder) as made:
                (made / text).write_text(text)
            assert [path.name for path in folder.iterdir()] == [text]
        assert [path.name for path in tmp_path.iterdir()] == ["car"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the system call is Linux's")
def test_folders_are_exchanged_by_the_system(tmp_path):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    assert files._exchanged(tmp_path / "one", tmp_path / "other")
    assert (tmp_path / "one" / "other").exists()
    assert not files._exchanged(tmp_path / "one", tmp_path / "missing")


def written_and_failed(file):
    with at_once():
        write_atomically(file, "new")
        raise ZeroDivisionError


def test_files_written_together_appear_together_and_a_failure_leaves_the_old_ones(tmp_path):
    for name in ("gap.json", "closed.toml"):
        (tmp_path / name).write_text("old")
    with pytest.raises(ZeroDivisionError):
        written_and_failed(tmp_path / "gap.json")
    with at_once():
        write_atomically(tmp_path / "gap.json", "new")
        assert (tmp_path / "gap.json").read_text() == "old"
        write_atomically(tmp_path / "closed.toml", "new")
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"gap.json": "new", "closed.toml": "new"}


def test_files_written_together_leave_others_in_their_folder(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with at_once():
        write_atomically(tmp_path / "gap.json", "new")
        write_atomically(tmp_path / "more" / "closed.toml", "new")
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"notes.txt", "gap.json", "more"}


def test_a_whole_folder_of_files_is_exchanged_in_one_step(tmp_path, monkeypatch):
    steps, folder = [], tmp_path / "gap"
    for name in ("gap.json", "closed.toml"):
        write_atomically(folder / name, "old")
    exchanged = files._exchanged
    monkeypatch.setattr(files, "_exchanged", lambda one, other: steps.append(other) or exchanged(one, other))
    with at_once():
        for name in ("gap.json", "closed.toml"):
            write_atomically(folder / name, "new")
    assert steps == [folder]
    assert {file.read_text() for file in folder.iterdir()} == {"new"}
    assert [path.name for path in tmp_path.iterdir()] == ["gap"]


def test_what_is_written_is_on_the_disk_before_it_takes_its_place(tmp_path, monkeypatch):
    done = []
    fsync, replace = os.fsync, type(tmp_path).replace
    monkeypatch.setattr(os, "fsync", lambda handle: done.append("fsync") or fsync(handle))
    monkeypatch.setattr(type(tmp_path), "replace", lambda one, other: done.append("replace") or replace(one, other))
    write_atomically(tmp_path / "lap.csv", "x")
    assert done == ["fsync", "replace", "fsync"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full here")
def test_a_full_disk_leaves_the_old_file_and_is_told(tmp_path):
    (tmp_path / "lap.csv").write_text("old")
    with (
        pytest.raises(BadInput, match="No space left"),
        replacing(tmp_path / "lap.csv"),
        open("/dev/full", "w") as full,
    ):
        full.write("x")
    assert [file.name for file in tmp_path.iterdir()] == ["lap.csv"]
    assert (tmp_path / "lap.csv").read_text() == "old"


def test_names_as_long_as_the_file_system_has_them_can_be_written(tmp_path):
    assert write_atomically(tmp_path / ("x" * 250 + ".csv"), "x").read_text() == "x"


def test_a_scratch_folder_is_gone_at_the_end(tmp_path):
    with scratch_folder(tmp_path) as made:
        (made / "x").touch()
    assert not list(tmp_path.iterdir())


def test_what_is_read_and_what_is_claimed_exclude_each_other_in_either_order(tmp_path):
    lap = tmp_path / "lap.csv"
    lap.write_text("time\n")
    with guarding():
        claim(lap)
        with pytest.raises(BadInput, match="is read by this command"):
            protect(lap)
    with guarding():
        allow_overwriting()
        protect(lap)
        with pytest.raises(BadInput, match="is read by this command"):
            write_atomically(tmp_path / "missing" / ".." / "lap.csv", "new")
    write_atomically(lap, "from Python, nobody watches\n")


def test_a_command_may_write_its_own_file_twice(tmp_path):
    with guarding():
        write_atomically(tmp_path / "notes.txt", "one")
        write_atomically(tmp_path / "notes.txt", "two")
    assert (tmp_path / "notes.txt").read_text() == "two"


def test_looking_for_leftovers_among_many_files_takes_no_time(tmp_path):
    for k in range(3000):
        (tmp_path / str(k)).touch()
    clock = time.perf_counter()
    for _ in range(20):
        files.sweep(tmp_path)
    assert time.perf_counter() - clock < 1.0


def test_a_folder_is_for_one_process_at_a_time(tmp_path):
    code = f"import sys, pathlib; sys.path[:] = {sys.path!r}; from greybox_id.base.files import held\n"
    code += f"with held(pathlib.Path({str(tmp_path)!r})): pass"
    with held(tmp_path):
        other = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
        assert "Another run writes to" in other.stderr
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    killed(tmp_path, "held(folder)")
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_file_that_was_meant_is_told_by_its_name_without_ending(tmp_path):
    (tmp_path / "fl_other.toml").touch()
    (tmp_path / "lap_seven.parquet").touch()
    assert near_file(tmp_path / "nope.toml") == ""
    assert near_file(tmp_path / "lap_sevn.csv").endswith("lap_seven.parquet?")


def test_a_file_in_the_place_of_a_folder_is_said_to_be_one(tmp_path):
    (tmp_path / "lap.csv").touch()
    for folder in (tmp_path / "lap.csv", tmp_path / "lap.csv" / "inside"):
        with pytest.raises(BadInput, match="a file stands where a folder is needed"):
            ensure_writable(folder)
