"""The kit that draws figures: ticks are round and within, letters keep apart, one drawing serves light and dark."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from letters_of import boxes, troubles
from scipy import signal

from greybox_id.reports.figures.style import label
from greybox_id.reports.plot.areas import Bars, Boxes, Cells, Spots
from greybox_id.reports.plot.figure import Figure, Panel, Shades, grid, nothing
from greybox_id.reports.plot.marks import Band, Curve, Letters, Rule
from greybox_id.reports.plot.palette import BLUE, DARK, INK, LIGHT, ORANGE, PALE, Line
from greybox_id.reports.plot.scale import Axis, scaled
from greybox_id.reports.spectra import correlation, detrended, welch
from greybox_id.reports.words import Span, named, spans


@pytest.mark.parametrize("ends", [(0.0, 1.0), (-3.7, 12.9), (1e-7, 4e-7), (-2e6, 5e6), (0.499, 0.501), (7.0, 7.0)])
@pytest.mark.parametrize("length", [20.0, 80.0, 400.0])
def test_ticks_are_within_the_axis_and_round(ends, length):
    scale = scaled(Axis(), [np.array(ends)], length)
    values = [value for value, _ in scale.ticks]
    assert 2 <= len(values) <= 12
    assert all(scale.low <= value <= scale.high + 1e-12 for value in values)
    steps = np.diff(values)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
    assert len({words for _, words in scale.ticks}) == len(values)


@pytest.mark.parametrize("ends", [(1e-12, 1e3), (0.02, 0.9), (0.5, 2.0), (1.0, 1.0)])
def test_ticks_of_logarithms_are_powers_or_few_between(ends):
    scale = scaled(Axis(log=True), [np.array([*ends, 0.0, -1.0, np.nan])], 120.0)
    assert 1 <= len(scale.ticks) <= 12
    at = scale(np.array([value for value, _ in scale.ticks]))
    assert np.all((at >= -1e-9) & (at <= 120.0 + 1e-9))
    assert np.isnan(scale(np.array([0.0, -1.0]))).all()


def everything():
    x = np.linspace(0.0, 10.0, 50)
    marks = (
        Band(x, np.sin(x) - 0.2, np.sin(x) + 0.2, words="band"),
        Curve(x, np.where(x > 5, np.nan, np.sin(x)), Line(BLUE, words="curve"), dots=1.0, whiskers=0.1 * x),
        Bars(x[:-1], x[1:], np.cos(x[:-1]), words="bars"),
        Boxes([1.0, 2.0], [np.sin(x), np.cos(x)], 0.4, ORANGE, "boxes"),
        Rule(0.0), Rule(5.0, Line(PALE), upright=True), Letters(5.0, 0.5, "v_x"),
    )  # fmt: skip
    cells = Cells(np.arange(4.0), np.arange(3.0), np.array([[0.1, np.nan], [1.0, -0.5], [0.3, 0.0]]), words="cells")
    spots = Spots(x, np.sin(x), np.abs(np.sin(x)), INK)
    shades = Shades(((0.0, "0"), (1.0, "1")), "share [1]")
    left = Panel(marks, Axis("time [s]"), Axis(label("yaw_rate", "rad/s")), "all of it")
    right = Panel((cells,), Axis("v_x [m/s]"), Axis("a_y [m/s²]"), shades=shades)
    third = Panel((spots,), Axis("x [m]"), Axis("y [m]"), equal=True)
    return Figure(
        ((left, right), (third, nothing("nothing to be seen here at all, and that in many words"))), (90.0, 70.0)
    )


def test_a_figure_of_everything_is_well_formed_and_no_letters_meet():
    svg = everything().svg("all marks & <more>")
    ElementTree.fromstring(svg)
    assert troubles(svg) == []
    assert "nan" not in svg
    found, _ = boxes(svg)
    assert {"time [s]", "band", "curve", "cells", "vx"} <= {words for words, _ in found}


def test_letters_that_meet_or_are_cut_would_be_found():
    long = "a title that is longer than its panel is wide, and then some more words to be sure"
    assert troubles(grid([Panel((), title=long), Panel((), title=long)], 2, 50.0).svg())
    assert troubles(Figure(((Panel((), title=long + long),),), (50.0,)).svg())


def test_colours_are_named_in_the_drawing_and_said_beside_it():
    drawn, page = everything().svg(), everything().svg(palette=None)
    assert "<style>" in drawn
    assert "<style>" not in page
    assert not re.search(r"#[0-9a-f]{6}", page)
    used = set(re.findall(r"[sf]-(\w+)", page))
    assert used <= set(LIGHT) == set(DARK)


def test_colours_differ_in_lightness_for_a_grey_printer():
    for palette in (LIGHT, DARK):
        grey = {
            name: np.dot([int(palette[name][k : k + 2], 16) for k in (1, 3, 5)], [0.2126, 0.7152, 0.0722])
            for name in (INK, BLUE, ORANGE)
        }
        ranked = sorted(grey.values())
        assert np.min(np.diff(ranked)) > 25


def test_a_long_curve_is_thinned_without_losing_its_peaks():
    x = np.linspace(0.0, 100.0, 100_000)
    y = np.sin(x) * 0.1
    y[54_321] = 7.0
    figure = Figure(((Panel((Curve(x, y, Line(BLUE)),)),),), (100.0,))
    svg = figure.svg()
    assert len(svg) < 100_000
    heights = [float(own) for own in re.findall(r"[ML][\d.]+ (-?[\d.]+)", svg)]
    assert min(heights) < 5.0  # the peak is there, just below the upper end


def test_symbols_are_told_from_words():
    assert spans("error of v_x") == (Span("error of "), Span("v", ("x",), True))
    assert spans("yaw_rate, drive_split_front and lap_2") == (Span("yaw_rate, drive_split_front and lap_2"),)
    assert spans("C_alpha_f / m") == (Span("C", ("α", "f"), True), Span(" / m"))
    assert spans("run_a/fit_b.json") == (Span("run_a/fit_b.json"),)
    assert named("m") == (Span("m", symbol=True),)


def test_spectra_and_trends_are_those_of_scipy():
    values = np.cumsum(np.random.default_rng(0).standard_normal(700))
    frequency, density = welch(values, 20.0, 128)
    expected = signal.welch(values, 20.0, "hamming", 128, 64, detrend="constant")
    np.testing.assert_allclose(frequency, expected[0])
    np.testing.assert_allclose(density, expected[1], rtol=1e-9)
    np.testing.assert_allclose(detrended(values), signal.detrend(values), atol=1e-9)


def test_correlations_tell_what_comes_first():
    rng = np.random.default_rng(1)
    drive = [rng.standard_normal(400) for _ in range(3)]
    late = [np.roll(own, 5) for own in drive]
    found = correlation(list(zip(late, drive, strict=True)), 20)
    assert int(np.argmax(found)) == 5
    assert found[5] > 0.95
    assert correlation([(own, own) for own in drive], 3)[0] == pytest.approx(1.0)
