"""The PDF: 4 to 12 pages, the same bytes every time, fonts embedded, every cell of its tables in it."""

import hashlib
import re
from dataclasses import replace

import pytest
from pypdf import PdfReader
from report_parts import tables

from greybox_id.base.errors import BadInput
from greybox_id.reports.pdf import rendered
from greybox_id.reports.report import prepared, write


@pytest.fixture(scope="module")
def whole(small_fit, train, validate):
    return prepared(small_fit, [train, validate])


@pytest.fixture(scope="module")
def pdf(small_fit, train, validate, tmp_path_factory):
    return write(prepared(small_fit, [train, validate]), tmp_path_factory.mktemp("report") / "new" / "report.pdf")


@pytest.fixture(scope="module")
def motion_pdf(motion_fit, laps, tmp_path_factory):
    return write(prepared(motion_fit, laps), tmp_path_factory.mktemp("motion") / "report.pdf")


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
    assert 4 <= len(reader.pages) <= 12
    found = [font for page in reader.pages for font in fonts(page)]
    assert found
    assert all(font["/Subtype"] != "/Type3" for font in found)
    described = [font["/FontDescriptor"].get_object() for font in found if "/FontDescriptor" in font]
    assert described
    assert all({"/FontFile", "/FontFile2", "/FontFile3"} & set(d) for d in described)
    assert [file.name for file in pdf.parent.iterdir()] == [pdf.name]


def text_of(pdf):
    return re.sub(r"\s+", "", " ".join(page.extract_text() for page in PdfReader(pdf).pages))


def test_two_reports_are_the_same_bytes(whole, pdf):
    assert hashlib.sha256(rendered(whole)).hexdigest() == hashlib.sha256(pdf.read_bytes()).hexdigest()


@pytest.mark.parametrize("kind", ["pdf", "motion_pdf"])
def test_every_number_of_every_table_is_in_it(kind, request, whole, motion_fit, laps):
    text = text_of(request.getfixturevalue(kind))
    document = whole if kind == "pdf" else prepared(motion_fit, laps)
    found = list(tables(document))
    assert len(found) >= 5
    for table in found:
        for row in table.rows:
            for cell in (cell for cell in row if re.search(r"\d ± \d|^\[", cell)):
                assert re.sub(r"\s+", "", cell) in text


def test_the_error_shown_is_the_fit_s(small_fit, whole):
    errors = next(table for table in tables(whole) if table.head[:2] == ("output", "protocol"))
    shown = errors.rows[0][4].split(" ± ")[0]
    assert float(shown) == pytest.approx(small_fit.metrics["validate"]["honest"]["yaw_rate"]["rmse"], rel=0.05)


def test_a_report_of_motion_is_the_same_bytes(motion_fit, laps, motion_pdf):
    assert rendered(prepared(motion_fit, laps)) == motion_pdf.read_bytes()


def test_another_file_is_refused_with_a_sentence(small_fit, train, validate, tmp_path):
    other = replace(validate, source=replace(validate.source, sha256="0" * 64))
    with pytest.raises(BadInput, match="is not the file the fit was made with"):
        prepared(small_fit, [train, other])
    with pytest.raises(BadInput, match="read differently"):
        prepared(small_fit, [train, validate.rows(0, 100)])
    with pytest.raises(BadInput, match="none of the recordings given"):
        prepared(small_fit, [train])
    assert not list(tmp_path.iterdir())
