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
    for window in (None, (1000.0, 1001.0), (0.0, 3600.0)):
        points = over.points(np.asarray(over.recording["v_x"]), window)
        assert len(points) <= 4000
        if window is None:
            assert max(point[1] for point in points) == 50.0
    close = [
        point for point in over.points(np.asarray(over.recording["v_x"]), (1234.0, 1235.0)) if 1234 <= point[0] <= 1235
    ]
    assert len(close) >= 100  # every row of the second that is looked at


def test_curves_break_where_readings_are_missing_and_between_runs():
    time = np.concatenate((np.arange(50.0), np.arange(50.0)))
    values = np.ones(100)
    values[10:15] = np.nan
    over = Shown(gb.Recording("two", time=time, signals={"v_x": values}))
    assert over.laid
    assert np.all(np.diff(over.time) > 0)
    assert over.points(values).count(None) == 2


def test_companions_are_what_the_signal_should_look_like():
    drive = long_drive(20_000)
    words, values = companion(drive, "a_x", drive["a_x"])
    assert words == "dv_x/dt"
    assert np.nanmax(np.abs(values[100:6000] - drive["a_x"][100:6000])) < 1e-2
    assert companion(drive, "steer", drive["a_x"]) is None
