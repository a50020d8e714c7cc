"""Answers and repairs change the column map, and the map that is written is the one that every command reads."""

import numpy as np
import pytest

import greybox_id as gb
from greybox_lab.app.mapping import (
    answered,
    as_toml,
    entries_of_map,
    questions,
    repaired,
    repairs_of,
    table_of,
    units_for,
    write_map,
)

TIME = {"time": {"column": "t", "unit": "s"}}


def entry(signal, column, unit="", *, use=True, sign=1, divide_by=1.0, units=()):
    return {
        "signal": signal, "column": column, "unit": unit, "units": list(units), "sign": sign, "divide_by": divide_by,
        "decided": use is True, "reasons": [], "use": use,
    }  # fmt: skip


def driven(tmp_path, **changes):
    """A drive of a car that turns as its steering says, written with faults."""
    t = np.arange(0, 60, 0.05)
    v = 8 + 2 * np.sin(t / 5)
    steer = 0.06 * np.sin(t) + 0.04 * np.sin(2.3 * t)
    rate = v * steer / 2.7
    made = {"v": v, "delta": steer, "r": rate, "ay": v * rate, "ax": np.gradient(v, t)}
    noise = np.random.default_rng(5)
    columns = {"t": t, **{name: values + 0.002 * noise.standard_normal(len(t)) for name, values in made.items()}}
    columns |= {name: change(columns) for name, change in changes.items()}
    file = tmp_path / "drive.csv"
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, delimiter=",", header=",".join(columns), comments="")
    return file


ENTRIES = [
    entry("v_x", "v", "m/s"), entry("steer", "delta", "rad"), entry("yaw_rate", "r", "rad/s"),
    entry("a_y", "ay", "m/s^2"), entry("a_x", "ax", "m/s^2"),
]  # fmt: skip


def test_the_map_that_is_written_is_read(tmp_path):
    file = driven(tmp_path)
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
    written = as_toml(table_of(TIME, [entry("v_x", strange, "m/s")], {}))
    (tmp_path / "map.toml").write_text(written, "utf-8")
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


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        ({"r": lambda c: -c["r"]}, "sign"),
        ({"r": lambda c: np.rad2deg(c["r"])}, "unit"),
        ({"v": lambda c: 3.6 * c["v"]}, "unit"),
        ({"ax": lambda c: c["ay"], "ay": lambda c: c["ax"]}, "exchange"),
    ],
)
def test_what_a_check_asks_for_makes_the_recording_right(tmp_path, fault, kind):
    file = driven(tmp_path)
    right = gb.read(file, columns=_map(tmp_path, "right.toml", ENTRIES))
    table = np.genfromtxt(file, delimiter=",", names=True)
    before = {name: table[name] for name in table.dtype.names}
    file = driven(tmp_path, **{name: lambda _, change=change: change(before) for name, change in fault.items()})
    findings = gb.check(gb.read(file, columns=_map(tmp_path, "wrong.toml", ENTRIES)))
    offered = [repair for each in findings for repair in repairs_of(each.sentence, each.where.channel)]
    assert [repair.kind for repair in offered] == [kind]
    _, entries = repaired(TIME, ENTRIES, offered[0])
    mended = gb.read(file, columns=_map(tmp_path, "mended.toml", entries))
    for name in right.signals:
        np.testing.assert_allclose(mended[name], right[name], atol=1e-6 + 1e-6 * np.abs(right[name]).max())


def _map(folder, name, entries):
    write_map(folder / name, TIME, entries)
    return folder / name


@pytest.mark.parametrize("name", ["roboracer", "dart", "truck", "revs_250lm"])
def test_a_shipped_map_keeps_all_it_says_when_it_is_mended(tmp_path, name):
    from greybox_id.datasets.column_map import column_map
    from greybox_lab.app.work import _shipped

    base, entries = entries_of_map(_shipped(name))
    write_map(tmp_path / "map.toml", base, entries)
    was, now = column_map(name), column_map(tmp_path / "map.toml")
    assert (now.signals, now.extra, now.time, now.poses) == (was.signals, was.extra, was.time, was.poses)
    assert (now.hold, now.run_column, now.start_column) == (was.hold, was.run_column, was.start_column)
