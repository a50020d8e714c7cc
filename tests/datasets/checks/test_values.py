"""Faults of single channels."""

import numpy as np
import pytest
from simulated import clean

from greybox_id.datasets.checks import Severity, check, distrusted
from greybox_id.datasets.checks.values import check_values
from greybox_id.datasets.read import read


def found(recording, kind):
    return [finding for finding in check_values(recording) if finding.kind == kind]


def changed(name, change, seed=1, **settings):
    recording = clean(seed, **settings)
    values = recording[name].copy()
    change(values)
    return recording.with_signals(**{name: values})


def test_holes_in_a_needed_channel_are_distrusted_and_counted():
    def holes(values):
        values[[5, 6, 900]] = np.nan

    (finding,) = found(changed("yaw_rate", holes), "missing")
    assert finding.severity is Severity.DISTRUST
    assert finding.where.rows == (5, 6, 900)
    (finding,) = found(changed("x", holes), "missing")
    assert finding.severity is Severity.WARNING


def test_a_dead_gyro_is_distrusted_but_a_car_driven_straight_is_not():
    recording = clean(1)
    still = np.zeros(len(recording))
    (finding,) = found(recording.with_signals(yaw_rate=still), "dead")
    assert finding.severity is Severity.DISTRUST
    assert "steer" not in finding.where.channel
    straight = recording.with_signals(**dict.fromkeys(("yaw_rate", "steer", "v_y", "a_y", "yaw"), still))
    assert not distrusted(check_values(straight))


def test_clipping_is_found_in_a_sensor_and_noted_in_a_command():
    def clip(values):
        np.clip(values, None, np.quantile(values, 0.97), out=values)

    (finding,) = found(changed("a_y", clip), "clipped")
    assert finding.severity is Severity.WARNING
    (finding,) = found(changed("steer", clip), "clipped")
    assert finding.severity is Severity.NOTE


def test_held_samples_are_told_with_the_true_rate():
    def hold(values):
        values[1::2] = values[::2]

    (finding,) = found(changed("yaw_rate", hold), "held")
    assert finding.value == pytest.approx(0.5, abs=0.01)
    assert "25 new values a second" in finding.sentence


@pytest.mark.parametrize("row", [0, 700, 1500, 2999])
def test_a_raw_count_among_si_values_is_an_outlier_wherever_it_stands(row):
    def spike(values):
        values[row] = 5596.0

    (finding,) = found(changed("v_x", spike), "outlier")
    assert finding.where.rows == (row,)
    assert finding.where.run == 1


def test_a_step_is_no_outlier():
    def step(values):
        values[1500:] += 5.0

    assert not found(changed("v_x", step), "outlier")


def test_raw_rpm_at_recording_starts_of_the_roboracer_are_found(real_data):
    rows = {}
    for file in ("train", "valid"):
        recording = read(real_data / "roboracer" / f"{file}.csv", "roboracer")
        (finding,) = [f for f in found(recording, "outlier") if f.where.channel == "velocity_vehicle_x"]
        rows[file] = finding.where.rows
    assert rows == {"train": (698, 2082), "valid": (492, 1016)}


def test_steering_spikes_of_the_250lm_are_found(real_data):
    ferrari = read(real_data / "revs_250lm" / "run1_first400s.csv.gz", "revs_250lm")
    (finding,) = found(ferrari, "outlier")
    assert finding.where.channel == "steer"
    np.testing.assert_allclose(ferrari.time[list(finding.where.rows)], [207.27, 503.49, 524.85], atol=0.006)


def test_held_and_dead_zone_channels_of_the_truck_are_found(real_data):
    truck = read(real_data / "truck" / "train.parquet", "truck")
    held = {finding.where.channel: finding for finding in found(truck, "held")}
    assert held["v_x"].value == pytest.approx(0.44, abs=0.01)
    assert held["v_y"].value == pytest.approx(0.44, abs=0.01)
    (zone,) = found(truck, "dead_zone")
    assert zone.where.channel == "steer"
    assert zone.value == pytest.approx(0.6, abs=0.05)
    assert "alpha2" in zone.sentence


@pytest.mark.parametrize("level", [-9999.0, 32.767])
def test_a_number_that_stands_for_no_reading_is_named_and_nothing_else_is_blamed(level):
    def lost(values):
        values[20:1020:40] = level

    (finding,) = (one for one in check(changed("yaw_rate", lost)) if one.severity is not Severity.NOTE)
    assert finding.severity is Severity.DISTRUST
    assert finding.where.rows == tuple(range(20, 1020, 40))
    assert "in 25 rows, far from all others: probably a code for a missing reading" in finding.sentence


def test_a_buss_error_values_are_outliers_and_no_other_fault():
    """65535 counts of 0.01 m/s, three times."""

    def errors(values):
        values[[100, 900, 1100]] = 655.35

    findings = check(changed("v_x", errors))
    assert [finding.kind for finding in findings if finding.severity is not Severity.NOTE] == ["outlier"]
