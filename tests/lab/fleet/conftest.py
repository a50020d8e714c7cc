"""A small fleet: two vehicles, three recordings each, and what was wrong with two more."""

import shutil
from pathlib import Path

import pytest
from calling import greybox
from driven import driven, written

PLAN = """recordings = "data/{vehicle}/*.*"
vehicle = "car.toml"
steps = ["check", "fit"]
limits = {seconds = 60, memory = "1GB"}
[fit]
model = "lateral"
set = {tyre = "linear"}
fix = ["m"]
horizon = 1.0
solver = "gauss-newton"
"""


def made(folder: Path, vehicles=2, each=3, seconds=4.0) -> Path:
    """The plan of a fleet in a folder."""
    for v in range(vehicles):
        (folder / "data" / f"V{v}").mkdir(parents=True)
        for r in range(each):
            own = driven("lateral", runs=1, seconds=seconds, seed=10 * v + r)
            written(own, folder / "data" / f"V{v}" / f"r{r}.csv")
    (folder / "car.toml").write_bytes(Path("greybox_id/datasets/vehicles/full_size_car.toml").read_bytes())
    (folder / "fleet.toml").write_text(PLAN, encoding="utf-8")
    return folder / "fleet.toml"


@pytest.fixture(scope="session")
def fleet(tmp_path_factory):
    """A plan, and the results of a run with one truncated and one meaningless file among the recordings."""
    plan = made(tmp_path_factory.mktemp("fleet"))
    (plan.parent / "data" / "V0" / "cut.parquet").write_bytes(b"PAR1 and nothing more")
    (plan.parent / "data" / "V1" / "words.csv").write_text("not,a,recording\n", encoding="utf-8")
    called = greybox("fleet", "run", plan, "--out", plan.parent / "results", "--json")
    assert called.code == 0, called.err
    return plan, plan.parent / "results", called


@pytest.fixture
def copied(fleet, tmp_path):
    """A copy of the plan and its results, to change."""
    shutil.copytree(fleet[0].parent, tmp_path / "own")
    return tmp_path / "own" / "fleet.toml", tmp_path / "own" / "results"


@pytest.fixture(scope="session")
def made_fleet():
    """What makes the plan of a fleet in a folder."""
    return made
