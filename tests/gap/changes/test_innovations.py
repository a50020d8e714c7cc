"""Recordings as innovations: what is kept of them, how they are distributed, what a filter does not foresee."""

import numpy as np
import pytest
from gap_cases import CAR, lap, nominal

from greybox_id.base.errors import BadInput
from greybox_id.engine.motion.schedule import AT_ONCE
from greybox_id.gap.changes.innovations import FilterInnovations, FollowedRun, Follower, noise_of, plain_noise
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.models.effects import EFFECTS
from greybox_id.models.effects.memory import LATEST

READ = ("v_x", "yaw_rate")
ROWS = 10


def drawn(seed, blocks=400, scale=1.0, memory=0.0):
    """Innovations of two channels, each a first-order series."""
    rng = np.random.default_rng(seed)
    series = rng.standard_normal((blocks * ROWS, 2))
    for k in range(1, len(series)):
        series[k] = memory * series[k - 1] + np.sqrt(1 - memory**2) * series[k]
    white = scale * series.reshape(blocks, ROWS * 2)
    there = np.ones_like(white, dtype=bool)
    return FilterInnovations(white, there, np.zeros_like(white), np.zeros(blocks, dtype=np.intp))


def test_readings_are_kept_a_while_apart_and_in_motion_alone():
    own = lap(seconds=6.0)
    ride = FollowedRun.of(own, READ)
    taken = np.isfinite(ride.recording["yaw_rate"])
    steps = np.diff(ride.recording.time[taken])
    assert np.min(steps) == pytest.approx(CAL.apart, abs=0.5 * own.sample_time)
    assert len(ride.recording) <= len(own)
    assert np.all(np.isfinite(ride.recording["steer"]))


def test_a_vehicle_that_never_moves_is_said():
    own = lap(seconds=4.0)
    with pytest.raises(BadInput, match="has no row where v_x"):
        FollowedRun.of(own.with_signals(v_x=0.0 * own["v_x"]), READ)


def test_a_louder_recording_costs_the_logarithm_of_that():
    noise, quiet = plain_noise(2 * ROWS, 2), drawn(1)
    loud = FilterInnovations(3.0 * quiet.white, quiet.there, quiet.spread, quiet.runs)
    assert noise.scales(loud) == pytest.approx(3.0 * noise.scales(quiet), rel=1e-3)
    assert noise.cost(loud) - noise.cost(quiet) == pytest.approx(quiet.white.size * np.log(3.0), rel=1e-3)


def test_a_channel_that_is_louder_leaves_the_others_their_word():
    noise, quiet = plain_noise(2 * ROWS, 2), drawn(6)
    loud = quiet.white.copy()
    loud[:, 0::2] *= 5.0
    own = FilterInnovations(loud, quiet.there, quiet.spread, quiet.runs)
    assert noise.scales(own) == pytest.approx(noise.scales(quiet) * [5.0, 1.0], rel=1e-3)


def test_scales_are_where_a_recording_costs_least():
    correlated = noise_of([drawn(2, 1500, memory=0.6)], 2)
    heavy = drawn(7, 60)
    heavy.white[::5] *= 6.0  # moments in which something happened
    found = correlated.scales(heavy)

    def cost(scales):
        louder = np.sum(heavy.there.reshape(-1, 2), axis=0) @ np.log(scales)
        energy = np.sum(correlated.white(heavy, scales) ** 2, axis=1)
        count = np.sum(heavy.there, axis=1)
        return 0.5 * np.sum((correlated.degrees + count) * np.log1p(energy / correlated.degrees)) + louder

    for beside in ([1.01, 1.0], [0.99, 1.0], [1.0, 1.01], [1.0, 0.99], [1.01, 0.99]):
        assert cost(found * beside) > cost(found)
    quiet = FilterInnovations(0.1 * heavy.white, heavy.there, heavy.spread, heavy.runs)
    assert correlated.scales(quiet) == pytest.approx(CAL.least_scale)


def test_the_covariance_of_blocks_is_that_of_their_series():
    found = noise_of([drawn(2, 1500, memory=0.6)], 2)
    covariance = found.root @ found.root.T
    diagonal = np.mean(np.diag(covariance))
    assert covariance[0, 1] / diagonal == pytest.approx(0.0, abs=0.05)
    assert covariance[0, 2] / diagonal == pytest.approx(0.6, abs=0.08)
    assert covariance[0, 4] / diagonal == pytest.approx(0.36, abs=0.08)
    white = found.white(drawn(3, 1500, memory=0.6), np.ones(2))
    assert np.corrcoef(white[:, 0], white[:, 2])[0, 1] == pytest.approx(0.0, abs=0.08)


def test_a_block_that_is_missing_readings_is_the_beginning_of_a_whole_one():
    noise, own = noise_of([drawn(4, memory=0.5)], 2), drawn(5, 1)
    there = own.there.copy()
    there[:, 8:] = False
    part = FilterInnovations(np.where(there, own.white, 0.0), there, own.spread, own.runs)
    ones = np.ones(2)
    assert noise.white(part, ones)[0, :8] == pytest.approx(noise.white(own, ones)[0, :8])
    assert not np.any(noise.white(part, ones)[0, 8:])


@pytest.mark.slow
def test_a_filter_with_the_true_numbers_foresees_best():
    ride = FollowedRun.of(lap({"grip_scale": 0.7}, seconds=20.0, seed=3), READ)
    model = nominal(vehicle=CAR)
    follower = Follower(model, READ)
    follower.tune([ride], {name: float(model[name].array) * 0.7 for name in ("D_f", "D_r")})
    noise = plain_noise(follower.size, 2)

    def cost(grip):
        lost = {name: float(model[name].array) * grip for name in ("D_f", "D_r")}
        return noise.cost(*follower.innovations(ride, [lost]))

    assert min((0.5, 0.6, 0.7, 0.8, 1.0), key=cost) == 0.7


@pytest.mark.slow
def test_readings_that_are_late_are_foreseen_for_when_they_were_taken():
    model = nominal(vehicle=CAR) + EFFECTS["sensor_latency_yaw"].at(0.0)
    ride = FollowedRun.of(lap({"sensor_latency_yaw": 0.05}, seconds=20.0, seed=3), READ)
    follower = Follower(model, READ)
    follower.tune([ride], {"sensor_latency_yaw": 0.05})
    late = (0.0, 0.02, 0.047, 0.1)
    found = dict(zip(late, follower.innovations(ride, [{"sensor_latency_yaw": own} for own in late]), strict=True))
    assert all(np.max(np.abs(own.white)) < CAL.astray for own in found.values())
    kept = np.count_nonzero(np.isfinite(ride.recording["yaw_rate"]))
    left_out = LATEST[1] / CAL.apart + 1  # at the beginning, where the latest reading is of before the run
    assert all(kept - left_out <= np.count_nonzero(own.there[:, 1::2]) < kept for own in found.values())
    noise = plain_noise(follower.size, 2)
    assert min(found, key=lambda late: noise.cost(found[late])) == 0.047


@pytest.mark.slow
def test_where_nothing_is_steered_a_delay_that_cuts_rows_changes_nothing():
    """A cut of rows that alters what noise does would draw delays to whole rows, and all else with them."""
    own = lap(seconds=20.0, seed=3)
    own = own.with_signals(steer=np.full(len(own), 0.02))
    model = nominal(vehicle=CAR) + EFFECTS["steering_delay"].at(0.0)
    ride = FollowedRun.of(own, READ)
    follower = Follower(model, READ)
    follower.tune([ride], {})
    noise = plain_noise(follower.size, 2)
    late = [{"steering_delay": share * own.sample_time} for share in (0.0, 0.2, 0.5)]
    assert np.ptp([noise.cost(found) for found in follower.innovations(ride, late)]) < 0.5


def test_cost_has_no_edge_where_a_reading_begins_to_be_late_and_counts_what_is_late_alike():
    ride = FollowedRun.of(lap(seconds=12.0), READ)
    follower = Follower(nominal() + EFFECTS["sensor_latency_yaw"].at(0.0), READ)
    follower.tune([ride], {})
    late = [{"sensor_latency_yaw": own} for own in (0.0, 2 * AT_ONCE, 1e-4, 0.09, 0.15)]
    none, least, little, much, most = follower.innovations(ride, late)
    foreseen = [np.sum(own.spread[own.runs == 0][0, : 2 * len(READ)]) for own in (none, least)]
    assert foreseen[1] == pytest.approx(foreseen[0], abs=1e-3)  # the run begins with what was read before it
    noise = plain_noise(follower.size, len(READ))
    assert noise.cost(little) == pytest.approx(noise.cost(least), abs=0.1)
    assert np.count_nonzero(most.there) == np.count_nonzero(much.there) == np.count_nonzero(least.there)
