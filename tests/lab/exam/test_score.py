"""Answers are opened once, over an unbroken seal, when every case has its diagnosis."""

import json

import pytest
from exam_candidates import diagnosis, ranked

from greybox_id.base.errors import BadInput
from greybox_id.fitting.how import quiet
from greybox_lab.exam.score import score


@pytest.fixture
def diagnosed(exam):
    """The examination, diagnosed by hand: all right but for one of two effects."""
    applied = {"applied": ["steering_delay"], "gap": {"closed": 0.98}, "cost": {"cpu_s": 1.5, "wall_s": 2.0}}
    delay = ranked("steering_delay", magnitude=0.0303, interval=(0.029, 0.031))
    write(exam, "case_000", diagnosis())
    write(exam, "case_001", diagnosis(gap_detected=True, ranking=[delay], **applied))
    write(exam, "case_002", diagnosis(gap_detected=True, ranking=[ranked("mass_change"), ranked("cog_shift")]))
    write(exam, "case_003", diagnosis(gap_detected=True, unknown_probability=0.8))
    return exam


def write(exam, case, body):
    (exam / "cases" / case / "diagnosis.json").write_text(json.dumps(body))


def verify(case, held_out, told):
    assert (case / "vehicle.toml").is_file()
    assert held_out.is_file()
    assert told["applied"] == ["steering_delay"]
    return 0.96


def test_the_score_counts_and_is_kept(diagnosed):
    body, again = score(diagnosed, quiet, verify=verify)
    told = {measure["key"]: measure for measure in body["measures"]}
    assert not again
    assert told["first"]["value"] == 1.0
    assert told["doubles"]["value"] == 0.0
    assert told["unknown"]["value"] == 1.0
    assert (told["closed"]["value"], told["claim"]["value"]) == (0.96, pytest.approx(0.02))
    assert told["cpu"]["value"] == 1.5
    assert [finding["case"] for finding in body["findings"] if finding["wrong"]] == ["case_002"]
    assert json.loads((diagnosed / "score.json").read_text())["cases"] == 4


def test_answers_are_opened_once(diagnosed):
    first, _ = score(diagnosed, quiet, verify=verify)
    write(diagnosed, "case_002", diagnosis(gap_detected=True, ranking=[ranked("mass_change"), ranked("road_slope")]))
    second, again = score(diagnosed, quiet, verify=verify)
    assert again
    assert second["measures"][5]["value"] == first["measures"][5]["value"] == 0.0


def test_a_case_without_diagnosis_keeps_the_answers_closed(diagnosed):
    (diagnosed / "cases" / "case_002" / "diagnosis.json").unlink()
    with pytest.raises(BadInput, match="1 of 4 cases have no diagnosis, case_002 first"):
        score(diagnosed, quiet, verify=verify)
    assert not (diagnosed / "score.json").exists()


def test_a_broken_seal_is_not_scored(diagnosed):
    (diagnosed / "sealed" / "case_003" / "held_out.csv").write_text("")
    with pytest.raises(BadInput, match="seal is broken"):
        score(diagnosed, quiet, verify=verify)
    assert not (diagnosed / "score.json").exists()


def test_a_part_is_scored_without_being_kept(diagnosed):
    (diagnosed / "cases" / "case_002" / "diagnosis.json").unlink()
    body, again = score(diagnosed, quiet, verify=verify, partial=True)
    assert (body["cases"], again) == (3, False)
    assert not (diagnosed / "score.json").exists()
