"""MDF: channel groups on their own clocks, with units, conversions and invalid samples."""

import asammdf
import numpy as np
import pytest

from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.read import read

FAST, SLOW = np.arange(500) * 0.01, np.arange(51) * 0.1


@pytest.fixture
def measured(tmp_path):
    invalid = np.zeros(500, dtype=bool)
    invalid[10:20] = True
    with asammdf.MDF(version="4.10") as made:
        made.append(
            [
                asammdf.Signal(np.arange(500, dtype="u2"), FAST, "deg/s", "YawRate", conversion={"a": 0.01, "b": -2.0}),
                asammdf.Signal(np.sin(FAST), FAST, "m/s^2", "LatAcc", invalidation_bits=invalid),
            ],
            acq_name="ESP",
        )
        made.append([asammdf.Signal(36 + SLOW, SLOW, "km/h", "Speed")], acq_name="Wheels")
        made.append([asammdf.Signal(36 + SLOW, SLOW, "km/h", "LatAcc")], acq_name="Other")
        made.save(tmp_path / "drive.mf4")
    return tmp_path / "drive.mf4"


def test_groups_meet_on_one_clock_and_names_that_stand_twice_take_their_group(measured):
    mapping = parse_column_map(
        '[time]\nunit="s"\n[signals.v_x]\ncolumn="Speed"\nunit="km/h"\n[signals.yaw_rate]\ncolumn="YawRate"\n'
        'unit="deg/s"\n[signals.a_y]\ncolumn="ESP/LatAcc"\nunit="m/s^2"',
        "own.toml",
    )
    recording = read(measured, mapping)
    np.testing.assert_allclose(np.degrees(recording["yaw_rate"]), 0.01 * np.arange(500) - 2, atol=1e-9)
    np.testing.assert_allclose(recording["v_x"], (36 + FAST) / 3.6, rtol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(recording["a_y"])), np.arange(10, 20))
    assert set(recording.resampled) == {"v_x"}
    assert recording.resampled["v_x"].rate == pytest.approx(10)
