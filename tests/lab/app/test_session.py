"""A session is a folder: what is in it survives any end of the process, and what may not come in does not."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

import greybox_id as gb
from greybox_lab.app.session import Session, named_session, safe_name
from greybox_lab.app.work import Work


def test_state_is_on_disk_before_it_is_seen(tmp_path):
    session = Session(tmp_path / "app" / "lap")
    session.change(step=3, cursor=1.5)
    kept = json.loads((session.folder / "recordings.json").read_text("utf-8"))
    assert (kept["step"], kept["cursor"]) == (3, 1.5)
    session._held.close()
    assert Session(tmp_path / "app" / "lap")["step"] == 3


def test_a_session_is_open_once(tmp_path):
    session = Session(tmp_path / "lap")
    with pytest.raises(gb.BadInput, match="open in another greybox app"):
        Session(tmp_path / "lap")
    session._held.close()


@pytest.mark.slow
def test_a_kill_loses_nothing(tmp_path):
    code = (
        "import os, sys\nfrom pathlib import Path\nfrom greybox_lab.app.session import Session\n"
        "session = Session(Path(sys.argv[1]))\nk = 0\n"
        "while True:\n    k += 1\n    session.change(step=k)\n    print(k, flush=True)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code, tmp_path / "lap"], stdout=subprocess.PIPE, text=True)
    seen = [int(child.stdout.readline()) for _ in range(200)]
    child.send_signal(signal.SIGKILL)
    seen += [int(line) for line in child.stdout.read().split("\n")[:-1] if line]
    child.wait()
    assert Session(tmp_path / "lap")["step"] >= seen[-1] >= 200


def test_a_file_that_is_no_session_is_left_alone(tmp_path):
    (tmp_path / "lap").mkdir()
    (tmp_path / "lap" / "recordings.json").write_text("[1, 2]")
    with pytest.raises(gb.BadInput, match="not a session of greybox app"):
        Session(tmp_path / "lap")
    assert (tmp_path / "lap" / "recordings.json").read_text() == "[1, 2]"


@pytest.mark.parametrize(
    ("name", "safe"),
    [("../../etc/passwd", "passwd"), ("C:\\laps\\a.csv", "a.csv"),
     ("<img src=x onerror=1>.csv", "<img src=x onerror=1>.csv"),
     (".hidden", "hidden"), ("-rf.csv", "rf.csv"), ("a\x00\nb.csv", "ab.csv")],
)  # fmt: skip
def test_names_are_names_of_files_in_the_session(name, safe):
    assert safe_name(name) == safe


def test_a_name_of_nothing_is_a_sentence():
    with pytest.raises(gb.BadInput, match="rename the file"):
        safe_name("../..")


def test_two_gigabytes_are_refused_in_a_sentence(tmp_path):
    large = tmp_path / "large.csv"
    with large.open("wb") as opened:
        opened.truncate(2 * 2**30)
    with pytest.raises(gb.BadInput, match=r"more than 500 MB.*Cut it into parts"):
        Session(tmp_path / "lap").link(large)


def test_another_file_of_the_same_name_has_to_be_looked_at_again(tmp_path):
    session = Session(tmp_path / "lap")
    file = session.folder / session.add("a.csv")
    file.write_text("time,v_x\n0,1\n")
    before = session.key
    session.add("a.csv")
    assert session.key == before
    os.utime(file, (1.0, 1.0))
    assert session.key != before
    assert session["recordings"] == [{"file": "recordings/a.csv", "role": "train"}]


def test_another_map_has_to_be_looked_at_again(tmp_path):
    session = Session(tmp_path / "lap")
    entry = {"signal": "v_x", "column": "v", "sign": 1, "use": True}
    session.change(entries=[entry])
    before = session.key
    session.change(entries=[{**entry, "sign": -1}])
    assert session.key != before


def test_a_session_is_named_after_its_first_file(tmp_path):
    assert named_session([tmp_path / "lap 7 (wet).csv"]) == "lap_7_wet"
    assert named_session([]) == "drive"


def test_how_commands_run_between_rows_is_said_in_the_map(tmp_path):
    session = Session(tmp_path / "racer")
    session.link(_shipped("racer_train"))
    session.change(columns="roboracer")
    session.change(looked=session.key)
    work = Work(session)
    shipped = work.recording("recordings/racer_train.csv")
    for hold in ("zero", "linear", ""):
        work.set_hold(hold)
        assert work.mapped()[0].get("hold", "") == hold
        assert session["looked"] == session.key  # nothing has to be looked at again
        mapped = gb.read(session.folder / "recordings" / "racer_train.csv", columns=session.folder / "map.toml")
        assert mapped.hold_stated == bool(hold)
        assert mapped.hold == (hold or "zero")
        assert list(mapped.signals) == list(shipped.signals)
        assert (mapped["a_y"] == shipped["a_y"]).all()


@pytest.mark.slow
def test_a_command_is_found_again_by_another_process(tmp_path):
    session = Session(tmp_path / "racer")
    session.link(_shipped("racer_train"))
    job = session.jobs.start("check", ["data", "check", *session.files(), "--columns", "roboracer"], session.key)
    from greybox_lab.app.jobs import Jobs

    again = Jobs(session.folder).all()
    assert [each.words for each in again] == [job.words]
    assert again[0].running
    _wait(job)
    assert job.answer["files"][0]["rows"] == 2440
    assert job.failure == ""
    assert job.command == "greybox data check recordings/racer_train.csv --columns roboracer"


@pytest.mark.slow
def test_what_fails_says_why(tmp_path):
    session = Session(tmp_path / "lap")
    (session.folder / "recordings" / "a.csv").write_text("t,v\n0,1\n")
    session.add("a.csv")
    work = Work(session)
    work.look()
    job = session.latest("map")
    _wait(job)
    assert work.watch()
    check = session.jobs.start("check", ["data", "check", "recordings/none.csv"])
    _wait(check)
    assert check.answer is None
    assert "none.csv" in check.failure


@pytest.mark.slow
def test_a_stop_is_an_interrupt(tmp_path):
    session = Session(tmp_path / "lap")
    job = session.jobs.start("check", ["data", "check", "recordings/none.csv"])
    job.stop()
    _wait(job)
    assert job.answer is None
    assert job.failure


def _shipped(name):
    from pathlib import Path

    return Path(gb.datasets.shipped(name))


def _wait(job, seconds=60):
    until = time.time() + seconds
    while job.running and time.time() < until:
        time.sleep(0.02)
    assert not job.running
