"""Uneven stamps: rows that were sampled evenly are put so, rows whose stamps are true are laid on a grid."""

import numpy as np
import pytest

from greybox_id.datasets.instants import evened

STEP, ROWS = 0.005, 2000


def motion(time, noise=0.02, seed=0):
    scatter = noise * np.random.default_rng(seed).standard_normal(len(time))
    return {"yaw_rate": 0.4 * np.sin(3 * time) + 0.2 * np.sin(7.3 * time + 1) + scatter}


@pytest.mark.parametrize("stamps", ["by_turns", "packets", "at_once"])
@pytest.mark.parametrize("gap", [0.0, 3.0])
def test_stamps_of_receipt_are_regressed_on_the_row(stamps, gap):
    rows = np.arange(ROWS)
    true = STEP * rows + np.where(rows >= ROWS // 2, gap, 0.0)
    last = (rows // 8 * 8 + 7) * STEP + true - STEP * rows
    stamped = {
        "by_turns": true + np.where(rows % 2, 0.003, 0.0),
        "packets": last + 1e-4 * (rows % 8),
        "at_once": last,
    }[stamps]
    found = evened(stamped, motion(true), "zero")
    assert len(found.rows) == ROWS
    assert np.ptp(found.time - true) < 0.1 * STEP
    assert "regressed on the row" in found.note


@pytest.mark.parametrize(("rate", "digit"), [(120.0, 1e-3), (30.0, 1e-2), (64.0, 1.0)])
def test_rounded_stamps_are_regressed_on_the_row(rate, digit):
    """In thousandths, in hundredths, and in whole seconds that many rows share."""
    true = np.arange(ROWS) / rate
    found = evened(np.floor(true / digit) * digit, motion(true), "zero")
    assert np.ptp(found.time - true) < 0.1 / rate
    assert "regressed on the row" in found.note


def test_stamps_that_are_a_little_uneven_are_put_so_if_values_follow_the_rows():
    true = STEP * np.arange(ROWS)
    stamped = true + np.where(np.arange(ROWS) % 2, 0.001, 0.0)  # steps of 6 and 4 ms
    assert np.ptp(evened(stamped, motion(true, 1e-3), "zero").time - true) < 0.1 * STEP
    assert evened(stamped, motion(stamped, 1e-3), "zero") is None


def test_true_stamps_are_laid_on_an_even_grid():
    both = np.unique(np.round(np.concatenate([np.arange(0, 26, 0.04), np.arange(0, 26, 0.05)]), 6))  # 25 and 20 Hz
    found = evened(both, motion(both, 1e-3), "zero")
    assert np.allclose(np.diff(found.time), np.mean(np.diff(both)), rtol=1e-2)
    assert found.resampled["yaw_rate"].method == "linear"
    exact = motion(found.time, 0.0)["yaw_rate"]
    assert np.sqrt(np.mean((found.signals["yaw_rate"] - exact) ** 2)) < 5e-3
    assert evened(both, motion(both, 1e-3), "zero", keep_rows=True) is None


@pytest.mark.parametrize("lost", [0.03, 0.2])
@pytest.mark.parametrize("jitter", [0.0, 0.01])
def test_lost_rows_keep_the_clock_and_are_laid_between_their_neighbours(lost, jitter):
    rng = np.random.default_rng(1)
    rows = np.flatnonzero(rng.random(ROWS) >= lost)
    time = STEP * (rows + jitter * rng.standard_normal(len(rows)))
    commanded = {"steer": 0.1 * np.sin(3 * time)}
    found = evened(time, motion(time, 0.001) | commanded, "zero")
    steps = np.diff(found.time)
    runs_on = np.abs(steps - STEP) < 0.1 * STEP
    assert np.mean(runs_on) > 0.98
    assert np.all(steps[~runs_on] > 3.5 * STEP)
    assert len(found.time) > 0.96 * ROWS
    for name, exact in (motion(found.time, 0.0) | {"steer": 0.1 * np.sin(3 * found.time)}).items():
        assert np.max(np.abs(found.signals[name] - exact)) < 5e-3
    assert "are missing" in found.note


def test_an_even_clock_with_gaps_and_restarts_is_left_alone():
    time = np.concatenate([STEP * np.arange(300), 5 + STEP * np.arange(300), STEP * np.arange(400)])
    assert evened(time, motion(time), "zero") is None
