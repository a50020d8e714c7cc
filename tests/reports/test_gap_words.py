"""What a diagnosis says holds for any numbers."""

import re
from dataclasses import replace

import pytest
from made_gaps import CASES, DELAY, aliased, clear, none, unknown
from report_parts import below, tables

from greybox_id.fitting.provenance import DataRecord
from greybox_id.gap.gap import Closure, Moved, Ranked
from greybox_id.reports.document import Drawing
from greybox_id.reports.gap.report import evidence, gap_report
from greybox_id.reports.gap.saved import Made
from greybox_id.reports.gap.words import (
    as_it_stands,
    before_words,
    how_far,
    interval_words,
    left,
    magnitude_words,
    told_apart,
    unchanged_words,
    verdict,
    where,
    whether,
)

INF, NAN = float("inf"), float("nan")


@pytest.mark.parametrize(
    ("effect", "magnitude", "unit", "interval", "said"),
    [
        ("steering_delay", 0.031, "s", (0.0251, 0.0369), "31 ± 3 ms"),
        ("steering_lag", 0.018, "s", (0.005, 0.06), "18 ms [5, 60]"),
        ("motor_lag", 1.2, "s", (1.0, 1.4), "1.20 ± 0.10 s"),
        ("steering_offset", -0.0123, "rad", (-0.0143, -0.0103), "−12.3 ± 1.0 mrad"),
        ("grip_scale", 0.84, "1", (0.8, 0.88), "× 0.840 ± 0.020"),
        ("combined_slip", 0.6, "1", (0.2, 1.0), "0.60 ± 0.20"),
        ("steering_rate_limit", 0.62, "rad/s", (0.55, INF), "0.620 rad/s [0.550, ∞]"),
        ("steering_rate_limit", 0.62, "rad/s", (-INF, INF), "0.620 rad/s"),
        ("aero_drag", 0.21, "N s^2/m^2", (0.21, 0.21), "0.210 N s²/m² [0.210, 0.210]"),
        ("steering_delay", 0.031, "s", (NAN, NAN), "31.0 ms"),
        ("sensor_latency_yaw", 0.0, "s", (0.0, 0.0031), "0.00 ms [0.00, 3.10]"),
        ("never_heard_of", 3.0, "N", (2.0, 4.0), "3.0 ± 0.5 N"),
    ],
)
def test_magnitudes_have_units_of_handy_size(effect, magnitude, unit, interval, said):
    assert magnitude_words(Ranked(effect, 0.5, magnitude, unit, interval)) == said


def test_intervals_have_the_unit_of_their_estimate():
    assert interval_words(DELAY) == "[25.1, 36.9] ms"


def test_what_was_before_has_the_unit_of_what_is_now():
    assert before_words(DELAY, 0.0123) == "12 ms"
    assert before_words(Ranked("grip_scale", 0.99, 0.84, "1", (0.8, 0.88)), 1.0) == "× 1.0"
    assert unchanged_words("steering_delay", 0.009) == "steering_delay (± 9.0 ms)"
    assert unchanged_words("mass_change", 0.07) == "mass_change (± 7.0 %)"


def test_whether_there_is_a_gap():
    quiet = replace(clear(), where=replace(clear().where, channels={"yaw_rate": 1.02, "v_x": 1.0}))
    assert "in free run it hardly does" in whether(quiet)
    of_the_error = "the error of yaw_rate is 3.1 times its noise (p\u00a0<\u00a00.001)."
    assert whether(clear()).endswith(f"in free run, with tolerances refitted, {of_the_error}")
    assert whether(replace(clear(), moved=())).endswith(f"in free run {of_the_error}")
    assert whether(none()).startswith("No gap: ")
    assert "states no sensor noise" in whether(replace(none(), noise_stated=False))
    assert "(p\u00a0=\u00a00.43); the largest error in free run, that of yaw_rate, is 1.0 times" in whether(none())
    assert "agree within noise and stated tolerances (p" in whether(none())
    far = replace(none(), where=replace(none().where, channels={"yaw_rate": 1.8}))
    assert (
        "agree within noise, stated tolerances and unknown forces of 0.40 % of the modelled forces (their effects add "
        "up along a free run)" in whether(far)
    )
    bare = clear(where=replace(clear().where, channels={}), p_value=NAN)
    assert (
        whether(bare) == "The simulation deviates from the vehicle: its errors are 2.0 times the noise (p not known)."
    )


def test_where_is_silent_without_a_gap_and_names_shares_with_one():
    assert where(none()) == []
    said = "; ".join(where(clear()))
    assert said.startswith(
        "By equation: 78 % of the gap in steering and 15 % of the gap in M_z; By driving: 78 % of the gap while the "
        "steering moves, in 22 % of the time"
    )
    assert said.endswith("By time: 50 % of the gap lies between 31.5 and 40.0 s (14 % of the time)")
    everywhere = clear(where=replace(clear().where, regime="any", time={}))
    assert where(everywhere)[1:] == ["By driving: evenly spread over the drive"]
    thin = clear(where=replace(clear().where, regime="high_speed", time={}, equations={}))
    assert where(thin) == [
        "By equation: mostly in yaw_rate",
        "By driving: mostly at high speed",
    ]  # 25 % of the gap in 30 % of the time is no share to name


def test_indistinguishable_effects_are_named_by_rank_and_others_by_name():
    gap = unknown()
    assert told_apart(gap, gap.ranking[0]) == "cannot be distinguished from number 2 and accel_bias_y on this recording"
    assert told_apart(replace(gap, recordings=("a", "b")), gap.ranking[1]).endswith("on these recordings")
    assert told_apart(gap, DELAY) == ""


@pytest.mark.parametrize(
    ("closed", "interval", "said"),
    [
        (
            0.88,
            (0.81, 0.93),
            "with steering_delay, the excess error falls by 88 % [81, 93] on the recording “lap8” (held out)",
        ),
        (
            0.1,
            (-0.02, 0.2),
            "by 10 % [−2, 20] on the recording “lap8” (held out); the interval includes zero, so the gap may not close",
        ),
        (-0.12, (-0.3, 0.04), "adding steering_delay increases the excess error by 12 % [−4, 30]"),
        (-0.12, (-0.3, -0.02), "the excess error by 12 % [2, 30] on the recording “lap8” (held out)"),
        (NAN, (NAN, NAN), "no error beyond noise on the recording “lap8” (held out)"),
        (-0.001, (-0.3, 0.3), "the excess error by 0 % [−30, 30]"),
    ],
)
def test_how_far_is_honest(closed, interval, said):
    gap = clear()
    assert said in how_far(gap, replace(gap.held_out, closed=closed, closed_interval=interval), True)


def test_shares_of_next_to_no_gap_are_not_said_where_effects_were_chosen():
    small = Closure(1.01, 1.02, 1.0, -0.57, (-1.14, -0.15), ("lap8",))
    gap = clear(gap=small, held_out=None)
    said = how_far(gap, small, False)
    assert re.search(r"exceeds that of the noise by 1\.?0? % on the recording “lap8”", said)
    assert "the gap is too small" in said
    assert "worse" not in said
    assert "excess" not in left(gap)
    assert "the gap is too small" in how_far(gap, small, True)  # held out or not, tolerances may close it by chance
    assert "increases the excess error by 57 %" in how_far(gap, replace(small, before=1.2, after=1.3), False)
    sure = replace(small, after=1.0, closed=0.9, closed_interval=(0.8, 1.0))
    assert "falls by 90 %" in how_far(gap, sure, False)


def test_second_parameters_stand_behind_a_magnitude():
    wind = Ranked("wind_gust", 0.9, 8.0, "m/s", (6.0, 10.0), others={"wind_direction": 1.04})
    assert magnitude_words(wind) == "8.0 ± 1.0 m/s, wind_direction 1.0 rad"
    grip = Ranked("grip_scale", 0.9, 0.8, "1", (0.76, 0.84), others={"grip_scale_slope": 0.0})
    assert magnitude_words(grip) == "× 0.800 ± 0.020, grip_scale_slope 0"


def test_parameters_beyond_their_tolerances_are_no_agreement_within_these():
    near, far = Moved("D_f", "1", 1.0, 0.01, 1.02), Moved("C_f", "1", 1.1, 0.01, 1.196)
    assert "within noise and stated tolerances" in whether(replace(none(), moved=(near,)))
    said = whether(replace(none(), moved=(far, near)))
    assert "stated tolerances" not in said
    assert "C_f is 9.6 standard deviations from its stated value" in said


def test_a_closed_model_that_errs_more_as_it_stands_is_warned_of():
    gap = replace(clear(), moved=())
    assert as_it_stands(gap, gap.held_out) == ""
    free = next(error for error in gap.held_out.errors if error.horizon is None)
    worse = replace(gap.held_out, errors=(replace(free, before=2 * free.floor, after=3 * free.floor),))
    assert "9.00 instead of 4.00 times that of noise" in as_it_stands(gap, worse)
    assert as_it_stands(gap, replace(worse, closed=-0.2)) == ""  # how far it closes has said it
    better = replace(worse, errors=(replace(free, before=9 * free.floor, after=2 * free.floor),))
    assert as_it_stands(gap, better) == ""
    moved = replace(gap, moved=(Moved("steering_lag", "s", 0.0, 0.03, 0.06),))
    told = as_it_stands(moved, better)
    assert told.startswith("with re-estimated parameters and steering_delay")
    assert "in free run falls from 81.0 to 4.00 times that of noise" in told
    said = dict(verdict(replace(gap, held_out=worse)))
    assert as_it_stands(gap, worse)[1:] in said["Errors"]


def test_nothing_applied_closes_nothing():
    gap = clear(applied=(), moved=())
    assert how_far(gap, gap.gap, False) == "no effect was applied, so the error stays as it is on the recording “lap7”"
    assert how_far(none(), none().gap, False) == "there is no error beyond noise on the recording “lap7”"
    assert "within their tolerances" in how_far(replace(none(), moved=clear().moved), none().gap, False)
    assert how_far(clear(applied=()), gap.gap, True) == (
        "no effect was applied, but parameters were re-estimated; errors are those on the recording “lap7” (held out)"
    )


def test_what_is_left_never_exceeds_everything_and_is_never_certain():
    assert left(clear()).startswith("16 % of the excess error is unexplained; ")
    assert "all of the excess error is unexplained" in left(unknown())
    assert left(clear(unknown_probability=1.0)).endswith("probability above 0.99")
    assert left(clear(unknown_probability=0.0)).endswith("probability below 0.01")


def test_doubts_come_first_and_many_are_counted():
    leads = ["Doubt", "Doubt", "Gap", "Where", "Cause", "Budget", "Errors", "Remains"]
    assert [lead for lead, _ in verdict(aliased())] == leads
    many = verdict(clear(doubts=tuple(f"doubt {k}" for k in range(5))))
    assert many[3] == ("", "and 2 more doubts")


@pytest.mark.parametrize("case", CASES)
def test_a_report_holds_words_only(case):
    record = DataRecord("validate", "lap8", "runs/lap8.csv", "b3" * 32, "canonical", 3000, 1, 60.0)
    document = gap_report(CASES[case](), Made("car", "greybox gap lap7.csv", 0, "0.1.0", (record,)))
    recordings, made = below(document, "How to repeat the diagnosis")
    assert recordings.rows[0][:2] == ("held out", "lap8.csv")
    assert dict(made.pairs)["command"] == "greybox gap lap7.csv"
    for table in tables(document):
        assert all(len(row) == len(table.head) and all(isinstance(cell, str) for cell in row) for row in table.rows)
    words = [part for part in document.flat if not isinstance(part, Drawing)]
    assert not re.search(r"\b(nan|inf|None)\b", str(words))


def test_the_runner_up_is_always_discussed():
    (first, _), (second, words) = evidence(clear())
    assert (first, second) == ("steering_delay", "steering_lag")
    assert "by 190, 24.0 less than the effect with the largest gain does. It cannot be distinguished" in words
    assert "distinguished from steering_delay" in words
