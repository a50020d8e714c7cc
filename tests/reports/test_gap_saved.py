"""A diagnosis is read back as it was saved; a file that was altered, or is something else, is a sentence."""

import json
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from made_gaps import CASES, LAG, clear

from greybox_id.base.errors import BadInput
from greybox_id.cli.gap import as_json_text
from greybox_id.fitting.provenance import DataRecord
from greybox_id.gap.estimation.wandering import Wander
from greybox_id.reports.gap.report import gap_report
from greybox_id.reports.gap.saved import Made, as_text, load_gap
from greybox_id.reports.html import page

MADE = Made("car", "greybox gap x", 3, "0.1.0", (DataRecord("train", "x", "x.csv", "a3" * 32, "canonical", 9, 1, 0.4),))


def saved(gap, folder):
    file = folder / "gap.json"
    file.write_text(as_text(gap, MADE), encoding="utf-8")
    return file


@pytest.mark.parametrize("case", CASES)
def test_the_report_of_a_saved_diagnosis_is_that_of_the_diagnosis(case, tmp_path):
    gap = CASES[case]()
    found, made = load_gap(saved(gap, tmp_path))
    assert made == MADE
    assert page(gap_report(found, made)) == page(gap_report(gap, MADE))  # of which the PDF holds the same parts
    assert as_text(found, made) == as_text(gap, MADE)


def test_numbers_that_are_not_finite_come_back(tmp_path):
    endless = replace(LAG, interval=(0.01, float("inf")), gain=float("nan"))
    found, _ = load_gap(saved(clear(ranking=(endless,)), tmp_path))
    assert found.ranking[0].interval == (0.01, float("inf"))
    assert np.isnan(found.ranking[0].gain)


def test_a_diagnosis_without_a_picture_is_saved_too(tmp_path):
    assert load_gap(saved(clear(strip=None), tmp_path))[0].strip is None


def test_what_the_unknown_looks_like_comes_back(tmp_path):
    like = (Wander("steering_offset", "rad", 0.002, 1.2, 39.0), Wander("road_bank", "rad", 0.01, 3.0, 37.0))
    assert load_gap(saved(clear(resembles=like), tmp_path))[0].resembles == like


def damaged(body):
    yield "format version 99", {**body, "format_version": 99}
    yield "checksum", {**body, "p_value": 0.5}
    yield "checksum", {name: value for name, value in body.items() if name != "checksum"}
    yield "not a diagnosis", {**body, "format": "greybox-fit"}
    yield "not a diagnosis", []


def test_what_is_no_diagnosis_is_a_sentence(tmp_path):
    file = saved(clear(), tmp_path)
    for words, body in damaged(json.loads(file.read_text("utf-8"))):
        file.write_text(json.dumps(body), encoding="utf-8")
        with pytest.raises(BadInput, match=words):
            load_gap(file)
    file.write_text("{", encoding="utf-8")
    with pytest.raises(BadInput, match="not JSON"):
        load_gap(file)


@pytest.mark.parametrize(
    "name", ["where", "ranking", "gap", "strip", "data", "recordings", "held_out", "seed", "resembles"]
)
@pytest.mark.parametrize("value", [None, 7, "x", [1], {"a": 1}])
def test_hostile_content_with_a_right_checksum_is_a_sentence_or_read(name, value, tmp_path):
    from greybox_id.base.json_data import checksum

    file = saved(clear(), tmp_path)
    body = json.loads(file.read_text("utf-8"))
    del body["checksum"]
    body[name] = value
    body["checksum"] = checksum(body)
    file.write_text(json.dumps(body), encoding="utf-8")
    with suppress(BadInput):
        load_gap(file)


def test_what_gap_prints_as_json_can_be_reported(tmp_path):
    unsure = replace(LAG, interval=(0.01, float("inf")), gain=float("nan"))
    gap = clear(ranking=(unsure,))
    file = tmp_path / "printed.json"
    file.write_text(as_json_text(gap, MADE, [tmp_path / "gap.pdf"]), encoding="utf-8")
    assert "NaN" not in file.read_text("utf-8")
    found, made = load_gap(file)
    assert made == MADE
    assert found.ranking[0].interval == (0.01, float("inf"))
    assert page(gap_report(found, made)) == page(gap_report(gap, MADE))  # of which the PDF holds the same parts
