"""How far a gap closes: all of it with the truth, nothing with nothing, less than nothing with what is wrong."""

import numpy as np
import pytest
from driven import driven
from gap_cases import CAR, GivenBench

from greybox_id.base.errors import BadInput
from greybox_id.gap.closing import closed_by, closure, left_open
from greybox_id.gap.estimation.bench import Bench
from greybox_id.gap.estimation.free_runs import Misfit
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.vehicle import Vehicle

NOISE = {"v_y": 0.02, "yaw_rate": 0.005, "a_y": 0.1}
EXACT = Vehicle("car", CAR.values, noise=NOISE)
TOLERANT = Vehicle("car", CAR.values, {"steering_ratio": Stated(sd=0.01)}, NOISE)
SD = np.array([0.1, 1.0])


pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def laps():
    """Two drives of a lateral vehicle whose steering is slow and whose gyro is off."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_COMPILE", "0")
        there = {"steering_lag": 0.08, "yaw_rate_bias": 0.01}
        exact = {name: own.value for name, own in CAR.values.items()}
        known = {p.name: exact[p.name] for p in build("lateral", None, {}, CAR).parameters if p.name in exact}
        return [driven("lateral", 1, 12.0, seed, there, values=known) for seed in (0, 5)]


def closed(laps, effects, vehicle=EXACT, before=None):
    own = [build("lateral", None, each, vehicle) for each in (before or {}, effects)]
    return closure(*own, laps, vehicle, EFFECTS)


def test_the_truth_closes_the_gap(laps):
    found = closed(laps, {"steering_lag": 0.08, "yaw_rate_bias": 0.01})
    assert found.before > 1.5
    assert found.after == pytest.approx(1.0, abs=0.1)
    assert found.closed == pytest.approx(1.0, abs=0.1)
    assert found.closed_interval[0] <= found.closed <= found.closed_interval[1]
    assert found.recordings == tuple(own.name for own in laps)


def test_one_of_two_effects_closes_a_part(laps):
    found = closed(laps, {"steering_lag": 0.08})
    assert 0.05 < found.closed < 0.98
    assert found.before > found.after > found.floor


def test_nothing_closes_nothing(laps):
    found = closed(laps, {})
    assert found.closed == 0.0
    assert found.before == found.after
    assert found.closed_interval == (0.0, 0.0)


def test_what_is_left_open_stays_as_it_was(laps):
    found = closed(laps, {"steering_lag": 0.08})
    opened = left_open(found)
    assert opened.closed == 0.0
    assert opened.after == opened.before == found.before
    assert all(own.after == own.before for own in opened.errors)
    assert [own.before for own in opened.errors] == [own.before for own in found.errors]


def test_what_is_wrong_makes_the_gap_wider(laps):
    found = closed(laps, {"yaw_rate_bias": -0.02})
    assert found.closed < -0.1
    assert found.closed_interval[1] < 0.0


def test_the_noise_stated_is_the_floor_unless_less_is_left(laps):
    assert closed(laps, {"steering_lag": 0.08}).floor == 1.0
    assert closed(laps, {"steering_lag": 0.08, "yaw_rate_bias": 0.01}).floor <= 1.0


def test_a_model_that_leaves_the_range_of_numbers_is_refused(laps, monkeypatch):
    monkeypatch.setattr(Bench, "simulate", lambda own, P: np.full((len(P), *own.measured.shape), np.nan))
    with pytest.raises(BadInput, match="lateral diverges on drive"):
        closed(laps, {})


def test_what_cannot_be_refitted_counts_as_it_stands(laps, monkeypatch):
    known = closed(laps, {"steering_lag": 0.08})
    monkeypatch.setattr("greybox_id.gap.estimation.free_runs.refit", lambda *_: [])
    assert closed(laps, {"steering_lag": 0.08}).before == pytest.approx(known.before, rel=0.05)


def test_tolerances_are_refitted_in_both_and_charged_to_both():
    there = {"steering_ratio": 1.025}
    exact = {name: own.value for name, own in CAR.values.items()}
    known = {p.name: exact[p.name] for p in build("lateral", None, {}, CAR).parameters if p.name in exact}
    own = [driven("lateral", 1, 12.0, 0, there, values=known)]
    rigid, tolerant = (closed(own, {}, vehicle) for vehicle in (EXACT, TOLERANT))
    assert tolerant.before < rigid.before  # a part of it is taken up
    charge = 2.5**2 / (3 * 295)  # so many standard deviations, over readings
    assert tolerant.before == pytest.approx(1.0 + charge, abs=0.1)


# ---- of given errors


def misfits(before, after, charges=(0.0, 0.0), rows=2000, seed=0):
    """The closure of two models whose errors are this many times the noise, with its own noise beside."""
    rng = np.random.default_rng(seed)
    noise = SD * rng.standard_normal((rows, 2))
    shape = SD * np.sqrt(2) * np.sin(np.arange(rows) / 30)[:, None]
    bench = GivenBench(lambda _: noise, noise, 0)
    own = [Misfit(noise + size * shape, charge) for size, charge in zip((before, after), charges, strict=True)]
    return closed_by(*own, SD, bench.counted, bench, ("lap",))


@pytest.mark.parametrize(
    ("before", "after", "share"), [(3.0, 0.0, 1.0), (3.0, 1.5, 0.75), (2.0, 2.0, 0.0), (1.0, 2.0, -3.0)]
)
def test_the_share_is_of_what_exceeds_noise(before, after, share):
    found = misfits(before, after)
    assert found.before == pytest.approx(1 + before**2, rel=0.05)
    assert found.closed == pytest.approx(share, abs=0.05 + 0.05 * abs(share))
    low, high = found.closed_interval
    assert low <= found.closed <= high
    errors = {own.channel: own for own in found.errors if own.horizon is None}
    assert errors["y_1"].before == pytest.approx(np.sqrt(1 + before**2), rel=0.05)


def test_charges_count_as_errors_do():
    plain, charged = misfits(2.0, 0.0), misfits(2.0, 0.0, (400.0, 4000.0))
    assert charged.before == pytest.approx(plain.before + 400.0 / 4000)
    assert charged.after == pytest.approx(plain.after + 1.0)
    assert charged.closed < plain.closed


def test_intervals_hold_the_share_of_a_long_recording():
    truth = misfits(0.7, 0.35, rows=200_000).closed
    held = []
    for seed in range(60):
        low, high = misfits(0.7, 0.35, rows=1500, seed=seed).closed_interval
        held.append(low <= truth <= high)
    assert np.mean(held) > 0.85


def test_readings_that_do_not_count_do_not():
    noise = SD * np.random.default_rng(0).standard_normal((1000, 2))
    bench = GivenBench(lambda _: noise, noise, 0)
    wild, good = noise.copy(), bench.counted.copy()
    wild[300:400] = np.nan
    good[300:400] = False
    found = closed_by(Misfit(2 * wild, 0.0), Misfit(wild, 0.0), SD, good, bench, ("lap",))
    assert np.isfinite(found.closed)
    assert found.after == pytest.approx(1.0, abs=0.1)
    np.testing.assert_array_equal(np.isfinite(found.closed_interval), True)
