"""Black box against name: what is compared is kept, and bars are told as they are."""

import json

import numpy as np
import pytest
from calling import greybox, refused
from json_pages import PAGE, agree

import greybox_lab.papers.loop as bench
from greybox_id.models.registry import motion_model_of
from greybox_lab.driving.learned.open_loop import errors_ahead
from greybox_lab.driving.loop.arms import oracle
from greybox_lab.driving.loop.scene import Scene
from greybox_lab.papers.loop import held_out
from greybox_lab.papers.loop_report import bars, removed, reported

TINY = bench.LoopBenchSize((1,), ("base", "hand", "actuator_net", "oracle"), 1, 4096, 700, 4096, 300, False)


def driven(error, lap=20.0, crashes=0):
    told = {"path_error_rms": error, "path_error_p95": 2 * error, "lap_time": lap, "steering_rate_rms": 1.0}
    return told | {"laps": 10, "crashes": crashes}


def arm(error, last=18.0, model=0.1, **more):
    found = {"first": driven(error), "last": driven(error, last), "cpu_seconds": {"model": 1.0, "learning": 2.0}}
    return found | {"errors": {"90%": {"0.5": {"yaw_rate": model}}}, "applied": {}} | more


def case(outside=(), **arms):
    return {"withheld": {"grip_scale": 0.8}, "outside": list(outside), "arms": arms}


def bar(cases, begins):
    (found,) = [own for own in bars(cases) if own["bar"].startswith(begins)]
    return found


def test_bars_are_met_missed_or_not_measured():
    good = case(base=arm(0.1), actuator_net=arm(0.08, model=0.2), named=arm(0.052, model=0.02), oracle=arm(0.05))
    assert removed(good, "named") == pytest.approx(0.96)
    for when in ("first", "last"):
        assert bar([good], f"{when} cap, named: share of the excess")["met"]
        assert bar([good], f"{when} cap: median difference")["measured"] == pytest.approx(0.56)
        assert bar([good], f"{when} cap: path error of named")["measured"] == pytest.approx(0.52)
    assert bar([good], "yaw rate error at 0.5 s")["met"]
    assert bar([good] * 7, "first cap: p of a sign test")["met"]
    assert bar([good] * 6, "first cap: p of a sign test")["met"] is False
    good["arms"]["named"]["last"] = driven(0.09)
    assert bar([good], "first cap, named: share")["met"]
    assert bar([good], "last cap, named: share")["measured"] == pytest.approx(0.2)
    assert bar([good] * 7, "last cap: p of a sign test")["met"] is False
    good["arms"]["named"]["last"] = driven(0.052, 18.0)
    assert bar([good], "named: lap time at the last")["met"]
    assert bar([good], "outside the vocabulary: median difference")["met"] is None
    assert bar([good], "model from 2000")["met"] is None
    bad = case(base=arm(0.1), actuator_net=arm(0.06), named=arm(0.09, last=19.5), oracle=arm(0.05))
    bad["arms"]["named"]["last"]["crashes"] = 2
    for begins in (
        "first cap, named: share",
        "last cap: median difference",
        "named, last cap: crashes",
        "named, last cap: crashes",
        "first cap: path error of named",
        "yaw rate error",
    ):
        found = [own for own in bars([bad]) if own["bar"].startswith(begins)]
        assert all(own["met"] is False for own in found), begins
    assert bar([bad], "named: lap time at the last")["met"] is False


def test_where_the_truth_helps_little_nothing_is_to_be_removed():
    assert np.isnan(removed(case(base=arm(0.1), named=arm(0.05), oracle=arm(0.095)), "named"))


def test_outside_the_vocabulary_a_wrong_name_counts():
    right = case(["rear_steer"], base=arm(0.1), actuator_net=arm(0.08), named=arm(0.09), named_residual=arm(0.079))
    wrong = case(["rear_steer"], base=arm(0.1), named=arm(0.09, applied={"yaw_inertia": 1.2}))
    assert bar([right, wrong], "outside the vocabulary: share of cases")["measured"] == 0.5
    assert bar([right, wrong], "outside the vocabulary: median difference")["met"]
    row = next(own for own in reported([right, wrong])["table"] if own["arm"] == "named")
    assert (row["cases"], row["crashes_last"], row["laps_last"]) == (2, 0, 20)
    assert row["cpu_seconds"] == 3.0
    assert row["removed"] is None


def test_the_truth_foretells_drives_that_nobody_learned_from():
    scene = Scene(0, forms="nominal", exact=True)
    own = held_out(scene, 0.9, 12.0)
    true, stated = (
        errors_ahead(model, [own], [0.5])[0.5]["yaw_rate"]
        for model in (oracle(scene.vehicle, scene.effects).model, motion_model_of(scene.vehicle))
    )
    assert true < 1e-3
    assert stated > 0.05
    assert oracle(scene.vehicle, {"rear_steer": 0.1}) is None
    assert np.ptp(own["steer"]) > 0.1


@pytest.mark.slow
def test_what_is_done_is_not_done_again(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "QUICK", TINY)
    call = ("bench", "loop", "--quick", "--out", tmp_path / "out")
    first = greybox(*call, "--arm", "base", "--arm", "oracle", "--json").told
    (folder,) = (tmp_path / "out").glob("case_*")
    before = (folder / "oracle.json").stat().st_mtime_ns
    found = greybox(*call, "--json").told
    assert (folder / "oracle.json").stat().st_mtime_ns == before
    agree(found, PAGE["bench loop"], "bench loop")
    (only,) = found["cases"]
    assert set(only["arms"]) == set(TINY.arms)
    assert only["arms"]["oracle"] == first["cases"][0]["arms"]["oracle"]
    assert only["arms"]["actuator_net"]["cycles"][0]["rows"] == 700
    assert json.loads((folder / "actuator_net.json").read_text())["first"]["cap"] == 0.6
    shown = greybox(*call)
    assert "actuator_net" in shown.out
    assert "not measured" in shown.out


def test_what_is_wrong_is_a_sentence(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    assert "something else" in refused("bench", "loop", "--quick", "--out", tmp_path)
    with pytest.raises(bench.BadInput, match="no arm 'nmaed'"):
        bench.loop_tables(tmp_path / "out", arms=["nmaed"])
    with pytest.raises(bench.BadInput, match="from 1 to 3 is needed, not 4"):
        bench.loop_tables(tmp_path / "out", cycles=4)
