"""Readings that are exactly zero for a row, where a message was lost."""

import numpy as np
import pytest

from greybox_id.datasets.checks import Severity, check
from greybox_id.datasets.checks.dropouts import check_dropouts
from greybox_id.datasets.recording import Recording

T = np.arange(1500) * 0.02
RNG = np.random.default_rng(8)
TURN = np.sin(0.7 * T) + 0.5 * np.sin(1.9 * T)
DRIVE = Recording(
    "drive",
    T,
    {
        "v_x": 12.0 + np.sin(0.2 * T) + 0.05 * RNG.standard_normal(1500),
        "yaw_rate": 0.3 * TURN + 0.004 * RNG.standard_normal(1500),
        "a_y": 3.6 * TURN + 0.05 * RNG.standard_normal(1500),
        "steer": 0.06 * TURN,
    },
)


@pytest.mark.parametrize("name", ["v_x", "yaw_rate", "a_y"])
def test_readings_that_fall_to_zero_again_and_again_are_told_as_missing(name):
    rows = np.sort(np.random.default_rng(3).choice(1500, 60, replace=False))
    values = DRIVE[name].copy()
    values[rows] = 0.0
    (found,) = (item for item in check(DRIVE.with_signals(**{name: values})) if item.kind == "placeholder")
    assert found.severity is Severity.DISTRUST
    assert set(found.where.rows) <= set(rows.tolist())
    assert len(found.where.rows) > 30
    assert found.sentence.startswith(f"{name} falls to exactly 0 for a row or two")


def test_a_dead_zone_coarse_levels_and_what_is_sound_fall_to_nothing():
    assert check_dropouts(DRIVE) == []
    dead = np.where(np.abs(DRIVE["yaw_rate"]) < 0.05, 0.0, DRIVE["yaw_rate"])
    assert check_dropouts(DRIVE.with_signals(yaw_rate=dead)) == []
    for level in (0.05, 0.2, 1.0):
        coarse = np.round(DRIVE["a_y"] / level) * level
        assert check_dropouts(DRIVE.with_signals(a_y=coarse)) == []


def test_a_join_is_no_gap():
    values = DRIVE["yaw_rate"].copy()
    starts = np.arange(100, 1500, 100)
    values[starts] = 0.0
    pieces = tuple(zip([0, *starts.tolist()], [*starts.tolist(), 1500], strict=True))
    parts = Recording("joined", T, {"yaw_rate": values}, runs=pieces)
    assert check_dropouts(parts) == []
