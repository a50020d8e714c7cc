"""Rows as loggers leave them: the newest first, codes for missing readings, a last row that the file's end cut."""

import numpy as np
import pandas as pd
import pytest

from greybox_id.datasets.checks import check
from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.mapping import as_toml, propose
from greybox_id.datasets.read import read
from greybox_id.datasets.repair import map_text
from greybox_id.datasets.shipped import shipped

TRUE = read(shipped("racer_valid"), "roboracer")
NAMES = {"v_x": "Speed [km/h]", "yaw_rate": "YawRate [deg/s]", "a_x": "AccX [g]", "a_y": "AccY [g]"}
FACTORS = {"v_x": 3.6, "yaw_rate": 180 / np.pi, "a_x": 1 / 9.80665, "a_y": 1 / 9.80665}


@pytest.fixture
def table():
    start, stop = TRUE.runs[0]
    columns = {"Time": TRUE.time[start:stop]}
    return pd.DataFrame({**columns, **{NAMES[n]: FACTORS[n] * TRUE[n][start:stop] for n in NAMES}})


def stamps(kind, time):
    if kind == "ms":
        return np.round(1000 * time).astype(int)
    if kind == "clock":
        return [f"10:{int(t // 60):02d}:{t % 60:06.3f}" for t in time]
    if kind == "date":
        return [f"2026-03-01T10:{int(t // 60):02d}:{t % 60:06.3f}" for t in time]
    return time


@pytest.mark.parametrize("kind", ["s", "ms", "clock", "date"])
def test_rows_written_newest_first_are_read_from_the_last(table, tmp_path, kind):
    table["Time"] = stamps(kind, table["Time"].to_numpy())
    for name, rows in (("usual", table), ("newest", table.iloc[::-1])):
        rows.to_csv(tmp_path / f"{name}.csv", index=False)
    proposal, usual = propose(tmp_path / "newest.csv"), propose(tmp_path / "usual.csv")
    assert proposal.time.unit == usual.time.unit
    assert {e.signal: e.unit for e in proposal.entries} == {e.signal: e.unit for e in usual.entries}
    right, turned = (read(tmp_path / f"{name}.csv", usual.mapping()) for name in ("usual", "newest"))
    np.testing.assert_allclose(np.diff(turned.time), np.diff(right.time), atol=1e-9)
    for name in right.signals:
        np.testing.assert_array_equal(turned[name], right[name])
    assert "rows are written newest first: they were read from the last to the first." in turned.notes


def test_a_number_for_no_reading_is_named_in_the_map_and_read_as_missing(table, tmp_path):
    rng = np.random.default_rng(3)
    rows = {"Speed [km/h]": rng.random(len(table)) < 0.02, "YawRate [deg/s]": np.isin(np.arange(len(table)), [20, 90])}
    for name, where in rows.items():
        table.loc[where, name] = -9999
    table.to_csv(tmp_path / "lap.csv", index=False)
    proposal = propose(tmp_path / "lap.csv")
    units = {entry.signal: (entry.unit, entry.missing) for entry in proposal.entries}
    assert units["v_x"] == ("km/h", (-9999.0,))
    assert units["yaw_rate"] == ("deg/s", (-9999.0,))
    assert units["a_y"] == ("g", ())
    text = as_toml(proposal, "lap")
    assert 'v_x = { column = "Speed [km/h]", unit = "km/h", missing = -9999 }' in text
    mapping = parse_column_map(text, "lap.toml")
    assert parse_column_map(map_text(mapping), "lap.toml").signals == mapping.signals
    recording = read(tmp_path / "lap.csv", mapping)
    for signal, name in (("v_x", "Speed [km/h]"), ("yaw_rate", "YawRate [deg/s]")):
        np.testing.assert_array_equal(np.isnan(recording[signal]), rows[name])
    assert not any(finding.kind == "placeholder" for finding in check(recording))


def test_several_numbers_may_stand_for_no_reading(tmp_path):
    (tmp_path / "lap.csv").write_text("time,v\n0,1\n0.1,-1\n0.2,65535\n0.3,2\n")
    text = '[time]\nunit = "s"\n[signals]\nv_x = { column = "v", unit = "m/s", missing = [-1, 65535] }'
    values = read(tmp_path / "lap.csv", parse_column_map(text, "own.toml"))["v_x"]
    np.testing.assert_array_equal(values, [1.0, np.nan, np.nan, 2.0])


@pytest.mark.parametrize("letters", [1, 3, 5, 9, 14])
@pytest.mark.parametrize("digits", [5, 17])
def test_a_last_row_that_the_end_of_the_file_cut_is_left_out(table, tmp_path, letters, digits):
    text = table.round(digits).to_csv(index=False).rstrip("\n")
    (tmp_path / "whole.csv").write_text(text)
    (tmp_path / "cut.csv").write_text(text[:-letters])
    (tmp_path / "ended.csv").write_text(text + "\n")
    mapping = propose(tmp_path / "whole.csv").mapping()
    whole, cut, ended = (read(tmp_path / f"{name}.csv", mapping) for name in ("whole", "cut", "ended"))
    assert len(ended) == len(table)
    assert len(table) - len(whole) <= any("ends within its last row" in note for note in whole.notes)
    for name in cut.signals:
        np.testing.assert_allclose(cut[name], ended[name][: len(cut)], rtol=1e-6, atol=1e-5)
    if digits == 5 or letters > 3:
        assert len(cut) == len(table) - 1
        assert "the file ends within its last row, which was left out." in cut.notes


def test_a_last_value_as_long_as_others_is_kept_without_a_line_end(tmp_path):
    rows = [f"{0.1 * k:.1f},{k % 7},{5 + 0.25 * (k % 4):.2f}" for k in range(60)]
    (tmp_path / "lap.csv").write_text("time,n,v\n" + "\n".join(rows))
    text = '[time]\nunit = "s"\n[signals]\nv_x = { column = "v", unit = "m/s" }'
    recording = read(tmp_path / "lap.csv", parse_column_map(text, "own.toml"))
    assert len(recording) == 60
    assert not recording.notes


def test_a_unit_that_cannot_be_is_asked_about_though_the_file_states_it(table, tmp_path):
    table.rename(columns={"YawRate [deg/s]": "YawRate [rad/s]"}).to_csv(tmp_path / "lap.csv", index=False)
    entry = next(item for item in propose(tmp_path / "lap.csv").entries if item.signal == "yaw_rate")
    assert (entry.unit, entry.decided) == ("deg/s", False)
    assert "the file says rad/s, but no vehicle reaches" in entry.reasons[-1]


@pytest.mark.parametrize("clockwise", [False, True])
def test_which_way_is_left_is_asked_where_all_sensors_contradict_the_course(tmp_path, clockwise):
    turned = -1.0 if clockwise else 1.0
    names = {"v_x": "vx", "yaw_rate": "yawrate", "a_y": "ay", "steer": "steering", "x": "x", "y": "y"}
    signs = {"yaw_rate": turned, "a_y": turned, "steer": turned}
    start, stop = TRUE.runs[0]
    columns = {names[n]: signs.get(n, 1.0) * TRUE[n][start:stop] for n in names}
    pd.DataFrame({"time": TRUE.time[start:stop], **columns}).to_csv(tmp_path / "lap.csv", index=False)
    proposal = propose(tmp_path / "lap.csv")
    entry = next(item for item in proposal.entries if item.signal == "y")
    assert entry.decided is not clockwise
    assert bool(proposal.left_assumed) is clockwise


def test_a_unit_in_a_name_that_is_none_of_the_signal_is_said(tmp_path):
    start, stop = TRUE.runs[0]
    table = pd.DataFrame({n: TRUE[n][start:stop] for n in ("v_x", "yaw_rate", "a_x", "a_y")})
    table.insert(0, "time", TRUE.time[start:stop])
    table["Steering [%]"] = 100 * TRUE["steer"][start:stop] / 0.4
    table.to_csv(tmp_path / "lap.csv", index=False)
    entry = next(item for item in propose(tmp_path / "lap.csv").entries if item.signal == "steer")
    assert not entry.decided
    assert "the file says %, which is no unit of steer" in entry.reasons[-1]
