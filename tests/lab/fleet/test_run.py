"""A fleet is run: rows for all recordings, nothing done twice, what is wrong becomes a sentence."""

import json
import shutil

import pandas as pd
import pyarrow.parquet as pq
import pytest
from calling import greybox, refused

import greybox_id as gb
from greybox_lab.fleet import manifest as manifest_module
from greybox_lab.fleet import run as fleet_run
from greybox_lab.fleet import status as fleet_status
from greybox_lab.fleet.run import differences, origin_of
from greybox_lab.fleet.store import COLUMNS, OF_RESULTS, SCHEMA


def test_every_recording_is_a_row_and_what_failed_has_a_sentence(fleet):
    _, results, called = fleet
    assert called.told["recordings"] == called.told["done"] == 8
    assert (called.told["failed"], called.told["skipped"]) == (2, 0)
    rows = pd.read_parquet(results / "recordings")
    assert sorted(rows["status"]) == ["failed"] * 2 + ["ok"] * 6
    assert rows["key"].is_unique
    failed = rows[rows["status"] == "failed"].set_index("path")["sentence"]
    assert "is not a sound Parquet file" in failed["data/V0/cut.parquet"]
    assert 'no column "time"' in failed["data/V1/words.csv"]
    done = rows[rows["status"] == "ok"]
    assert set(done["vehicle"]) == {"V0", "V1"}
    assert (done["rows"] == 100).all()
    assert (done["peak_mb"] > 10).all()


@pytest.mark.parametrize("name", OF_RESULTS)
def test_datasets_have_the_columns_that_are_documented(fleet, name):
    _, results, _ = fleet
    assert list(pd.read_parquet(results / name).columns) == list(COLUMNS[name])
    assert pq.read_schema(next((results / name).glob("*.parquet"))).metadata[b"greybox_fleet_schema"] == SCHEMA.encode()


def test_estimates_are_near_the_car_that_was_driven(fleet):
    _, results, _ = fleet
    table = pd.read_parquet(results / "parameters")
    truth = gb.Vehicle.load("full_size_car").values
    own = table[table["name"] == "I_z"]
    assert len(own) == 6
    assert ((own["low"] <= truth["I_z"].value) & (truth["I_z"].value <= own["high"])).sum() >= 4


def test_a_second_run_does_nothing_and_reads_nothing_if_told_so(fleet, monkeypatch):
    plan, results, _ = fleet
    again = greybox("fleet", "run", plan, "--out", results, "--json").told
    assert (again["done"], again["skipped"], again["failed"]) == (0, 8, 2)
    monkeypatch.setattr(manifest_module, "hash_of", lambda file: pytest.fail(f"{file} was read"))
    again = greybox("fleet", "run", plan, "--out", results, "--only", "changed", "--json").told
    assert again["done"] == 0


def test_what_changed_is_done_again_and_what_is_gone_is_no_more_counted(copied):
    plan, results = copied
    shutil.copy(plan.parent / "data/V1/r2.csv", plan.parent / "data/V0/r0.csv")
    (plan.parent / "data/V1/r2.csv").unlink()
    (plan.parent / "data/V0/cut.parquet").unlink()
    again = greybox("fleet", "run", plan, "--out", results, "--json").told
    assert (again["recordings"], again["done"], again["failed"]) == (6, 1, 1)
    assert len(pd.read_parquet(results / "recordings")) == 9
    compact = greybox("fleet", "run", plan, "--out", results, "--compact", "--json").told
    assert compact["done"] == 0
    rows = pd.read_parquet(results / "recordings")
    assert len(rows) == 6
    assert set(pd.read_parquet(results / "parameters")["key"]) == set(rows[rows["status"] == "ok"]["key"])
    assert len(list((results / "parameters").iterdir())) == 1


@pytest.mark.slow
def test_what_is_done_again_since_something_else_is_asked_is_said(copied):
    plan, results = copied
    text = plan.read_text(encoding="utf-8")
    other = text.replace('"lateral"', '"kinematic"').replace('set = {tyre = "linear"}\nfix = ["m"]\n', "")
    plan.write_text(other, encoding="utf-8")
    called = greybox("fleet", "run", plan, "--out", results)
    said = (
        '8 recordings done by an earlier run are done again: [fit] fix was ["m"] and is not given; '
        '[fit] model was "lateral" and is "kinematic"; [fit] set was {"tyre": "linear"} and is not given.'
    )
    assert said in called.err
    assert f"anew     {said}" in called.out
    assert greybox("fleet", "run", plan, "--out", results, "--json").told["anew"] == ""
    plan.write_text(text, encoding="utf-8")  # what the first run did is there still
    assert greybox("fleet", "run", plan, "--out", results, "--json").told["done"] == 0


@pytest.mark.slow
def test_a_vehicle_file_that_changed_is_what_is_left_to_say(copied):
    plan, results = copied
    car = plan.parent / "car.toml"
    car.write_text("# weighed again\n" + car.read_text(encoding="utf-8"), encoding="utf-8")
    told = greybox("fleet", "run", plan, "--out", results, "--json").told
    assert told["done"] == 8
    assert told["anew"].endswith("are done again: a vehicle file, or a recording's vehicle, has changed.")


NOW = {"version": "0.1.0", "steps": ["fit"], "options": {"fit": {"model": "lateral"}}, "columns": "my.toml", "map": "a"}


@pytest.mark.parametrize(
    ("before", "said"),
    [
        ({}, []),
        (NOW, []),
        ({**NOW, "version": "0.0.9"}, ['version was "0.0.9" and is "0.1.0"']),
        ({**NOW, "steps": ["check", "fit"]}, ['steps was ["check", "fit"] and is ["fit"]']),
        ({**NOW, "options": None}, ['[fit] model was not given and is "lateral"']),
        ({**NOW, "columns": "other.toml", "map": "b"}, ['columns was "other.toml" and is "my.toml"']),
        ({**NOW, "map": "b"}, ["the column map my.toml has changed"]),
    ],
)
def test_what_differs_is_in_words(before, said):
    assert differences(before, NOW) == said


def test_an_origin_that_is_damaged_says_nothing(tmp_path):
    (tmp_path / "fleet.json").write_text("[1, ", encoding="utf-8")
    assert origin_of(tmp_path / "fleet.json") == origin_of(tmp_path / "missing.json") == {}


def test_what_failed_is_tried_again_when_it_is_asked_for(copied):
    plan, results = copied
    again = greybox("fleet", "run", plan, "--out", results, "--retry-failed", "--json").told
    assert (again["done"], again["skipped"], again["failed"]) == (2, 6, 2)
    assert pd.read_parquet(results / "recordings")["key"].is_unique


def test_a_limit_of_time_becomes_a_row(fleet, tmp_path):
    plan, _, _ = fleet
    short = plan.with_name("short.toml")
    text = plan.read_text().replace("seconds = 60", "seconds = 0.02").replace("data/{vehicle}/*.*", "data/V0/r0.csv")
    short.write_text(text)
    told = greybox("fleet", "run", short, "--out", tmp_path / "R", "--json").told
    assert told["failed"] == 1
    row = pd.read_parquet(tmp_path / "R" / "recordings").iloc[0]
    assert row["status"] == "timeout"
    assert "0.04 s by the clock" in row["sentence"]  # the processor's time is counted in whole seconds


def test_status_tells_what_came_of_recordings(fleet):
    _, results, _ = fleet
    told = greybox("fleet", "status", results, "--json").told
    assert told["statuses"] == {"failed": 2, "ok": 6}
    assert told["vehicles"]["V0"] == {"failed": 1, "ok": 3}
    assert fleet_status(results).to_json() == told
    assert "8 recordings of 2 vehicles" in greybox("fleet", "status", results).out


def test_a_journal_left_by_a_killed_run_is_read_and_becomes_a_part_once(copied):
    plan, results = copied
    rows = pd.read_parquet(results / "recordings")
    key = rows[rows["status"] == "failed"]["key"].iloc[0]
    lost = rows[rows["key"] == key].iloc[0]
    kept = pq.read_table(results / "recordings").filter(pq.read_table(results / "recordings")["key"].to_numpy() != key)
    for path in (results / "recordings").iterdir():
        path.unlink()
    pq.write_table(kept, results / "recordings" / "part-000001.parquet")
    line = json.dumps({"recordings": [{"key": key, "status": lost["status"], "path": lost["path"]}]})
    (results / "journal" / "000009.jsonl").write_text(f"{line}\n{line}\n{line[:20]}")
    assert fleet_status(results).statuses == {"failed": 2, "ok": 6}
    assert greybox("fleet", "run", plan, "--out", results, "--json").told["done"] == 0
    assert not list((results / "journal").iterdir())
    assert sorted(pd.read_parquet(results / "recordings")["key"]) == sorted(rows["key"])


def test_two_runs_do_not_write_to_one_folder(fleet):
    from greybox_lab.fleet.store import Store

    plan, results, _ = fleet
    with Store(results).opened():
        assert "Another run writes to" in refused("fleet", "run", plan, "--out", results)


def test_folders_with_something_else_are_left_alone(fleet):
    plan, _, _ = fleet
    assert "holds no results of a fleet" in refused("fleet", "status", plan.parent)
    assert "no results of a fleet; name another with --out" in refused("fleet", "run", plan, "--out", plan.parent)
    assert "would be overwritten" in refused("fleet", "run", plan, "--out", plan)
    other = plan.with_name("other.txt")
    other.write_text("mine", encoding="utf-8")
    assert "is a file; name another folder with --out" in refused("fleet", "run", plan, "--out", other)
    assert other.read_text(encoding="utf-8") == "mine"


def test_damaged_results_are_a_sentence(copied):
    _, results = copied
    part = next((results / "recordings").iterdir())
    part.write_bytes(part.read_bytes()[:100])
    for command in ("status", "estimate", "report"):
        assert "is damaged" in refused("fleet", command, results)


def test_an_engine_that_is_not_there_is_a_sentence(fleet, tmp_path):
    plan, _, _ = fleet
    assert "--scheduler is for the engine dask" in refused(
        "fleet", "run", plan, "--out", tmp_path / "R", "--scheduler", "x"
    )
    with pytest.raises(gb.BadInput, match="there is no engine 'ray'"):
        fleet_run(plan, tmp_path / "R", engine="ray")


@pytest.mark.slow
def test_a_second_pass_fits_once_again_with_the_fleet_as_prior(copied):
    plan, results = copied
    before = pd.read_parquet(results / "parameters")
    covariances = pd.read_parquet(results / "covariances")
    poor = covariances["key"].iloc[0]
    rows = covariances["key"] == poor  # as of a recording that tells next to nothing
    covariances.loc[rows, "lower"] = covariances.loc[rows, "lower"].map(lambda own: own * 1e4)
    from greybox_lab.fleet.store import Store

    Store(results).replace("covariances", covariances.to_dict("records"))
    again = greybox("fleet", "run", plan, "--out", results, "--second-pass", "--json").told
    assert again["done"] == 0
    assert 1 <= again["refitted"] <= 6
    rows = pd.read_parquet(results / "recordings")
    second = rows[rows["refit_of"].notna()]
    assert poor in set(second["refit_of"])
    assert rows["key"].is_unique
    assert len(second) == again["refitted"]
    own = pd.read_parquet(results / "covariances").set_index("key").loc[second["key"].iloc[0]]
    assert all(0 < sd < float("inf") for sd in own["prior_sd"])
    kept = pd.read_parquet(results / "parameters")
    assert set(before["key"]) <= set(kept["key"])
    told = greybox("fleet", "estimate", results, "--json").told
    assert told["refitted"] == again["refitted"]
    assert greybox("fleet", "status", results, "--json").told["statuses"] == {"failed": 2, "ok": 6}
    compact = greybox("fleet", "run", plan, "--out", results, "--second-pass", "--compact", "--json").told
    assert compact["refitted"] == 0
    assert len(pd.read_parquet(results / "recordings")) == 8 + again["refitted"]


def test_a_second_pass_needs_fits(fleet, tmp_path):
    plan, _, _ = fleet
    alone = plan.with_name("checked.toml")
    alone.write_text('recordings = "data/V0/*.csv"\nvehicle = "car.toml"\nsteps = ["check"]\n')
    assert "which is not in steps" in refused("fleet", "run", alone, "--out", tmp_path / "R", "--second-pass")
