"""What draws figures: ticks are round and within, letters keep apart, one drawing serves light and dark."""

import gc
import re
import weakref
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from letters_of import troubles

from greybox_id.reports.figures.sheet import (
    BLUE,
    DARK,
    INK,
    LIGHT,
    PALE,
    SMALL,
    ZERO,
    Sheet,
    band,
    cells,
    label,
    look,
    notice,
    shades,
    sheet_of,
)
from greybox_id.reports.words import Span, named, spans

SVG = "{http://www.w3.org/2000/svg}"
ENDS = [(0.0, 1.0), (-3.7, 12.9), (1e-7, 4e-7), (-2e6, 5e6), (0.499, 0.501), (7.0, 7.0)]


def ticks_of(axis):
    low, high = axis.get_view_interval()
    found = [
        (at, label.get_text()) for at, label in zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=True)
    ]
    return [(at, words) for at, words in found if low <= at <= high]


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("length", [20.0, 80.0, 400.0])
def test_ticks_are_round_few_and_told_apart(ends, length):
    sheet = Sheet((length,))
    sheet.first().plot([0.0, 1.0], ends, **look(BLUE))
    sheet.svg()
    values, words = zip(*ticks_of(sheet.first().yaxis), strict=True)
    assert 2 <= len(values) <= 9
    np.testing.assert_allclose(np.diff(values), values[1] - values[0], rtol=1e-6)
    assert len(set(words)) == len(values)


@pytest.mark.parametrize("ends", [(1e-12, 1e3), (0.02, 0.9), (0.5, 2.0), (1.0, 1.0)])
def test_ticks_of_logarithms_are_powers_or_few_between(ends):
    sheet = Sheet((120.0,))
    sheet.first().plot(range(5), [*ends, 0.0, -1.0, np.nan], **look(BLUE))
    sheet.first().set_yscale("log")
    sheet.svg()
    ticks = ticks_of(sheet.first().yaxis)
    assert 1 <= len(ticks) <= 12
    assert all(re.fullmatch(r"10[⁻⁰¹²³⁴-⁹]+|[\d.]+", words) for _, words in ticks), ticks
    assert np.all(np.log10([at for at, _ in ticks]) % 1.0 < 1e-9) == (ends[1] > 200 * ends[0])


def everything():
    x = np.linspace(0.0, 10.0, 50)
    sheet = Sheet((90.0, 70.0), 2)
    one, two, three, four = sheet.grid.flat
    band(one, x, np.sin(x) - 0.2, np.sin(x) + 0.2, label="band")
    one.plot(x, np.where(x > 5, np.nan, np.sin(x)), **look(BLUE, label="curve", dots=1.0))
    one.bar(x, np.cos(x), 0.2, color=PALE, label="bars")
    one.axhline(0.0, **ZERO)
    one.text(5.0, 0.5, "v_x & 0.005 <more>", size=SMALL)
    one.set(xlabel="time [s]", ylabel=label("yaw_rate", "rad/s"), title="all of it")
    edges = np.arange(4.0)
    cells(two, edges, edges[:3], np.array([[0.1, np.nan], [1.0, -0.5], [0.3, 0.0]]), label="cells")
    shades(two, ((0.0, "0"), (1.0, "1")), "share [1]")
    two.set(xlabel="v_x [m/s]", ylabel="a_y [m/s²]")
    three.scatter(x, np.sin(x), color=INK)
    three.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", adjustable="datalim")
    notice(four, "nothing to be seen here at all, and that in many words")
    return sheet


def test_a_figure_of_everything_is_well_formed_and_no_letters_meet():
    sheet = everything()
    svg = sheet.svg("all marks & <more>")
    root = ElementTree.fromstring(svg)
    assert root.get("width") == "497pt"
    assert root.find(f"{SVG}title").text == "all marks & <more>"
    assert troubles(sheet.svg()) == []
    assert "nan" not in svg
    said = {"".join(own.itertext()) for own in root.iter(f"{SVG}text")}
    assert {"time [s]", "band", "curve", "bars", "cells", "vx [m/s]", "vx & 0.005 <more>"} <= said


def test_axes_are_as_high_as_they_are_to_be_and_stand_below_the_legend():
    sheet = everything()
    sheet.svg()
    assert [ax.bbox.height for ax in sheet.grid[:, 0]] == pytest.approx([90.0, 70.0])
    renderer = sheet.canvas.get_renderer()
    assert sheet.legends[0].get_window_extent(renderer).y0 > sheet.first().title.get_window_extent(renderer).y1


def test_letters_that_meet_or_are_cut_would_be_found():
    long = "a title that is longer than its axes are wide, and then some more words to be sure, "
    two, _ = sheet_of(2, 2, 50.0)
    for ax in two.grid[0]:
        ax.set_title(long)
    assert troubles(two.svg())
    one = Sheet((50.0,))
    one.first().set_title(long + long)
    assert troubles(one.svg())


def test_colours_are_in_the_drawing_and_named_on_a_page():
    sheet = everything()
    drawn, page = sheet.svg(), sheet.svg(colours=False)
    assert "var(" not in drawn
    assert set(re.findall(r"#[0-9a-f]{6}\b", drawn)) <= set(LIGHT.values())
    assert not re.search(r"#[0-9a-f]{6}\b(?!\w)", page.replace("url(#", ""))
    assert set(re.findall(r"var\(--(\w+)\)", page)) <= set(LIGHT) == set(DARK)


def test_a_drawing_does_not_depend_on_what_a_user_has_set_in_matplotlib():
    plain = everything().svg()
    with mpl.rc_context({"font.size": 20.0, "axes.grid": False, "svg.hashsalt": "x", "savefig.bbox": "tight"}):
        assert everything().svg() == plain


def test_colours_differ_in_lightness_for_a_grey_printer():
    for palette in (LIGHT, DARK):
        grey = {
            name: np.dot([int(palette[name][k : k + 2], 16) for k in (1, 3, 5)], [0.2126, 0.7152, 0.0722])
            for name in ("ink", "blue", "orange")
        }
        ranked = sorted(grey.values())
        assert np.min(np.diff(ranked)) > 25


def test_a_long_curve_is_thinned_without_losing_its_peaks():
    x = np.linspace(0.0, 100.0, 100_000)
    y = np.sin(x) * 0.1
    y[54_321] = 7.0
    sheet = Sheet((100.0,))
    sheet.first().plot(x, y, **look(BLUE))
    svg = sheet.svg()
    assert len(svg) < 100_000
    (line,) = re.findall(r'<path d="([^"]*)" clip-path="[^"]*" style="[^"]*#0072b2', svg)
    heights = [float(match) for match in re.findall(r"[ML] [\d.]+ ([\d.]+)", line)]
    assert max(heights) - min(heights) == pytest.approx(100.0 * 7.1 / (1.08 * 7.1), rel=0.01)


def test_symbols_are_told_from_words():
    assert spans("error of v_x") == (Span("error of "), Span("v", ("x",), True))
    assert spans("yaw_rate, drive_split_front and lap_2") == (Span("yaw_rate, drive_split_front and lap_2"),)
    assert spans("C_alpha_f / m") == (Span("C", ("α", "f"), True), Span(" / m"))
    assert spans("run_a/fit_b.json") == (Span("run_a/fit_b.json"),)
    assert named("m") == (Span("m", symbol=True),)


def test_a_sheet_that_nobody_needs_leaves_the_memory():
    sheet = Sheet((40.0, 40.0))
    sheet.first().plot([0.0, 1.0])
    assert "<path" in sheet.svg()
    gone = weakref.ref(sheet)
    del sheet
    gc.collect()
    assert gone() is None
