"""Rows that were recorded once and are there twice."""

from dataclasses import replace

import numpy as np
import pytest

from greybox_id.datasets.checks import Severity, check
from greybox_id.datasets.checks.repeats import check_repeats, seen
from greybox_id.datasets.recording import Recording, join

T = np.arange(1500) * 0.02


def drive(seed, noise=0.01):
    """Thirty seconds of weaving."""
    rng = np.random.default_rng(seed)
    turn = np.sin(0.7 * T) + 0.5 * np.sin(1.9 * T + seed)
    signals = {"v_x": 12.0 + np.sin(0.2 * T), "yaw_rate": 0.3 * turn, "a_y": 3.6 * turn}
    noisy = {name: values + noise * np.ptp(values) * rng.standard_normal(len(T)) for name, values in signals.items()}
    return Recording(f"drive {seed}", T, {**noisy, "steer": 0.06 * turn})


def rounded(recording, digits):
    return recording.with_signals(
        **{name: np.array([float(f"{value:.{digits}g}") for value in recording[name]]) for name in recording.signals}
    )


def test_a_drive_that_was_appended_to_itself_is_told_with_its_rows():
    whole = drive(1)
    twice = join([whole, replace(whole, time=T + 400.0), replace(whole, time=T + 900.0)], "three times")
    (found,) = (item for item in check(twice) if item.kind == "repeated")
    assert found.severity is Severity.WARNING
    assert found.where.rows == tuple(range(1500, 4500))
    assert found.sentence.startswith(
        "3000 of 4500 rows repeat earlier ones; the first is row 1500, counted from 0, which equals the "
        "row 1500 rows before it."
    )


def test_a_block_of_rows_that_was_written_twice_is_told():
    whole = drive(2)
    (found,) = check_repeats(join([whole.rows(0, 900), whole.rows(700, 1500)], "block"))
    assert found.where.rows == tuple(range(900, 1100))


@pytest.mark.parametrize("noise", [0.01, 0.0005])
def test_rows_of_one_drive_and_of_another_over_the_same_road_are_no_repeats(noise):
    one, other = drive(3, noise), drive(3, noise)
    other = other.with_signals(
        **{
            name: other[name] + noise * np.random.default_rng(9).standard_normal(1500)
            for name in ("v_x", "yaw_rate", "a_y")
        }
    )
    assert check_repeats(one) == check_repeats(join([one, other], "two laps")) == []
    assert seen(other, one) == 0.0


def test_standing_and_holding_between_updates_repeat_nothing():
    rest = drive(4)
    rows = np.maximum(np.arange(1500) // 5 * 5 - 300, 0)  # stands for six seconds, then every reading five times
    held = rest.with_signals(**{name: values[rows] for name, values in rest.signals.items()})
    assert check_repeats(held) == []


@pytest.mark.parametrize("digits", [5, 6, 9])
def test_a_copy_is_seen_whatever_its_clock_says_and_though_it_has_fewer_digits(digits):
    whole = drive(5)
    copy = replace(rounded(whole.rows(500, 1000), digits), time=T[:500] + 77.0)
    assert seen(copy, whole) == pytest.approx(1.0, abs=0.02)
    assert seen(whole, copy) == pytest.approx(1 / 3, abs=0.02)
    assert seen(drive(6), whole) == 0.0


def test_holes_are_like_no_other_row():
    whole = drive(7)
    hollow = whole.with_signals(a_y=np.where(np.arange(1500) % 500 < 400, np.nan, whole["a_y"]))
    assert check_repeats(hollow) == []


@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e300])
def test_a_reading_that_is_no_number_or_huge_repeats_nothing(value):
    whole = drive(8)
    odd = whole.with_signals(a_y=np.where(np.arange(1500) == 100, value, whole["a_y"]))
    assert check_repeats(odd) == []
    assert seen(odd.rows(500, 1000), odd) == pytest.approx(1.0, abs=0.02)
