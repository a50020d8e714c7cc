"""Progress: what is being done, since when, and how long it still takes."""

import os
import pty
import subprocess
import sys

import pandas as pd
import pytest
from rich.console import Console

from greybox_id.base.processes import Pace
from greybox_id.cli import output


def test_the_pace_of_what_is_done_says_how_long_the_rest_takes(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    pace = Pace(5)
    assert pace.left(0) == ""
    now[0] += 20.0
    assert pace.left(2) == ", about 30 s left"
    now[0] += 400.0
    assert pace.left(4) == ", about 1 min 45 s left"
    assert pace.left(5) == ""


def test_the_live_line_counts_the_seconds_and_shows_no_orders(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    line = output._Live()
    line.words, now[0] = "fit: step 3", 12.4
    screen = Console(record=True, width=80, file=open("/dev/null", "w"))  # noqa: SIM115
    screen.print(line)
    assert screen.export_text().strip() == "fit: step 3  12 s"


CALLS = {
    "predict": "predict {fit} {lap} --out {out}.csv",
    "simulate": "simulate {fit} {lap} --out {out}.csv",
    "validate": "validate {fit} {lap}",
    "profile": "profile {fit} --parameter I_z --out {out}.csv",
    "report": "report {fit} --out {out}.html",
    "export": "export {fit} --target c --out {out}",
    "track": "track {lap} --vehicle {car} --model lateral --tune 0s --out {out}.csv",
    "check": "data check {lap}",
    "map": "data map {lap}",
    "convert": "data convert {lap} --out {out}.parquet",
    "join": "data join {lap} {other} --out {out}.parquet",
    "make": "datasets make virtual_lap --out {out}",
}


@pytest.fixture(scope="module")
def files(tmp_path_factory, made_files):
    found = made_files(tmp_path_factory.mktemp("read"))
    table = pd.read_csv(found["lap"])[["time", "v_x"]]
    table.to_csv(found["lap"].with_name("odometry.csv"), index=False)
    return found | {"other": found["lap"].with_name("odometry.csv")}


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="pseudo-terminals as Linux has them")
@pytest.mark.parametrize("name", CALLS)
def test_what_may_take_long_shows_what_is_being_done_on_a_terminal(name, files, tmp_path):
    terminal, end = pty.openpty()
    call = CALLS[name].format(out=tmp_path / "out", **files).split()
    command = [sys.executable, "-c", "from greybox_id.cli import main; main()", *call]
    setting = os.environ | {"TERM": "xterm", "COLUMNS": "200"}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=end, env=setting) as child:
        os.close(end)
        shown = b""
        try:
            while own := os.read(terminal, 65536):
                shown += own
        except OSError:  # the other end is closed
            pass
    os.close(terminal)
    assert child.returncode == 0, shown.decode()
    assert b" 0 s" in shown, shown.decode()  # the live line counts
