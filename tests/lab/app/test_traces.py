"""Curves for the screen hold what a reader must see, in no more points than a browser draws at once."""

import numpy as np

import greybox_id as gb
from greybox_lab.app.beneath import companion
from greybox_lab.app.traces import DETAIL, OVERVIEW, Shown


def long_drive(rows=360_000):
    time = 0.01 * np.arange(rows)
    values = np.sin(time)
    values[rows // 3] = 50.0
    return gb.Recording("long", time=time, signals={"v_x": values, "a_x": np.cos(time)})


def test_no_more_than_four_thousand_points_and_the_peak_among_them():
    over = Shown(long_drive())
    assert OVERVIEW + DETAIL <= 4000
    values = np.asarray(over.recording["v_x"])
    coarse = over.points(values)
    assert len(coarse) <= 4000
    assert max(coarse[:, 1]) == 50.0
    for window in ((1000.0, 1001.0), (0.0, 3600.0), (-5.0, 0.5)):
        points = over.closer(values, window, coarse)
        assert len(points) <= 4000
        assert np.all(np.diff(points[:, 0]) >= 0)
    close = over.closer(values, (1234.0, 1235.0), coarse)[:, 0]
    assert np.sum((close >= 1234.0) & (close <= 1235.0)) >= 100  # every row of the second that is looked at


def test_curves_break_where_readings_are_missing_and_between_runs():
    time = np.concatenate((np.arange(50.0), np.arange(50.0)))
    values = np.ones(100)
    values[10:15] = np.nan
    over = Shown(gb.Recording("two", time=time, signals={"v_x": values}))
    assert over.laid
    assert np.all(np.diff(over.time) > 0)
    points = over.points(values)
    assert np.sum(np.isnan(points[:, 1])) == 2
    assert np.all(np.isfinite(points[:, 0]))


def test_companions_are_what_the_signal_should_look_like():
    drive = long_drive(20_000)
    words, values = companion(drive, "a_x", drive["a_x"])
    assert words == "dv_x/dt"
    assert np.nanmax(np.abs(values[100:6000] - drive["a_x"][100:6000])) < 1e-2
    assert companion(drive, "steer", drive["a_x"]) is None
