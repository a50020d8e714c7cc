"""Nothing that was handed out or kept back can be changed unnoticed."""

import json

import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import column_map, parse_column_map
from greybox_lab.exam.folder import columns_text, seal, unbroken


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_case_states_how_commands_run_between_rows(hold):
    stated = parse_column_map(columns_text(hold), "columns.toml")
    assert (stated.hold, stated.hold_stated) == (hold, True)
    assert stated.signals == column_map("canonical").signals


def test_what_a_candidate_leaves_breaks_no_seal(exam):
    noted = unbroken(exam)
    (exam / "cases" / "case_000" / "diagnosis.json").write_text("{}")
    (exam / "cases" / "case_000" / "closed.toml").write_text("")
    assert unbroken(exam, noted) == noted


@pytest.mark.parametrize("file", ["sealed/case_001/answer.json", "sealed/exam.json", "cases/case_001/recording.csv"])
def test_a_changed_file_is_named(exam, file):
    with (exam / file).open("a") as text:
        text.write(" ")
    with pytest.raises(BadInput, match=rf"{file} was changed"):
        unbroken(exam)


def test_files_that_came_or_went_are_named(exam):
    (exam / "sealed" / "case_009.json").write_text("{}")
    with pytest.raises(BadInput, match=r"case_009.json was added"):
        unbroken(exam)
    (exam / "sealed" / "case_009.json").unlink()
    (exam / "sealed" / "case_001" / "held_out.csv").unlink()
    with pytest.raises(BadInput, match=r"held_out.csv is missing"):
        unbroken(exam)


def test_a_new_seal_over_other_answers_is_found_by_who_noted_the_first(exam):
    noted = unbroken(exam)
    answer = exam / "sealed" / "case_001" / "answer.json"
    body = json.loads(answer.read_text())
    answer.write_text(json.dumps(body | {"effects": {"steering_lag": 0.03}}))
    seal(exam)
    assert unbroken(exam) != noted
    with pytest.raises(BadInput, match=r"seal.json was replaced"):
        unbroken(exam, noted)


def test_without_a_seal_an_examination_was_never_finished(exam):
    (exam / "sealed" / "seal.json").unlink()
    with pytest.raises(BadInput, match="never finished"):
        unbroken(exam)
