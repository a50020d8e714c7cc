"""`greybox exam`: what the three commands say, as a user calls them."""

import json

import pytest
from calling import greybox, refused

from greybox_lab.exam.answers import Answer, write_answer
from greybox_lab.exam.make import finish

SILENT = ("--diagnoser", "exam_candidates:silent")


@pytest.fixture
def exam(tmp_path):
    folder = tmp_path / "exam"
    answers = [
        Answer("case_000", "null", "clean", {}),
        Answer("case_001", "single", "clean", {"steering_delay": 0.03}, {"steering_delay": 0.0},
               size={"yaw_rate": 2.0}, left={"yaw_rate": 1.5}),
    ]  # fmt: skip
    for answer in answers:
        case = folder / "cases" / answer.case
        case.mkdir(parents=True)
        (case / "recording.csv").write_text("time,v_x\n0,1\n")
        (case / "vehicle.toml").write_text('name = "car"\n')
        write_answer(answer, folder / "sealed" / answer.case / "answer.json")
    finish(folder, "clean", 3, answers)
    return folder


def test_sitting_and_scoring(exam):
    sat = greybox("exam", "run", exam / "cases", *SILENT, "--json")
    assert sat.code == 0
    assert sat.told["diagnosed"] == 2
    assert "2 of 2 cases to diagnose" in sat.err
    assert "(2 of them earlier)" in greybox("exam", "run", exam / "cases", *SILENT).out

    score = greybox("exam", "score", exam, "--detail")
    assert score.code == 0
    lines = score.out.splitlines()
    assert lines[0] == "2 cases, tier clean, 0 ended in an error"
    (alarms,) = [line.split() for line in lines if line.startswith("false alarms")]
    assert alarms[-5:] == ["1", "≤", "2", "%", "✓"]
    (detection,) = [line for line in lines if line.startswith("gaps above")]
    assert detection.endswith("≥ 99 %  ✗")
    assert any("case_001" in line and "not detected" in line for line in lines)

    again = greybox("exam", "score", exam, "--json")
    assert "the answers were opened on" in again.err
    assert again.told["opened_before"] is True
    assert json.loads((exam / "score.json").read_text())["cases"] == 2


def test_answers_stay_closed_until_all_is_diagnosed(exam):
    assert "2 of 2 cases have no diagnosis" in refused("exam", "score", exam)


def test_a_broken_seal_is_told(exam):
    greybox("exam", "run", exam / "cases", *SILENT)
    (exam / "cases" / "case_001" / "vehicle.toml").write_text('name = "another"\n')
    assert "The seal is broken" in refused("exam", "score", exam)


def test_a_sum_that_was_noted_is_compared(exam):
    greybox("exam", "run", exam / "cases", *SILENT)
    assert "was replaced" in refused("exam", "score", exam, "--seal", "0" * 64)


def test_what_cannot_be_made_is_refused(exam, tmp_path):
    assert "is not empty" in refused("exam", "make", "--out", exam, "--cases", 1)
    assert "at least one case" in refused("exam", "make", "--out", tmp_path / "new", "--cases", 0)


def test_a_small_examination_is_made(tmp_path):
    made = greybox("exam", "make", "--out", tmp_path / "exam", "--cases", 0, "--nulls", 1, "--json")
    assert made.code == 0
    assert made.told["counts"] == {"null": 1}
    assert len(made.told["seal"]) == 64


def test_options_of_another_tier_are_refused(tmp_path):
    out = tmp_path / "exam"
    assert "--cases cannot be combined with --tier foreign" in refused(
        "exam", "make", "--tier", "foreign", "--cases", 3, "--out", out
    )
    assert "--family cannot be combined with --tier clean" in refused("exam", "make", "--family", "slipx", "--out", out)
    assert 'no family "bike"' in refused("exam", "make", "--tier", "foreign", "--family", "bike", "--out", out)
    for tier in ("injected", "changed"):
        assert "name their folder with --data" in refused("exam", "make", "--tier", tier, "--out", out)
    assert not out.exists()
