"""Cases are diagnosed in processes that see nothing but the case at hand; nothing that is done is done again."""

import json

import pytest

from greybox_id.base.errors import BadInput
from greybox_id.base.files import held
from greybox_id.fitting.how import quiet
from greybox_lab.exam.run import run


def diagnoses(exam):
    files = sorted(exam.glob("cases/*/diagnosis.json"))
    return {file.parent.name: json.loads(file.read_text()) for file in files}


def test_every_case_is_diagnosed_and_costs_are_told(exam, capfd):
    lines = []
    sat = run(exam / "cases", "exam_candidates:silent", 2, 20.0, lambda line, passing=False: lines.append(line))
    assert (sat.cases, sat.before, sat.diagnosed, sat.failed) == (4, 0, 4, 0)
    found = diagnoses(exam)
    assert len(found) == 4
    assert all(0 <= own["cost"]["cpu_s"] < 5 for own in found.values())
    assert all((exam / "cases" / case / "closed.toml").is_file() for case in found)
    assert capfd.readouterr().out == ""
    assert "4 of 4 cases to diagnose" in lines[0]


def test_what_is_diagnosed_already_is_left_alone(exam):
    kept = exam / "cases" / "case_002" / "diagnosis.json"
    kept.write_text('{"by": "hand"}')
    sat = run(exam / "cases", "exam_candidates:silent", 1, 20.0, quiet)
    assert (sat.before, sat.diagnosed) == (1, 3)
    assert json.loads(kept.read_text()) == {"by": "hand"}
    assert run(exam, "exam_candidates:silent", 1, 20.0, quiet).diagnosed == 0


def test_errors_crashes_and_dawdling_become_sentences(exam):
    sat = run(exam / "cases", "exam_candidates:lost", 1, 1.5, quiet)
    assert (sat.diagnosed, sat.failed) == (4, 3)
    found = diagnoses(exam)
    assert found["case_000"]["error"].startswith("ValueError in exam_candidates.py, line ")
    assert found["case_001"]["error"] == "The process ended with exit code 7."
    assert found["case_002"]["error"] == "Stopped after 1.5 s."
    assert found["case_003"]["gap_detected"]


@pytest.mark.parametrize("candidate", ["peeking", "swallowing", "neighbourly", "shelling"])
def test_a_candidate_that_looks_for_answers_ends_the_run(exam, candidate):
    with pytest.raises(BadInput, match=r"tried to open .*The run has stopped"):
        run(exam / "cases", f"exam_candidates:{candidate}", 2, 20.0, quiet)
    assert diagnoses(exam) == {}


def test_a_candidate_that_is_not_there_is_told(exam):
    with pytest.raises(BadInput, match=r"candidates:nobody does not start"):
        run(exam / "cases", "exam_candidates:nobody", 1, 20.0, quiet)


def test_a_folder_without_cases_is_refused(tmp_path):
    with pytest.raises(BadInput, match="holds no cases"):
        run(tmp_path, "exam_candidates:silent", 1, 20.0, quiet)


def test_a_sample_is_drawn_by_a_seed(exam):
    assert run(exam / "cases", "exam_candidates:silent", 1, 20.0, quiet, sample=2, seed=5).diagnosed == 2
    first = set(diagnoses(exam))
    assert run(exam / "cases", "exam_candidates:silent", 1, 20.0, quiet, sample=2, seed=5).before == 2
    assert set(diagnoses(exam)) == first


def test_a_case_that_another_run_is_at_is_left_to_it(exam):
    (exam / "taken" / "case_001").mkdir(parents=True)
    with held(exam / "taken" / "case_001"):
        assert run(exam / "cases", "exam_candidates:silent", 1, 20.0, quiet).diagnosed == 3
    assert "case_001" not in diagnoses(exam)
    assert run(exam / "cases", "exam_candidates:silent", 1, 20.0, quiet).diagnosed == 1
