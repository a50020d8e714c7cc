"""The questions of SKILL.md: each command runs, and its JSON holds the answer."""

import json
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from calling import greybox
from write_results import recordings

import greybox_id as gb

TASKS = tomllib.loads((Path(__file__).parents[2] / "docs" / "tasks.toml").read_text(encoding="utf-8"))["task"]
ROWS = 600


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The recordings that the tasks name."""
    place = tmp_path_factory.mktemp("tasks")
    recordings(place)
    for before, after in {"late7": "late", "late8": "later"}.items():
        (place / f"{before}.csv").rename(place / f"{after}.csv")
    lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, ROWS).to_pandas()
    lap.to_csv(place / "lap.csv", index=False)
    lap.assign(yaw_rate=-lap["yaw_rate"]).to_csv(place / "turned.csv", index=False)
    with pytest.MonkeyPatch.context() as patch:  # a fit that several tasks read
        patch.chdir(place)
        called = greybox(*shlex.split(next(task["command"] for task in TASKS if "--out run" in task["command"]))[1:])
        assert called.code in (0, 1, 3), called.err
    logger = {"Time": lap["time"], "Speed_kmh": 3.6 * lap["v_x"], "GyroZ": np.degrees(lap["yaw_rate"])}
    pd.DataFrame(logger).to_csv(place / "logger.csv", index=False)
    return place


def answers(data, path):
    """What stands under a key; * is each entry of a list or each key of an object."""
    name, _, rest = path.partition(".")
    if name == "*":
        inner = data if isinstance(data, list) else data.values() if rest else list(data)
        each = [answers(item, rest) if rest else item for item in inner]
        return [one for several in each for one in several] if "*" in rest else each
    inner = data[int(name)] if isinstance(data, list) else data[name]
    return answers(inner, rest) if rest else inner


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS, ids=lambda task: task["question"])
def test_the_command_answers_the_question(task, folder, monkeypatch):
    monkeypatch.chdir(folder)
    called = greybox(*shlex.split(task["command"])[1:], "--json")
    assert called.code in (0, 1, 3), called.err
    answer = answers(json.loads(called.out), task["answer"])
    if "is" in task:
        assert answer == task["is"]
    if "has" in task:
        assert task["has"] in answer
    if "in" in task:
        assert answer in task["in"]
    if "between" in task:
        assert task["between"][0] < answer < task["between"][1]


def test_there_are_twenty_tasks_and_each_has_an_answer_to_check():
    assert len(TASKS) == 20
    assert all({"is", "has", "in", "between"} & set(task) for task in TASKS)
