"""Columns of time: whole nanoseconds since 1970 and dates keep their microseconds, small numbers stay what they are."""

from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.formats import write
from greybox_id.datasets.mapping import as_toml, propose
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording

STEPS = np.arange(50) * 10_000_001  # ns
NS = 1_731_000_000_123_456_789 + STEPS


def recording(file, unit="s"):
    signal = '[signals.v_x]\ncolumn="v"\nunit="m/s"'
    return read(file, parse_column_map(f'[time]\ncolumn="t"\nunit="{unit}"\n{signal}', "own.toml"))


@pytest.mark.parametrize("unit", ["ns", "s"])
def test_nanoseconds_in_a_csv_keep_their_microseconds(tmp_path, unit):
    times = NS if unit == "ns" else NS / 1e9
    pd.DataFrame({"t": times, "v": 1.0}).to_csv(tmp_path / "lap.csv", index=False)
    found = recording(tmp_path / "lap.csv", unit)
    np.testing.assert_allclose(found.time, STEPS * 1e-9, rtol=0, atol=1e-6 if unit == "s" else 1e-9)
    assert "2024-11-07 17:20:00 UTC" in found.notes[0]


@pytest.mark.parametrize("kind", ["csv", "parquet", "utc"])
def test_dates_are_times(tmp_path, kind):
    dates = pd.to_datetime(NS, unit="ns", utc=kind == "utc")
    frame = pd.DataFrame({"t": dates, "v": 1.0})
    file = tmp_path / ("lap.parquet" if kind == "parquet" else "lap.csv")
    frame.to_parquet(file) if kind == "parquet" else frame.to_csv(file, index=False)
    np.testing.assert_allclose(recording(file).time, STEPS * 1e-9, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("form", "begin"),
    [
        ("%H:%M:%S.%f", 0.0),
        ("%H:%M:%S,%f", 0.0),
        ("%I:%M:%S.%f %p", 43_180.0),  # over noon
        ("%H:%M:%S.%f", 86_380.0),  # over midnight
        ("%d.%m.%Y %H:%M:%S.%f", 86_380.0),
        ("%m/%d/%Y %I:%M:%S.%f %p", 86_380.0),
        ("%d/%m/%Y %H:%M:%S.%f", 86_380.0),
        ("%Y/%m/%d %H:%M:%S.%f", 0.0),
        ("%Y-%m-%d %H:%M:%S,%f", 0.0),
        ("%Y-%m-%dT%H:%M:%S.%f+02:00", 0.0),
        ("%d-%b-%Y %H:%M:%S.%f", 0.0),
        ("%j days %H:%M:%S.%f", 0.0),
    ],
)
def test_clocks_and_dates_as_loggers_write_them_are_found_and_read(tmp_path, form, begin):
    """Also where day and month may be either, and past noon and midnight."""
    steps, first = 0.04 * np.arange(1000), datetime(2024, 3, 4)
    cells = [(first + timedelta(seconds=begin + step)).strftime(form) for step in steps]
    pd.DataFrame({"Zeit": cells, "v": 1 + steps, "r": 0.1}).to_csv(tmp_path / "lap.csv", index=False, sep=";")
    time = propose(tmp_path / "lap.csv").time
    assert (time.column, time.decided) == ("Zeit", True)
    mapping = parse_column_map('[time]\ncolumn="Zeit"\nunit="s"\n[signals.v_x]\ncolumn="v"\nunit="m/s"', "own.toml")
    found = read(tmp_path / "lap.csv", mapping)
    np.testing.assert_allclose(found.time - found.time[0], steps, atol=1e-6)


@pytest.mark.parametrize(("key", "name", "size"), [("nanoseconds", "nsec", 1e9), ("microseconds", "tv_usec", 1e6)])
def test_what_whole_seconds_leave_may_be_in_any_unit(tmp_path, key, name, size):
    steps = 0.05 * np.arange(100)
    pd.DataFrame({"tv_sec": 1.7e9 + np.floor(steps), name: np.round(steps % 1 * size), "v": 1 + steps}).to_csv(
        tmp_path / "lap.csv", index=False
    )
    assert f'{key} = "{name}"' in as_toml(propose(tmp_path / "lap.csv"), "own")
    text = f'[time]\ncolumn="tv_sec"\n{key}="{name}"\nunit="s"\n[signals.v_x]\ncolumn="v"\nunit="m/s"'
    np.testing.assert_allclose(read(tmp_path / "lap.csv", parse_column_map(text, "own.toml")).time, steps, atol=1e-6)
    with pytest.raises(BadInput, match="cannot both hold"):
        parse_column_map(text.replace(key, 'milliseconds="ms"\n' + key), "own.toml")


def test_a_date_among_numbers_is_refused_with_its_column(tmp_path):
    (tmp_path / "lap.csv").write_text("t,v\n2024-01-01 10:00:00,1\nsoon,2\n")
    with pytest.raises(BadInput, match='"t" begins with a date'):
        recording(tmp_path / "lap.csv")


def test_times_from_the_start_of_a_recording_keep_their_zero(tmp_path):
    (tmp_path / "lap.csv").write_text("t,v\n1000,1\n1010,2\n1020,3\n")
    found = recording(tmp_path / "lap.csv", "ms")
    np.testing.assert_allclose(found.time, [1.0, 1.01, 1.02])
    assert not found.notes


@pytest.mark.parametrize(
    ("unit", "begins", "wraps"), [("ms", 60_000, 2**16), ("us", 2**32 - 3_000_000, 2**32), ("s", 86_395, 86_400)]
)
def test_a_clock_that_begins_anew_is_taken_on(tmp_path, unit, begins, wraps):
    time = 0.05 * np.arange(400)
    counts = (begins + np.round(time * {"s": 1, "ms": 1e3, "us": 1e6}[unit], 6)) % wraps
    pd.DataFrame({"t": counts if unit == "s" else counts.astype(np.int64), "v": 1.0}).to_csv(tmp_path / "lap.csv")
    found = recording(tmp_path / "lap.csv", unit)
    assert len(found.runs) == 1
    assert found.time - found.time[0] == pytest.approx(time, abs=1e-6)
    assert any("counter of time wraps at" in note for note in found.notes)


def test_runs_that_a_column_names_are_no_clock_that_begins_anew(tmp_path):
    time = np.array([0.5, 0.6, 0.7, 0.0, 0.1, 0.2])  # as a clock of fractions of a second would go on
    written = Recording("lap", time, {"v_x": np.arange(6.0)}, ((0, 3), (3, 6)))
    write(written, tmp_path / "lap.csv")
    found = read(tmp_path / "lap.csv")
    assert found.runs == written.runs
    np.testing.assert_allclose(found.time, time)


def test_laps_of_a_minute_in_a_row_are_no_clock_that_begins_anew(tmp_path):
    pd.DataFrame({"t": 0.05 * (np.arange(2400) % 1200), "v": 1.0}).to_csv(tmp_path / "laps.csv")
    assert len(recording(tmp_path / "laps.csv").runs) == 2


def test_hours_minutes_and_seconds_in_one_number_are_a_clocks(tmp_path):
    time = 0.1 * np.arange(2000)
    clock = 10 * 3600 + 59 * 60 + 10 + time
    stamps = 10_000 * (clock // 3600) + 100 * (clock // 60 % 60) + clock % 60
    pd.DataFrame({"utc": stamps.round(3), "vx": 1.0 + np.sin(time)}).to_csv(tmp_path / "lap.csv", index=False)
    found = read(tmp_path / "lap.csv", propose(tmp_path / "lap.csv").mapping("own", everything=True))
    assert found.time - found.time[0] == pytest.approx(time, abs=1e-6)


def test_days_of_a_spreadsheet_are_told(tmp_path):
    time = 0.02 * np.arange(500)
    pd.DataFrame({"Date": 45_000.25 + time / 86_400, "vx": 1.0}).to_csv(tmp_path / "lap.csv", index=False)
    found = read(tmp_path / "lap.csv", propose(tmp_path / "lap.csv").mapping("own", everything=True))
    assert found.time == pytest.approx(time, abs=2e-6)
    assert "2023-03-15 06:00:00 UTC" in found.notes[0]
