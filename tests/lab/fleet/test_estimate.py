"""Tables of population, vehicles and drift, the prior they leave, and the report."""

import shutil

import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from json_pages import PAGE, agree, never_met

from greybox_lab.fleet import estimate as fleet_estimate
from greybox_lab.fleet.store import COLUMNS, Store


@pytest.fixture(scope="module")
def joined(tmp_path_factory):
    """Results of a fleet as a run leaves them: six vehicles, ten recordings each; the last one jumps by 22 ms."""
    rng, store = np.random.default_rng(4), Store(tmp_path_factory.mktemp("joined") / "R")
    names = ["C_alpha_f", "steering_delay"]
    rows = {"recordings": [], "parameters": [], "covariances": [], "manifest": []}
    for v in range(6):
        stiffness, delay = np.log(1e5) + 0.1 * rng.normal(), 0.03 + 0.002 * rng.normal()
        for r in range(10):
            key = f"{v}-{r}"
            now = delay + 0.022 * (v == 5 and r >= 6)
            centre = [stiffness + 0.02 * rng.normal(), now + 0.002 * rng.normal()]
            common = {"key": key, "vehicle": f"V{v}", "time": 1.77e9 + 86400.0 * r, "path": f"d/V{v}/{r}.csv"}
            rows["recordings"].append(
                {**common, "odometer": 1e6 * r, "status": "ok", "verdict": "usable", "cpu_s": 1.0, "version": "0"}
            )
            rows["manifest"].append({**common, "odometer": 1e6 * r})
            rows["covariances"].append(
                {"key": key, "names": names, "units": ["N/rad", "s"], "logarithm": [True, False], "centre": centre,
                 "lower": [0.02**2, 0.0, 0.002**2], "dof": [np.inf, np.inf], "at_bound": [False, False],
                 "prior_mean": [0.0, 0.0], "prior_sd": [np.inf, np.inf]}
            )  # fmt: skip
            for k, name in enumerate(names):
                value = np.exp(centre[0]) if k == 0 else centre[1]
                rows["parameters"].append(
                    {**common, "name": name, "unit": "s", "value": value, "sd": 0.002, "told": True}
                )
    for name, own in rows.items():
        store.replace(name, own)
    return store.folder


def moved(folder, target, amount, key="0-0"):
    """A copy of results in which a recording's stiffness is off by so much, in its logarithm."""
    shutil.copytree(folder, target)
    store = Store(target)
    table = store.read("covariances")
    off = table["key"] == key
    table.loc[off, "centre"] = table.loc[off, "centre"].map(lambda own: np.array([own[0] + amount, own[1]]))
    store.replace("covariances", table.to_dict("records"))
    return store


def of(folder, vehicle="V0", name="C_alpha_f"):
    return fleet_estimate(folder).vehicles.set_index(["vehicle", "name"]).loc[(vehicle, name)]


def test_keys_are_those_of_the_page(joined, fleet, tmp_path):
    _, results, called = fleet
    told = {
        "run": called,
        "status": greybox("fleet", "status", results, "--json"),
        "estimate": greybox("fleet", "estimate", moved(joined, tmp_path / "R", -6.0).folder, "--json"),
        "report": greybox("fleet", "report", joined, "--out", tmp_path / "page.html", "--json"),
    }
    for name, own in told.items():
        tree = PAGE[f"fleet {name}"]
        agree(own.told, tree, name)
        assert list(never_met(tree)) == []


def test_a_jump_is_found_dated_and_said(joined):
    told = greybox("fleet", "estimate", joined, "--json").told
    (own,) = told["drift"]
    assert (own["vehicle"], own["name"], own["model"]) == ("V5", "steering_delay", "step")
    assert own["low"] < 0.022 < own["high"]
    assert own["at_low"] <= own["at"] <= own["at_high"]
    assert own["at_low"] <= 6e6 <= own["at_high"]
    assert own["at_time_low"] <= own["at_time"] <= own["at_time_high"]
    assert own["probability"] > 0.9
    assert own["sentence"].startswith("V5: steering_delay +0.02")
    assert "since 2026-02-08" in own["sentence"]
    assert own["sentence"] in greybox("fleet", "estimate", joined).out


@pytest.mark.parametrize("name", ["population", "vehicles", "drift", "apart"])
def test_tables_have_the_columns_that_are_documented(joined, name):
    fleet_estimate(joined)
    assert list(pd.read_parquet(joined / name).columns) == list(COLUMNS[name])


def test_vehicles_have_their_value_of_today(joined):
    own = fleet_estimate(joined).vehicles.set_index(["vehicle", "name"])
    today = own.loc[("V5", "steering_delay")]
    assert today["low"] < today["value"] < today["high"]
    assert today["value"] > 0.045
    assert today["next_low"] <= today["low"]
    assert own.loc[("V1", "steering_delay"), "value"] == pytest.approx(0.03, abs=0.006)


def test_the_prior_is_one_that_a_fit_takes(joined, tmp_path, monkeypatch):
    import tomllib

    from greybox_lab.fleet.unit import requested_of

    fleet_estimate(joined)
    written = tomllib.loads((joined / "prior.toml").read_text(encoding="utf-8"))["fit"]["prior"]
    options = {"model": "lateral", "set": {"tyre": "linear"}, "with": ["steering_delay"], "prior": written}
    model = requested_of(options, None)[0].model()
    assert model["C_alpha_f"].prior.sd == pytest.approx(1e4, rel=0.8)
    assert model["steering_delay"].prior.mean == pytest.approx(0.03, abs=0.005)


def test_the_report_says_who_changed_and_what_is_broken(joined, fleet, tmp_path):
    page = tmp_path / "fleet.html"
    assert greybox("fleet", "report", joined, "--out", page, "--json").told == {"written": str(page)}
    text = page.read_text(encoding="utf-8")
    assert "V5: steering_delay +0.02" in text
    assert "<svg" in text
    _, results, _ = fleet
    told = greybox("fleet", "report", results).out
    assert "report.html" in told
    assert "is not a sound Parquet file" in (results / "report.html").read_text(encoding="utf-8")
    assert greybox("fleet", "report", results, "--vehicle", "V1").code == 0
    assert "Vehicle V1" in (results / "report_V1.html").read_text(encoding="utf-8")
    assert "the fleet has no 'V9'" in refused("fleet", "report", results, "--vehicle", "V9")
    assert "an HTML page" in refused("fleet", "report", results, "--out", tmp_path / "fleet.pdf")


def test_recordings_without_a_joint_fit_claim_nothing(fleet, tmp_path):
    plan, _, _ = fleet
    alone = plan.with_name("check.toml")
    alone.write_text('recordings = "data/V0/*.csv"\nvehicle = "car.toml"\nsteps = ["check"]\n')
    assert greybox("fleet", "run", alone, "--out", tmp_path / "R").code == 0
    found = fleet_estimate(tmp_path / "R")
    assert found.used == 0
    assert found.vehicles.empty
    assert greybox("fleet", "report", tmp_path / "R").code == 0


def test_recordings_with_a_gap_count_less_where_they_lie_apart(joined, tmp_path):
    store = moved(joined, tmp_path / "R", 0.07, "0-1")
    trusted = of(store.folder)
    store.replace("gaps", [{"key": "0-1", "p": 0.001, "detected": True}])
    doubted, clean = of(store.folder), of(joined)
    assert abs(doubted["value"] - clean["value"]) < abs(trusted["value"] - clean["value"])


def test_a_recording_of_another_optimum_is_named_and_does_not_count(joined, tmp_path):
    store = moved(joined, tmp_path / "R", -6.0)
    called = greybox("fleet", "estimate", store.folder, "--json")
    (own,) = called.told["apart"]
    assert (own["key"], own["vehicle"], own["name"]) == ("0-0", "V0", "C_alpha_f")
    assert own["value"] < own["low"] < own["high"]
    assert own["sentence"].startswith("d/V0/0.csv is set apart: its C_alpha_f")
    assert own["sentence"] in greybox("fleet", "estimate", store.folder).out
    assert list(pd.read_parquet(store.folder / "apart").columns) == list(COLUMNS["apart"])
    assert of(store.folder)["value"] == pytest.approx(of(joined)["value"], rel=0.02)
    assert of(store.folder)["recordings"] == of(joined)["recordings"] - 1
    page = tmp_path / "fleet.html"
    greybox("fleet", "report", store.folder, "--out", page)
    assert "Recordings set apart" in page.read_text(encoding="utf-8")
