"""Where a gap lies: in the regime of driving that holds it, in its channel, in its stretch of time."""

import numpy as np
import pytest
from gap_cases import GivenBench, candidate

from greybox_id.gap.estimation.strip import running
from greybox_id.gap.regimes import regimes, signals, where
from greybox_id.gap.selection import ExpectedGain
from greybox_id.models.effects import EFFECTS
from greybox_id.reports.gap.words import REGIMES

ROWS = 3000
TIME = 0.02 * np.arange(ROWS)


@pytest.fixture
def driven():
    """A minute of turns, brakings and accelerations, and its bench."""
    rng = np.random.default_rng(0)
    a_y = np.where(TIME % 6 < 3, 6 * np.sin(2 * np.pi * TIME / 3), 0.0)
    a_x = np.select([TIME % 10 > 8, TIME % 10 < 2], [-5.0, 3.0], 0.0)
    v_x = 15 + 5 * np.sin(TIME / 9)
    measured = np.column_stack([v_x, a_x, a_y]) + 0.01 * rng.standard_normal((ROWS, 3))
    steer = a_y / v_x**2 * 3
    bench = GivenBench(lambda _: measured, measured, 0, channels=("v_x", "a_x", "a_y"), inputs={"steer": steer})
    return bench, signals(bench, measured)


def placed(driven, excess, ratio=(1.0, 1.0, 3.0), expected_gains=()):
    bench, seen = driven
    return where(bench, excess, np.asarray(ratio), seen, expected_gains, EFFECTS)


@pytest.mark.parametrize("regime", ["braking", "acceleration", "high_lateral", "combined", "high_speed", "time_drift"])
def test_a_gap_in_one_regime_alone_is_placed_there(driven, regime):
    excess = regimes(*driven)[regime].astype(float)
    found = placed(driven, excess)
    time, share = found.regimes[regime]
    assert share == pytest.approx(1.0)
    assert time == pytest.approx(np.mean(excess))
    assert found.regime == regime or found.regimes[found.regime][1] / found.regimes[found.regime][0] > 1 / time


def test_a_gap_in_braking_is_placed_in_braking_and_its_stretch(driven):
    excess = np.where(driven[1]["a_x"] < -2, 4.0, 0.0)
    assert placed(driven, excess).regime == "braking"


def test_a_gap_that_is_everywhere_has_no_regime(driven):
    found = placed(driven, np.ones(ROWS))
    assert found.regime == "any"
    assert found.time["share"] == pytest.approx(0.5, abs=0.01)
    assert set(found.regimes) <= set(REGIMES)
    assert all(share == pytest.approx(time) for time, share in found.regimes.values())


def test_the_shortest_stretch_that_holds_half_of_a_gap_is_told(driven):
    excess = np.full(ROWS, 1e-3)
    excess[1000:1200] = 1.0
    found = placed(driven, excess)
    assert TIME[1000] - 0.05 <= found.time["from"] < found.time["to"] <= TIME[1200] + 0.05
    assert found.time["share"] == pytest.approx(101 / ROWS, abs=0.003)


def test_where_clocks_begin_anew_the_stretch_still_ends_behind_its_beginning(driven):
    bench, seen = driven
    excess = np.full(ROWS, 1e-3)
    excess[1400:1600] = 1.0
    bench.time = np.concatenate([TIME[:1500], TIME[:1500]])
    found = placed((bench, seen), excess)
    assert TIME[1400] - 0.05 <= found.time["from"] < found.time["to"] <= TIME[1600] + 0.05


@pytest.mark.parametrize("excess", [np.zeros(ROWS), -np.ones(ROWS)])
def test_no_gap_lies_nowhere(driven, excess):
    found = placed(driven, excess)
    assert found.regime == "any"
    assert found.time == {}


def test_the_channel_that_departs_most_is_named_and_those_never_read_are_not(driven):
    found = placed(driven, np.ones(ROWS), (1.2, np.nan, 1.1))
    assert found.channel == "v_x"
    assert set(found.channels) == {"v_x", "a_y"}
    assert placed(driven, np.ones(ROWS), (np.nan,) * 3).channel == ""


def test_parts_of_the_equations_share_what_could_be_gained(driven):
    def promise(name, gain):
        return ExpectedGain(candidate(0).__class__(name, candidate(0).axes), gain, (1.0,))

    expected_gains = [promise("steering_delay", 30.0), promise("steering_lag", 60.0), promise("mass_change", 20.0),
                promise("road_slope", 20.0)]  # fmt: skip
    found = placed(driven, np.ones(ROWS), expected_gains=expected_gains).equations
    assert sum(found.values()) == pytest.approx(1.0)
    assert list(found.values()) == sorted(found.values(), reverse=True)
    assert found["steering"] == pytest.approx(max(60.0, 0.0) / sum({"s": 60.0, "m": 20.0, "r": 20.0}.values()), abs=0.2)


def test_regimes_are_told_by_the_simulation_and_by_readings_that_do_not_count():
    measured = np.full((400, 2), 2.0)
    bench = GivenBench(lambda _: measured, measured, 0, channels=("v_x", "a_y"), inputs={"steer": np.ones(400)})
    bench.counted[:, 1] = False
    found = signals(bench, np.column_stack([np.full(400, 7.0), np.full(400, 9.0)]))
    assert found["v_x"][200] == pytest.approx(7.0)
    assert found["a_y"][200] == pytest.approx(2.0)
    assert found["steer"][200] == pytest.approx(1.0)


def test_time_runs_on_between_recordings():
    one = np.array([0.5, 1.5, 2.5])
    np.testing.assert_allclose(running(one), one)
    np.testing.assert_allclose(running(np.concatenate([one, one])), [0.5, 1.5, 2.5, 3.5, 4.5, 5.5])


def test_lateral_acceleration_without_its_readings_is_speed_times_yaw_rate():
    """A model predicts it, and no recording holds it: all was "driving straight on", and turns "hardly driven"."""
    yaw_rate = np.where(TIME % 6 < 3, 0.4 * np.sin(2 * np.pi * TIME / 3), 0.0)
    measured = np.column_stack([yaw_rate, np.full(ROWS, np.nan)])
    predicted = np.column_stack([yaw_rate, np.zeros(ROWS)])
    inputs = {"steer": yaw_rate, "v_x": np.full(ROWS, 15.0)}
    bench = GivenBench(lambda _: predicted, measured, 0, channels=("yaw_rate", "a_y"), inputs=inputs)
    seen = signals(bench, predicted)
    assert np.max(np.abs(seen["a_y"])) == pytest.approx(6.0, rel=0.05)
    assert 0.2 < np.mean(regimes(bench, seen)["lateral"]) < 0.6
    assert regimes(bench, seen).keys().isdisjoint({"acceleration", "braking", "combined"})  # nothing shows these
