"""The column map dart on the recordings themselves: each in one call, and the authors' velocities found again."""

import numpy as np
import pandas as pd
import pytest

from greybox_id.datasets.read import read

NEW = ("mpcc_apr04_1523", "mpcc_apr08_1801", "mpcc_apr16_1621_slippery", "slippery_apr16_1556")


def beside_the_authors(file):
    """Share of the authors' v_x and yaw rate by which ours differ, RMS, over 98 % of the rows.

    The authors divide by stamps that scatter by 0.6 ms: theirs are put on even steps first. Theirs are means over two
    steps, and ours are averaged alike. Poses that jump are in theirs, hence the 2 % left out.
    """
    recording, stamps = read(file, "dart"), pd.read_csv(file)["vicon time"].to_numpy()
    step = (stamps[2:] - stamps[:-2]) / (2 * recording.sample_time)
    psi, found = recording["yaw"], {}
    c, s = np.cos(psi), np.sin(psi)

    def mean(values):
        return np.convolve(values, [1 / 6, 4 / 6, 1 / 6], "same")

    along = mean(recording["v_x"] * c - recording["v_y"] * s), mean(recording["v_x"] * s + recording["v_y"] * c)
    ours = {"v_x": along[0] * c + along[1] * s, "yaw_rate": mean(recording["yaw_rate"])}
    for name, own in ours.items():
        theirs = recording[f"authors_{name}"][1:-1] * step
        e = np.sort(np.abs(own[1:-1] - theirs))
        e = e[np.isfinite(e)][: int(0.98 * len(e))]
        found[name] = float(np.sqrt(np.mean(e**2) / np.mean(theirs**2)))
    return found


def test_a_file_of_2025_has_the_velocities_of_its_authors(real_data):
    found = beside_the_authors(real_data / "dart" / "mpcc_apr08_1801.csv.gz")
    assert found["v_x"] < 0.03
    assert found["yaw_rate"] < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in NEW if name != "mpcc_apr08_1801"])
def test_every_file_of_2025_has_the_velocities_of_its_authors(real_data, name):
    found = beside_the_authors(real_data / "dart" / f"{name}.csv.gz")
    assert found["v_x"] < 0.03
    # yaw differs by 1 mrad from one pose to the next: over 20 ms that alone is 3 % of the authors' yaw rate
    assert found["yaw_rate"] < (0.04 if name == "mpcc_apr04_1523" else 0.03)


@pytest.mark.slow
def test_each_file_is_read_in_one_call(real_data):
    files = sorted((real_data / "dart").glob("*.csv.gz"))
    assert len(files) >= 16
    for file in files:
        recording = read(file, "dart")
        assert np.mean(np.isfinite(recording["v_y"])) > 0.99, file
        a_y, v_y, moving = recording["a_y"], recording["v_y"], recording["v_x"] > 1.0
        whole = np.gradient(v_y, recording.time) + recording["v_x"] * recording["yaw_rate"]  # a drift is all v_y
        there = np.isfinite(a_y) & np.isfinite(whole)
        assert np.corrcoef(a_y[moving & there], whole[moving & there])[0, 1] > 0.95, file
        # what is not known are accelerations beside poses that were left out, and the smoother's sd says so
        assert np.sum(moving & there) > 0.99 * np.sum(moving), file
        if np.any(unknown := ~np.isfinite(a_y)):
            assert np.min(recording["sd_a_y"][unknown]) > 10 * np.median(recording["sd_a_y"]), file
        assert {"steer", "throttle", "sd_v_x"} <= recording.signals.keys()


def test_rows_before_the_first_command_are_left_out(real_data):
    recording = read(real_data / "dart" / "tape_drift_1813.csv.gz", "dart")
    assert any('rows before "elapsed time sensors" first differs from zero' in note for note in recording.notes)
    assert recording["imu_a_x"][0] != 0.0
