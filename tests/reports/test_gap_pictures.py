"""The picture and the report of a diagnosis show what it says, whatever it holds."""

import io
from dataclasses import replace

import numpy as np
import pytest
from letters_of import boxes, drawn, troubles
from made_gaps import CASES, DELAY, LAG, clear, none, strip, without_v_y
from pypdf import PdfReader
from report_parts import below

from greybox_id.base.errors import BadInput
from greybox_id.fitting.provenance import DataRecord
from greybox_id.gap.gap import Ranked, Where
from greybox_id.models.effects import EFFECTS
from greybox_id.reports.document import Formulas, Text
from greybox_id.reports.equations.typesetting import in_typst
from greybox_id.reports.figures.sheet import SMALL, Sheet
from greybox_id.reports.gap.page import (
    MOVED,
    after_words,
    aliases,
    bars,
    drawings,
    ranking,
    regimes,
    relative,
    spectra,
    strips,
    write_picture,
)
from greybox_id.reports.gap.page import SHARE_OPACITY as OPACITY
from greybox_id.reports.gap.report import gap_report, ranked, write_report
from greybox_id.reports.gap.saved import Made
from greybox_id.reports.html import page as html
from greybox_id.reports.pdf import rendered

MADE = Made(
    "full-size car",
    "greybox gap lap7.csv --vehicle car.toml",
    0,
    "0.1.0",
    (DataRecord("train", "lap7", "lap7.csv", "a3" * 32, "canonical", 3000, 1, 60.0),),
)


def test_bars_are_as_high_as_errors_and_the_floor_lies_across():
    closure = clear().gap
    ax = bars(closure, after_words(closure, True)).axes[2]
    own = [e for e in closure.errors if e.channel == "yaw_rate"]
    before, after = ([bar.get_height() for bar in bars] for bars in ax.containers)
    assert before == [e.before for e in own]
    assert after == [e.after for e in own]
    (floor,) = ax.lines
    assert floor.get_ydata()[::3].tolist() == [e.floor for e in own]
    assert ax.get_title() == "yaw rate [rad/s]"
    assert [words.get_text() for words in ax.get_xticklabels()] == ["0.1", "0.5", "2", "free"]
    assert len(bars(closure, "").axes[2].containers) == 1


def test_a_channel_that_is_not_recorded_has_no_panel():
    assert len(bars(without_v_y().gap, MOVED).axes) == 4
    assert len(spectra(without_v_y().strip, True).axes) == 4


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


def test_the_map_is_grey_where_nothing_was_driven_and_says_where_there_is_no_gap():
    own, place, nowhere = clear().strip, Sheet((100.0,)).first(), Sheet((100.0,)).first()
    regimes(place, own)
    never, *shades = place.patches
    assert never.get_label() == "never driven"
    assert corners(never) == np.isnan(own.map["gap"]).sum() == 4
    assert sum(map(corners, shades)) == np.isfinite(own.map["gap"]).sum()
    (most,) = (shade for shade in shades if shade.get_alpha() == OPACITY[1])
    i, j = np.unravel_index(np.nanargmax(own.map["gap"]), own.map["gap"].shape)
    assert most.get_path().vertices[0].tolist() == [own.map["v_x"][i], own.map["a_y"][j]]
    assert place.child_axes[0].get_ylabel() == "share of the gap [%]"
    regimes(nowhere, none().strip)
    assert "no gap to show in a map" in " ".join(nowhere.texts[0].get_text().split())


def test_the_stretch_that_holds_half_of_the_gap_is_shaded():
    gap = clear()
    ax = strips(gap.strip, gap.where.time, True).first()
    (shade,) = ax.collections
    assert (shade.get_paths()[0].get_extents().intervalx == [31.5, 40.0]).all()
    _, before, after = ax.lines
    assert (before.get_ydata() == gap.strip.before).all()
    assert (after.get_ydata() == gap.strip.after).all()
    assert not strips(gap.strip, {}, False).first().collections


def corners(cells):
    """Of a map, how many cells are of one shade."""
    return len(cells.get_path().vertices) // 5


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


@pytest.mark.parametrize("case", [*CASES, *_odd()])
def test_letters_do_not_overlap_nor_leave_the_figure(case):
    for one in drawings(CASES[case]() if case in CASES else _odd()[case]):
        assert troubles(one.svg) == [], one.name


@pytest.mark.parametrize("names", [tuple(EFFECTS)[k : k + 6] for k in range(0, len(EFFECTS), 6)])
def test_every_effects_name_stands_whole_beside_its_bar(names):
    gap = clear(ranking=tuple(replace(DELAY, effect=name) for name in names))
    (causes,) = (one for one in drawings(gap) if one.name == "gap_ranking")
    words = {name.replace("_", " ") for name in names}
    beside = [(own, box[2] - drawn(own, SMALL)) for own, box in boxes(causes.svg)[0] if own in words]
    assert len(beside) == len(names)
    assert [own for own, left in beside if left < 0.0] == []


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
    assert 4 <= len(reader.pages) <= 12
    text = " ".join(" ".join(page.extract_text() for page in reader.pages).split())
    for row in ranked(gap).rows:
        assert row[1] in text
        assert row[4] in text
    assert MADE.command in text
    assert "Doubts about the data" in text
    assert [file.name for file in tmp_path.iterdir()] == ["gap.pdf"]


@pytest.mark.slow
@pytest.mark.parametrize("case", [*CASES, *_odd()])
def test_two_reports_are_the_same_bytes(case, tmp_path):
    gap = CASES[case]() if case in CASES else _odd()[case]
    document = gap_report(gap, MADE)
    assert write_report(gap, MADE, tmp_path / "gap.pdf").read_bytes() == rendered(document)
    assert write_report(gap, MADE, tmp_path / "gap.html").read_text("utf-8") == html(document)


@pytest.mark.parametrize("case", CASES)
def test_a_report_has_four_to_twelve_pages_whether_there_is_a_gap_or_not(case):
    assert 4 <= len(PdfReader(io.BytesIO(rendered(gap_report(CASES[case](), MADE)))).pages) <= 12


def test_the_runner_up_is_told():
    said = {
        part.lead: part.words for part in below(gap_report(clear(), MADE), "Which effect") if isinstance(part, Text)
    }
    assert said["Runner-up:"].startswith("steering_lag (18 ms")
    assert "24.0 less than steering_delay" in said["Runner-up:"]
    assert below(gap_report(none(), MADE), "Which effect") == []


def test_the_equations_an_effect_changes_are_shown():
    document = gap_report(clear(), MADE)
    parts = below(document, "What these effects do to the equations")
    lines = [in_typst(line) for part in parts if isinstance(part, Formulas) for line in part.equations]
    assert any("steering delay" in line for line in lines)
    assert not any("F_zf" in line.split("=")[0] for line in lines)  # loads are what they were


def test_what_cannot_be_distinguished_is_not_joined_across_what_can():
    apart = replace(LAG, effect="steering_offset", indistinguishable_from=())
    first = replace(DELAY, indistinguishable_from=("steering_lag",))
    second = replace(LAG, indistinguishable_from=("steering_delay",))
    ax = ranking(clear(ranking=(first, apart, second))).axes[0]
    (line,) = [own for own in ax.lines if len(set(own.get_xdata())) == 1]
    assert np.isnan(line.get_ydata()[1])
    assert line.get_ydata()[[0, 2]].tolist() == [0.0, 2.0]


def test_a_report_is_titled_by_car_and_recording():
    document = gap_report(clear(), MADE)
    assert document.title.startswith("Gap of full-size car: lap7")


def test_long_magnitudes_leave_the_other_columns_alone():
    others = {"wind_direction": 1.0, "tyre_temperature_E_0": 123456.0, "roll_frequency": 1.5}
    row = ranked(
        clear(ranking=(replace(DELAY, others=others, since=41.0, within="a_recording_with_a_long_name, run 12"),))
    )
    flexible = [head for head, letter in zip(row.head, row.letters, strict=True) if letter.isupper()]
    assert {"effect", "magnitude ± sd", "95 % interval"} <= set(flexible)
