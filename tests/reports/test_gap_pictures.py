"""The picture and the report of a diagnosis show what it says, whatever it holds."""

from dataclasses import replace

import numpy as np
import pytest
from greybox_id.reports.gap.pdf import drawing, render, write_report
from made_gaps import CASES, DELAY, LAG, clear, none, strip, without_v_y
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from pypdf import PdfReader

from greybox_id.errors import BadInput
from greybox_id.gap import Ranked, Where
from greybox_id.provenance import DataRecord
from greybox_id.reports.figures.style import canvas, look
from greybox_id.reports.gap.content import Made, gap_content
from greybox_id.reports.gap.figures.bars import bars
from greybox_id.reports.gap.figures.looks import EXCESS
from greybox_id.reports.gap.figures.ranking import aliases, relative
from greybox_id.reports.gap.figures.regimes import regimes
from greybox_id.reports.gap.figures.spectra import spectra
from greybox_id.reports.gap.figures.strips import running, strips
from greybox_id.reports.gap.page import page, write_picture

MADE = Made(
    "full-size car",
    "greybox gap lap7.csv --vehicle car.toml",
    0,
    "0.1.0",
    (DataRecord("train", "lap7", "lap7.csv", "a3" * 32, "canonical", 3000, 1, 60.0),),
)


def drawn(panel, *arguments) -> Figure:
    with look():
        figure = canvas(3.0)
        panel(figure, *arguments)
        figure.canvas.draw()
    return figure


def test_bars_are_as_high_as_errors_and_the_floor_lies_across():
    closure = clear().gap
    axes = drawn(bars, closure, True).axes[2]
    own = [e for e in closure.errors if e.channel == "yaw_rate"]
    assert [bar.get_height() for bar in axes.patches] == [e.before for e in own] + [e.after for e in own]
    assert [level[0][1] for level in axes.collections[0].get_segments()] == [e.floor for e in own]
    assert axes.get_title() == "yaw rate [rad/s]"
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0.1", "0.5", "2", "free"]
    assert len(drawn(bars, closure, False).axes[2].patches) == len(own)


def test_a_channel_that_is_not_recorded_has_no_panel():
    assert len(drawn(bars, without_v_y().gap, True).axes) == 4
    assert len(drawn(spectra, without_v_y().strip, True).axes) == 4


def test_what_cannot_be_told_apart_is_joined():
    c = Ranked("road_bank", 0.1, 1.0, "rad", (0, 1), ("accel_bias_y",))
    d = Ranked("accel_bias_y", 0.1, 1.0, "m/s^2", (0, 1), ("wind_gust",))
    assert aliases([DELAY, c, LAG, d]) == [[0, 2], [1, 3]]
    assert aliases([DELAY, c]) == []


@pytest.mark.parametrize(
    ("effect", "value", "magnitude", "share"),
    [
        ("steering_delay", 0.0, 0.03, 0.0),
        ("steering_delay", 0.06, 0.03, 2.0),
        ("grip_scale", 1.0, 0.8, 0.0),
        ("grip_scale", 0.7, 0.8, 1.5),
        ("steering_rate_limit", float("inf"), 0.5, 0.0),
        ("steering_rate_limit", 0.25, 0.5, 2.0),
        ("steering_offset", -0.02, -0.01, 2.0),
    ],
)
def test_intervals_are_counted_from_where_the_effect_is_not_there(effect, value, magnitude, share):
    assert relative(effect, value, magnitude) == pytest.approx(share)


def test_the_map_is_hatched_where_nothing_was_driven_and_says_where_there_is_no_gap():
    axes, bar = drawn(regimes, clear().strip).axes
    values = axes.collections[0].get_array()
    assert float(np.ma.sum(values)) == pytest.approx(100.0)
    assert np.ma.getmaskarray(values).sum() == 4
    assert bar.get_ylabel() == "share of the gap [%]"
    (empty,) = drawn(regimes, none().strip).axes
    assert "no gap to be placed" in empty.texts[0].get_text()


def test_the_stretch_that_holds_half_of_the_gap_is_shaded():
    own = clear()
    axes = drawn(strips, own.strip, own.where.time, True).axes[0]
    (shade,) = axes.patches
    assert (shade.get_x(), shade.get_x() + shade.get_width()) == (31.5, 40.0)
    assert len(axes.lines) == 3
    assert len(drawn(strips, own.strip, {}, False).axes[0].patches) == 0


def test_time_runs_on_between_recordings():
    one = np.array([0.5, 1.5, 2.5])
    np.testing.assert_allclose(running(one), one)
    np.testing.assert_allclose(running(np.concatenate([one, one])), [0.5, 1.5, 2.5, 3.5, 4.5, 5.5])


def test_colours_fall_in_lightness_all_the_way():
    lightness = EXCESS(np.linspace(0, 1, 50))[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(lightness) < 0)


def _odd():
    own, whole = clear(), strip()
    short = {"time": whole.time[:1], "before": whole.before[:1], "after": whole.after[:1]}
    bare = replace(whole, **short, x=np.empty(0), y=np.empty(0), map={}, frequency=np.empty(0), spectrum_before={})
    gone = replace(whole, before=np.where(whole.time > 30, np.nan, 1e5 * whole.before), after=np.nan * whole.after)
    return {
        "nothing": clear(strip=None, ranking=(), applied=(), where=Where(), gap=replace(own.gap, errors=())),
        "short": clear(strip=bare),
        "gone": clear(strip=gone),
        "doubts": clear(doubts=tuple("a sentence of doubt that is long " * 6 for _ in range(6))),
    }


@pytest.mark.parametrize("case", ["aliased", "long_names", "none", *_odd()])
def test_letters_of_the_page_do_not_overlap_nor_leave_it(case):
    figure = page(CASES[case]() if case in CASES else _odd()[case])
    with look():
        renderer = FigureCanvasAgg(figure).get_renderer()
        figure.draw_without_rendering()
        boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in _texts(figure)]
    width, height = figure.bbox.size
    for words, box in boxes:
        assert box.x0 >= -1, words
        assert box.x1 <= width + 1, words
        assert box.y0 >= -1, words
        assert box.y1 <= height + 1, words
    for k, (words, one) in enumerate(boxes):
        for others, other in boxes[k + 1 :]:
            overlap = min(one.x1, other.x1) - max(one.x0, other.x0), min(one.y1, other.y1) - max(one.y0, other.y0)
            assert min(overlap) <= 2.0, (words, others)


def _texts(sheet):
    """Every text that is seen; tick labels beyond the axis' ends are not."""
    for part in (sheet, *sheet.subfigs):
        if part is not sheet:
            yield from _texts(part)
            continue
        yield from (own for own in part.texts if own.get_text().strip())
        for axes in part._localaxes:
            if not axes.axison:
                yield from axes.texts
                continue
            yield from (own for own in (axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts) if own.get_text())
            for axis in (axes.xaxis, axes.yaxis):
                low, high = sorted(axis.get_view_interval())
                for tick in axis.get_major_ticks():
                    if low <= tick.get_loc() <= high and tick.label1.get_visible() and tick.label1.get_text():
                        yield tick.label1


def test_the_page_is_written_whole_and_alike(tmp_path):
    one, two = (write_picture(_odd()["nothing"], tmp_path / f"{k}.png").read_bytes() for k in (1, 2))
    assert one.startswith(b"\x89PNG")
    assert one == two
    assert write_picture(_odd()["nothing"], tmp_path / "gap.pdf").read_bytes().startswith(b"%PDF")
    assert len(list(tmp_path.iterdir())) == 3
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match="cannot be written"):
        write_picture(_odd()["nothing"], tmp_path / "file" / "gap.png")


def test_the_report_holds_what_the_diagnosis_says(tmp_path):
    gap = replace(CASES["long_names"](), doubts=CASES["aliased"]().doubts)
    path = write_report(gap, MADE, tmp_path / "gap.pdf")
    reader = PdfReader(path)
    assert 2 <= len(reader.pages) <= 5
    text = " ".join(" ".join(page.extract_text() for page in reader.pages).split())
    for row in gap_content(gap, MADE).ranking.rows:
        assert row[1] in text
        assert row[4] in text
    assert MADE.command in text
    assert "Doubts on the data" in text
    assert [file.name for file in tmp_path.iterdir()] == ["gap.pdf"]


def test_two_reports_of_little_are_the_same_bytes(tmp_path):
    said, shown = gap_content(_odd()["nothing"], MADE), drawing(_odd()["nothing"])
    path = write_report(_odd()["nothing"], MADE, tmp_path / "gap.pdf")
    assert path.read_bytes() == render(said, shown)
