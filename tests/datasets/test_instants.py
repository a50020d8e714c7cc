"""Columns of time: whole nanoseconds since 1970 and dates keep their microseconds, small numbers stay what they are."""

import numpy as np
import pandas as pd
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.read import read

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


def test_a_date_among_numbers_is_refused_with_its_column(tmp_path):
    (tmp_path / "lap.csv").write_text("t,v\n2024-01-01 10:00:00,1\nsoon,2\n")
    with pytest.raises(BadInput, match='"t" begins with a date'):
        recording(tmp_path / "lap.csv")


def test_times_from_the_start_of_a_recording_keep_their_zero(tmp_path):
    (tmp_path / "lap.csv").write_text("t,v\n1000,1\n1010,2\n1020,3\n")
    found = recording(tmp_path / "lap.csv", "ms")
    np.testing.assert_allclose(found.time, [1.0, 1.01, 1.02])
    assert not found.notes
