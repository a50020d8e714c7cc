"""What a report says where no gap is found: what would show, where it was driven, what was compared."""

from dataclasses import replace

import numpy as np
import pytest
from made_gaps import CASES, clear, none, strip

from greybox_id.gap.gap import Limit
from greybox_id.reports.document import Formulas, Section
from greybox_id.reports.figures.sheet import Sheet
from greybox_id.reports.gap.page import TIME_OPACITY, drawings, driven, limits
from greybox_id.reports.gap.report import channels, gap_report, limits_table, stated, unseen
from greybox_id.reports.gap.saved import Made, Number
from greybox_id.reports.html import page

MADE = Made("full-size car", "greybox gap lap7.csv --vehicle car.toml", 0, "0.1.0")


def cells(table):
    return {row[0]: row[2:] for row in table.rows}


def test_sizes_that_would_show_have_units_and_stand_beside_the_usual_ones():
    found = cells(limits_table(clear()))
    assert next(iter(found)) == "brake_bias"
    assert found["brake_bias"] == ("at no size", "0.10", "above 1000", "100 %")
    assert found["steering_rate_limit"] == ("below 0.40 rad/s", "0.50 rad/s", "1.2", "40 %")
    assert found["mass_change"] == ("± 0.12", "× 1.1", "0.80", "15 %")
    assert found["sensor_latency_yaw"] == ("± 6.7 ms", "30 ms", "0.22", "35 %")
    assert found["front_stiffness"][-1] == "below 1.0 %"
    none_would = replace(clear(), limits={"steering_rate_limit": Limit(0.0, 0.5, "rad/s", 40.0, 0.4)})
    assert cells(limits_table(none_would))["steering_rate_limit"][0] == "at no size"


def test_effects_that_would_not_show_and_regimes_hardly_driven_are_said():
    first, second = unseen(none_driven())
    assert first == (
        "3 of 6 effects would not be detected here at their usual size: brake_bias, front_stiffness and "
        "steering_rate_limit."
    )
    assert second.startswith("These regimes were hardly driven: while braking (1.0 % of the time).")
    visible = replace(none(), limits={name: clear().limits[name] for name in ("mass_change", "aero_drag")})
    assert unseen(visible) == ["Each of 2 effects would be detected here at its usual size."]
    assert unseen(replace(none(), limits={})) == []


def none_driven():
    gap = none()
    return replace(gap, where=replace(gap.where, regimes={"braking": (0.01, 0.0), "lateral": (0.6, 0.0)}))


def test_errors_beside_noise_say_where_in_frequency_they_are_largest():
    gap = clear()
    peak = np.ones(40)
    peak[7], peak[0] = 9.0, 50.0
    shown = replace(gap, strip=replace(gap.strip, spectrum_before={"yaw_rate": peak}))
    found = {row[0]: row[1:] for row in channels(shown).rows}
    assert found["yaw rate"] == ("3.1", f"{gap.strip.frequency[7]:.2f} Hz", "9.0")
    assert found["v_x"] == ("1.0", "–", "–")
    assert {row[2] for row in channels(replace(gap, strip=None)).rows} == {"–"}


def test_what_was_stated_is_told_with_its_tolerance_and_source():
    made = replace(MADE, stated=(Number("m", 1457.0, 4.4, "kg", "scale"), Number("l_f", 1.3, None, "m", ""),
                                 Number("steering_lag", None, 0.003, "s", "guess")))  # fmt: skip
    rows = stated(made).rows
    assert rows[0] == ("m", "1457.0 ± 4.4", "kg", "tolerance", "scale")
    assert rows[1][:4] == ("l_f", "1.30", "m", "exact")
    assert rows[2][:4] == ("steering_lag", "± 0.0030", "s", "tolerance")


def test_without_a_gap_limits_take_the_place_of_probabilities():
    assert [drawing.name for drawing in drawings(none())][1] == "gap_limits"
    assert [drawing.name for drawing in drawings(clear())][1] == "gap_ranking"
    assert [drawing.name for drawing in drawings(replace(none(), limits={}))][1] == "gap_ranking"


def test_bars_reach_from_the_axis_to_the_size_over_the_usual_one():
    ax, place = limits(replace(none(), strip=clear().strip)).axes
    hidden, shown = ([bar.get_x() + bar.get_width() for bar in bars] for bars in ax.containers)
    assert hidden == pytest.approx([30.0, 2.3, 1.25])
    assert shown == pytest.approx([0.8, 0.25, 0.22])
    assert "front stiffness" in [name.get_text() for name in ax.get_yticklabels()]
    time = clear().strip.map["time"]
    drawn = sum(len(shade.get_path().vertices) // 5 for shade in place.patches)
    assert drawn == time.size - 4  # nothing was driven there
    assert max(shade.get_alpha() for shade in place.patches) == pytest.approx(TIME_OPACITY[1])
    assert limits(replace(none(), limits={}, strip=None)) is None


@pytest.mark.parametrize("change", [{"map": {}}, {"map": {**strip().map, "time": np.zeros((6, 7))}}])
def test_a_map_that_is_not_known_is_a_sentence(change):
    ax = Sheet((50.0,)).first()
    driven(ax, replace(strip(), **change))
    assert "not known" in ax.texts[0].get_text()


@pytest.mark.parametrize("case", CASES)
def test_the_simulation_that_was_compared_is_written_down(case):
    document = gap_report(CASES[case](), MADE)
    titles = {part.title for part in document.flat if isinstance(part, Section)}
    assert {"What could be present undetected", "What was simulated", "How to repeat the diagnosis"} <= titles
    assert any(isinstance(part, Formulas) for part in document.parts)


def test_without_a_gap_nothing_is_shared_out():
    said = page(gap_report(none_driven(), MADE))
    assert "share of the gap" not in said
    assert "How large the errors are" in said
    assert "of the gap" not in said.partition("Where the vehicle was driven")[2]
    assert "→" not in said.partition("Held out: lap8")[2].partition("Errors compared with the noise")[0]
