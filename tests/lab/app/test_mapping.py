"""Answers change the column map, and the map that is written is the one that every command reads."""

import numpy as np
import pytest

import greybox_id as gb
from greybox_id.datasets.column_map import column_map
from greybox_id.datasets.repair import map_text
from greybox_lab.app.mapping import answered, entries_of_map, questions, units_for, write_map

TIME = {"time": {"column": "t", "unit": "s"}}


def entry(signal, column, unit="", *, use=True, sign=1, divide_by=1.0, units=()):
    return {
        "signal": signal, "column": column, "unit": unit, "units": list(units), "sign": sign, "divide_by": divide_by,
        "decided": use is True, "reasons": [], "use": use,
    }  # fmt: skip


ENTRIES = [
    entry("v_x", "v", "m/s"), entry("steer", "delta", "rad"), entry("yaw_rate", "r", "rad/s"),
    entry("a_y", "ay", "m/s^2"), entry("a_x", "ax", "m/s^2"),
]  # fmt: skip


def test_the_map_that_is_written_is_read(tmp_path):
    file = tmp_path / "drive.csv"
    file.write_text("t,v,delta,r,ay,ax\n0,8,.1,.3,2.4,0\n1,8,.2,.6,4.8,1\n")
    entries = [*ENTRIES[:2], entry("yaw_rate", "r", "deg/s", sign=-1), entry("a_y", "ay", "m/s^2", divide_by=2.0)]
    write_map(tmp_path / "map.toml", TIME, entries)
    plain, mapped = (
        gb.read(file, columns=_map(tmp_path, "plain.toml", ENTRIES)),
        gb.read(file, columns=tmp_path / "map.toml"),
    )
    np.testing.assert_allclose(mapped["yaw_rate"], -np.deg2rad(plain["yaw_rate"]))
    np.testing.assert_allclose(mapped["a_y"], plain["a_y"] / 2)


def test_names_with_quotes_stay_names(tmp_path):
    strange = 'a "b" \\ <c> ü'
    write_map(tmp_path / "map.toml", TIME, [entry("v_x", strange, "m/s")])
    file = tmp_path / "a.csv"
    file.write_text('t,"a ""b"" \\ <c> ü"\n0,1\n1,2\n2,3\n', "utf-8")
    assert gb.read(file, columns=tmp_path / "map.toml")["v_x"].tolist() == [1, 2, 3]


def test_a_column_that_is_taken_takes_the_signal_from_others():
    entries = [entry("yaw_rate", "gyro_z", "rad/s"), entry("yaw_rate", "gyro_x", use=None), entry("v_x", "v", use=None)]
    assert [each["column"] for each in questions(entries)] == ["v"]
    changed = answered(entries, entries[1], use=True, unit="deg/s", units=[])
    assert [each["use"] for each in changed] == [None, True, None]
    assert [each["column"] for each in questions(answered(changed, entries[2], use=False))] == []


def test_units_that_are_offered():
    assert units_for(entry("v_x", "v", "km/h")) == ["km/h"]
    assert units_for(entry("steer", "d", units=("deg", "rad"))) == ["deg", "rad"]
    assert units_for(entry("a_y", "ay"))[:2] == ["m/s^2", "g"]


def _map(folder, name, entries):
    write_map(folder / name, TIME, entries)
    return folder / name


@pytest.mark.parametrize("name", ["roboracer", "dart", "truck", "revs_250lm"])
def test_a_shipped_map_keeps_all_it_says_when_it_is_mended(tmp_path, name):
    was = column_map(name)
    (tmp_path / "mended.toml").write_text(map_text(was), "utf-8")
    write_map(tmp_path / "map.toml", *entries_of_map((tmp_path / "mended.toml").read_text("utf-8")))
    now = column_map(tmp_path / "map.toml")
    assert (now.signals, now.extra, now.time, now.poses) == (was.signals, was.extra, was.time, was.poses)
    assert (now.hold, now.run_column, now.start_column) == (was.hold, was.run_column, was.start_column)
