"""What is taken away makes the same again: the same numbers, in another folder, by commands and by a notebook."""

import json
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

import greybox_id as gb
from greybox_lab.app.model import Request
from greybox_lab.app.session import Session
from greybox_lab.app.takeaway import commands, pack
from greybox_lab.app.work import Work

REQUEST = Request(
    name="lateral", vehicle="roboracer", settings={"tyre": "brush"}, effects=["steering_delay"], start={"I_z": 0.04},
    fix={"m": 3.5}, free=["h_cg"], train=["recordings/a.csv"], validate=["recordings/b.csv"], columns="map.toml",
    between="1:20", horizon=0.5,
)  # fmt: skip


def test_words_of_a_command_and_lines_of_python_ask_for_the_same():
    assert " ".join(REQUEST.fit_words("fits/1")) == (
        "fit --model lateral --vehicle roboracer --set tyre=brush --start I_z=0.04 --fix m=3.5 --free h_cg --with "
        "steering_delay recordings/a.csv --columns map.toml --between 1:20 --validate recordings/b.csv --horizon 0.5 "
        "--seed 0 --out fits/1"
    )
    lines = REQUEST.fit_code()
    for part in ("'lateral'", "settings={'tyre': 'brush'}", "start={'I_z': 0.04}", "fix={'m': 3.5}", "free=['h_cg']",
                 "effects=['steering_delay']", "seed=0, horizon=0.5"):  # fmt: skip
        assert part in lines
    assert ".between(1.0, 20.0)" in REQUEST.read_code()


@pytest.mark.slow
def test_commands_and_notebook_make_the_same_fit_in_a_fresh_folder(tmp_path):
    work = Work(Session(tmp_path / "app" / "racer"))
    session = work.session
    for name in ("racer_train", "racer_valid"):
        session.link(Path(gb.shipped(name)))
    session.change(columns="roboracer", between="2:20")
    chosen = {"name": "kinematic", "vehicle": "roboracer", "start": {"yaw_lag": 0.07}}
    session.change(model={**session["model"], **chosen})
    _wait(work.check())
    _wait(work.fit())
    _wait(work.gap(True))
    first = work.result("fit")[1]
    assert first is not None, work.result("fit")[0].failure
    fresh = tmp_path / "fresh"
    with zipfile.ZipFile(session.folder / pack(session)) as packed:
        packed.extractall(fresh)
    (fresh / "fits" / "1" / "fit.json").unlink()
    script = commands(session).replace("greybox ", f'{sys.executable} -c "from greybox_id.cli import main; main()" ')
    script = "\n".join(line for line in script.splitlines() if " gap " not in line)
    environment = os.environ | {"PYTHONPATH": str(Path(gb.__file__).parents[1])}
    subprocess.run(["sh", "-c", script], cwd=fresh, env=environment, check=False, capture_output=True)
    again = gb.load(fresh / "fits" / "1" / "fit.json")
    cells = json.loads((fresh / "notebook.ipynb").read_text("utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert any("gb.diagnose" in cell for cell in code)
    scope = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(fresh)
        for cell in code:
            if "gb.diagnose" not in cell and "gb.report" not in cell:
                exec(cell, scope)
    for name, each in first["parameters"].items():
        assert float(again.params[name]) == each["value"]
        assert float(scope["fit"].params[name]) == each["value"]


def _wait(job, seconds=300):
    until = time.time() + seconds
    while job.running and time.time() < until:
        time.sleep(0.05)
    assert job.answer is not None, job.failure
