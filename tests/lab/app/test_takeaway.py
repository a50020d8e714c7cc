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
from greybox_lab.app.session import Session
from greybox_lab.app.step_take import commands, pack
from greybox_lab.app.work import Work

MODEL = {
    "name": "lateral", "vehicle": "roboracer", "settings": {"tyre": "brush"}, "effects": ["steering_delay"],
    "start": {"I_z": 0.04, "m": 3.5}, "fix": ["m"], "free": ["h_cg"],
}  # fmt: skip


def test_what_is_chosen_is_words_of_a_command(tmp_path):
    session = Session(tmp_path / "lap")
    files = [{"file": f"recordings/{name}.csv", "role": role} for name, role in (("a", "train"), ("b", "validate"))]
    session.change(recordings=files, columns="map.toml", between="1:20", horizon=0.5, model=MODEL)
    work = Work(session)
    assert " ".join(work.fit_words("fits/1")) == (
        "fit --model lateral --vehicle roboracer --set tyre=brush --start I_z=0.04 --fix m=3.5 --free h_cg --with "
        "steering_delay recordings/a.csv --columns map.toml --between 1:20 --validate recordings/b.csv --horizon 0.5 "
        "--seed 0 --out fits/1"
    )
    assert " ".join(work.gap_words("fits/1", "gaps/1")) == (
        "gap recordings/a.csv --fit fits/1/fit.json --vehicle roboracer --held-out recordings/b.csv --columns map.toml "
        "--between 1:20 --seed 0 --out gaps/1"
    )


@pytest.mark.slow
def test_commands_and_notebook_make_the_same_fit_in_a_fresh_folder(tmp_path):
    work = Work(Session(tmp_path / "app" / "racer"))
    session = work.session
    for name in ("racer_train", "racer_valid"):
        session.link(Path(gb.datasets.shipped(name)))
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
    ran = [line for line in commands(session).splitlines() if line.startswith("greybox")]
    assert [cell.removeprefix("!") for cell in code if cell.startswith("!")] == ran
    scope = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(fresh)
        for cell in code:
            if not cell.startswith("!"):
                exec(cell, scope)
    for name, each in first["parameters"].items():
        assert float(again.params[name]) == each["value"]
        assert float(scope["fit"].params[name]) == each["value"]


def _wait(job, seconds=300):
    until = time.time() + seconds
    while job.running and time.time() < until:
        time.sleep(0.05)
    assert job.answer is not None, job.failure
