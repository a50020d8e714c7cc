"""Titles of reports: they name vehicle and files, and the longest of them lie over nothing in the PDF's own boxes."""

from dataclasses import replace

import pypdfium2 as pdfium
import pytest
from pdf_boxes import over_others

from greybox_id.fitting.provenance import DataRecord
from greybox_id.reports.comparison import NamedFit, comparison
from greybox_id.reports.content import heading
from greybox_id.reports.pdf import write_pdf
from greybox_id.reports.report import prepared

PLACE = "2026-11-05_proving_ground_north_double_lane_change_wet_tyres_third_try_after_lunch_repeated"
UNBROKEN = "W" * 120


def record(path):
    return DataRecord("train", "lap", path, "a3" * 32, "canonical", 3000, 1, 60.0)


def of_car(fit, name):
    return replace(fit, how={**fit.how, "vehicle": name})


def test_a_fit_is_titled_by_car_and_files(motion_fit, laps):
    document = prepared(of_car(motion_fit, "full-size car"), laps)
    assert document.title == "Fit of full-size car: lap 1 and lap 2"
    assert document.about.startswith("lateral: ")


def test_a_fit_of_no_named_car_is_titled_by_its_model(motion_fit, laps):
    assert prepared(motion_fit, laps).title == "Fit of lateral: lap 1 and lap 2"


def test_fits_of_one_car_are_titled_by_it(motion_fit, laps):
    cars = [NamedFit(name, of_car(motion_fit, "full-size car"), tuple(laps)) for name in ("one", "two")]
    assert comparison(cars).title == "Comparison of 2 fits of full-size car: lap 1 and lap 2"
    others = [cars[0], replace(cars[1], fit=of_car(motion_fit, "van"))]
    assert comparison(others).title == "Comparison of 2 fits: lap 1 and lap 2"


def test_a_title_names_three_files_and_how_many_more():
    assert heading("Gap", "car", [record(f"logs/lap{k}.csv") for k in range(6)]) == (
        "Gap of car: lap0.csv, lap1.csv, lap2.csv and 3 more"
    )


@pytest.mark.parametrize("name", [PLACE, UNBROKEN], ids=["many words", "one word"])
def test_no_words_of_a_fits_pdf_overlap_nor_leave_the_page(name, motion_fit, laps, tmp_path):
    document = prepared(of_car(motion_fit, name), laps)
    longest = replace(document, title=heading("Fit", name, [record(f"{name}_{k}.csv") for k in range(6)]))
    with pdfium.PdfDocument(write_pdf(longest, tmp_path / "fit.pdf")) as pdf:
        assert [trouble for page in pdf for trouble in over_others(page)] == []
