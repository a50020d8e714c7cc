"""The PDF: 3 to 6 pages, the same bytes every time, fonts embedded, every number of the table of errors in it."""

import hashlib
import re
from dataclasses import replace

import pytest
from pypdf import PdfReader

from greybox_id.errors import BadInput
from greybox_id.reports.pdf import prepared, render, report


@pytest.fixture(scope="module")
def whole(small_fit, train, validate):
    return prepared(small_fit, [train, validate])


@pytest.fixture(scope="module")
def pdf(small_fit, train, validate, tmp_path_factory):
    return report(small_fit, [train, validate], tmp_path_factory.mktemp("report") / "new" / "report.pdf")


@pytest.fixture(scope="module")
def motion_pdf(motion_fit, laps, tmp_path_factory):
    return report(motion_fit, laps, tmp_path_factory.mktemp("motion") / "report.pdf")


def fonts(page):
    for font in (page["/Resources"].get("/Font") or {}).values():
        font = font.get_object()
        yield font
        for descendant in font.get("/DescendantFonts", ()):
            yield descendant.get_object()


@pytest.mark.parametrize("kind", ["pdf", "motion_pdf"])
def test_pages_and_fonts(kind, request):
    pdf = request.getfixturevalue(kind)
    reader = PdfReader(pdf)
    assert 3 <= len(reader.pages) <= 6
    found = [font for page in reader.pages for font in fonts(page)]
    assert found
    assert all(font["/Subtype"] != "/Type3" for font in found)
    described = [font["/FontDescriptor"].get_object() for font in found if "/FontDescriptor" in font]
    assert described
    assert all({"/FontFile", "/FontFile2", "/FontFile3"} & set(d) for d in described)
    assert [file.name for file in pdf.parent.iterdir()] == [pdf.name]


def test_two_reports_are_the_same_bytes(whole, pdf):
    assert hashlib.sha256(render(whole)).hexdigest() == hashlib.sha256(pdf.read_bytes()).hexdigest()


def test_every_number_of_the_table_of_errors_is_in_it(small_fit, whole, pdf):
    text = re.sub(r"\s+", " ", " ".join(page.extract_text() for page in PdfReader(pdf).pages))
    said = whole.said
    for row in said.errors.rows:
        for cell in row[2:]:
            assert cell in text
    shown = said.errors.rows[0][4].split(" ± ")[0]
    assert float(shown) == pytest.approx(small_fit.metrics["validate"]["honest"]["yaw_rate"]["rmse"], rel=0.05)


def test_a_report_of_motion_is_the_same_bytes_and_holds_its_tables(motion_fit, laps, motion_pdf):
    again = prepared(motion_fit, laps)
    assert render(again) == motion_pdf.read_bytes()
    text = re.sub(r"\s+", " ", " ".join(page.extract_text() for page in PdfReader(motion_pdf).pages))
    said = again.said
    for table in (said.errors, said.parameters, said.effects, said.combinations):
        for row in table.rows:
            assert row[2] in text


def test_another_file_is_refused_with_a_sentence(small_fit, train, validate, tmp_path):
    other = replace(validate, source=replace(validate.source, sha256="0" * 64))
    with pytest.raises(BadInput, match="is not the file the fit saw"):
        report(small_fit, [train, other], tmp_path / "report.pdf")
    with pytest.raises(BadInput, match="read differently"):
        report(small_fit, [train, validate.rows(0, 100)], tmp_path / "report.pdf")
    with pytest.raises(BadInput, match="none of the recordings given"):
        report(small_fit, [train], tmp_path / "report.pdf")
    assert not list(tmp_path.iterdir())
