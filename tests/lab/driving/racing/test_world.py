"""Vehicles on a track: driven by a simple driver, beside an independent car, and the same however many there are."""

import numpy as np
import pandas as pd
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.fitting.requested_model import RequestedModel
from greybox_id.models.vehicle import vehicle
from greybox_lab.driving.racing.draws import HAND
from greybox_lab.driving.racing.environment import world
from greybox_lab.driving.racing.rules import Rules
from greybox_lab.driving.racing.world import OWN, World
from greybox_lab.virtual.virtual_vehicle import SteppedCar, random_vehicle, vehicle_file_text

pytestmark = pytest.mark.usefixtures("_uncompiled")


def driver(seen, own):
    """Steering by the curvature ahead and back to the line; the speed of 0.3 s ahead."""
    wheelbase, places = 0.33, (len(seen[0]) - OWN) // 2
    steer = 1.05 * wheelbase * seen[:, OWN + 1] / own.track.half_width - 0.35 * seen[:, 3] - 0.8 * seen[:, 4]
    top = float(np.max(own.track.speed))
    speed = 2 * (0.95 * top * seen[:, OWN + places + 2] - 0.5) / (top - 0.5) - 1
    return np.stack([steer / 0.419, speed], axis=1)


def driven(own, periods, again=True):
    """Rewards and ends of a drive."""
    rewards, ends, cuts = [], [], []
    for _ in range(periods):
        reward, ended, cut = own.step(driver(own.observe(), own))
        rewards.append(reward)
        ends.append(ended)
        cuts.append(cut)
        if again and np.any(ended | cut):
            own.reset(ended | cut)
    return np.array(rewards), np.array(ends), np.array(cuts)


def test_a_simple_driver_gets_around_and_is_paid_for_it():
    racing = world(16, action="speed")
    racing.reset(np.ones(16, dtype=bool), list(range(16)))
    rewards, ends, cuts = driven(racing, 1000)
    assert not np.any(ends)
    assert not np.any(cuts)
    assert 0.3 < np.mean(rewards) < 0.7
    assert np.all(racing.situation()["s"] - racing._from > 60.0)


def test_who_does_not_steer_leaves_the_track_and_is_told():
    racing = world(8)
    ended = np.zeros(8, dtype=bool)
    for _ in range(500):
        reward, over, _ = racing.step(np.tile([0.0, 0.6], (8, 1)), still=ended)
        assert np.all(reward[over] == -10.0)
        assert np.all(reward[ended] == 0.0)
        ended |= over
    assert np.all(ended)


def test_who_brakes_has_halted_and_time_and_laps_cut_an_episode_off():
    racing = world(2)
    ends = [racing.step(np.tile([0.0, -1.0], (2, 1)))[1] for _ in range(150)]
    assert np.all(np.any(ends, axis=0))
    short = world(4, action="speed", seconds=1.0)
    cuts = driven(short, 50, again=False)[2]
    assert np.all(cuts[-1])
    assert not np.any(cuts[:-1])


def test_a_lane_is_the_same_alone_or_among_others():
    options = {"randomise": "hand", "noise": True, "action": "speed"}
    many, alone = world(5, **options), world(1, **options)
    many.reset(np.ones(5, dtype=bool), [10, 11, 12, 13, 14])
    alone.reset(np.ones(1, dtype=bool), [13])
    for _ in range(200):
        seen, own = many.observe(), alone.observe()
        assert np.array_equal(seen[3], own[0])
        steps = many.step(driver(seen, many)), alone.step(driver(own, alone))
        assert [column[3] for column in steps[0]] == [column[0] for column in steps[1]]


def test_it_drives_as_an_independent_car_does(tmp_path):
    """Two seconds of commands, open loop, on the line of the shipped track."""
    car = random_vehicle(3, "racer")
    (tmp_path / "car.toml").write_text(vehicle_file_text(car))
    stated = vehicle(str(tmp_path / "car.toml"))
    model = RequestedModel("single_track", stated).model()
    racing = World(model, 1, Rules(), steer_max=stated.steer_max)
    v_x, nominal = 3.0, racing.stage.equations.values
    racing.z[0] = [*racing.stage.begun(v_x, nominal)[0], 0.0, 0.0, 0.0]
    racing._from[:] = 0.0
    ride = SteppedCar(car, v_x, 3.0, 50.0)
    place = 0.0
    for k in range(100):
        action = np.array([0.35 * np.sin(0.12 * k), 0.25])
        racing.step(action[None])
        ride.step(action[0] * stated.steer_max, action[1] * racing._drives[1])
        now = ride.motion
        place, e_y, _ = racing.track.project(now["x"], now["y"], now["yaw"], place)
        assert abs(racing.z[0, racing.stage.states.index("yaw_rate")] - now["yaw_rate"]) < 0.01
        assert abs(racing.z[0, -2] - e_y) < 2e-3
        assert abs(racing.z[0, -3] - place) < 1e-2


def test_a_late_command_acts_as_late_as_it_is():
    """Of 50 ms and periods of 20 ms: half of the third period."""
    rules = Rules()
    at_once, late = world(1), world(1, effects="steering_delay=50ms")
    for own in (at_once, late):
        own.reset(np.ones(1, dtype=bool), [3])
        own.z[0, -3:] = 0.0
    acted = [late._acting(np.array([[1.0, 0.0]]), np.ones(1, dtype=bool))[0, 0] for _ in range(4)]
    np.testing.assert_allclose(np.array(acted) / late.steer_max, [0.0, 0.0, 0.5, 1.0], atol=1e-9)
    assert rules.period == 0.02
    assert at_once._acting(np.array([[1.0, 0.0]]), np.ones(1, dtype=bool))[0, 0] == at_once.steer_max


def test_a_late_sensor_is_seen_as_late_as_it_is():
    """Of 30 ms and periods of 20 ms: the middle between one and two periods ago; v_x is read at once."""
    racing = world(2, effects="sensor_latency_yaw=30ms", action="speed")
    racing.reset(np.ones(2, dtype=bool), [3, 4])
    begun, motion = racing.observe()[0, :3], []
    still = np.array([False, True])
    for k in range(6):
        motion.append(racing.z[:, racing._plane].copy())
        racing.step(np.array([[0.3 * np.sin(k), 0.2]] * 2), still=still)
    now, seen = racing.z[:, racing._plane], racing.observe()
    assert begun[2] == pytest.approx(motion[0][0, 2] / racing._turning, abs=1e-6)
    assert seen[0, 2] == pytest.approx(0.5 * (motion[-1] + motion[-2])[0, 2] / racing._turning, rel=1e-5)
    assert seen[0, 0] == pytest.approx(now[0, 0] / racing._top, rel=1e-6)
    assert seen[1, 2] == pytest.approx(now[1, 2] / racing._turning, abs=1e-6)
    drawn = pd.DataFrame({"sensor_latency_yaw": [0.0, 0.06]})
    found = world(8, effects="sensor_latency_yaw=1e-6", randomise=drawn)
    assert set(np.round(found._unseen[:, 2], 9)) == {0.0, 0.06}


def test_what_is_drawn_stays_in_its_range_and_changes_with_every_episode():
    racing = world(64, randomise="hand")
    columns = dict(zip(racing._moving, racing._p.T, strict=True))
    for name, (low, high) in HAND.items():
        assert np.min(columns[name]) >= low
        assert np.max(columns[name]) <= high
        assert np.std(columns[name]) > 0.15 * (high - low)
    before = racing._p.copy()
    racing.reset(np.ones(64, dtype=bool))
    assert not np.any(np.all(before == racing._p, axis=1))


def test_draws_of_a_posterior_weigh_as_they_say(tmp_path):
    table = pd.DataFrame({"I_z": [0.03, 0.05], "m": [3.0, 4.0], "weight": [0.0, 1.0], "chain": [0, 1]})
    table.to_parquet(tmp_path / "posterior.parquet")
    racing = world(16, randomise=tmp_path / "posterior.parquet")
    assert dict(zip(racing._moving, racing._p[0], strict=True)) == {"I_z": 0.05, "m": 4.0}
    assert np.ptp(racing._p, axis=0).max() == 0.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"vehicle": "robo"}, "no vehicle"),
        ({"model": "lateral"}, "cannot drive along a track"),
        ({"model": "nothing"}, "no model"),
        ({"randomise": "hans"}, "no randomisation"),
        ({"randomise": "nothing.parquet"}, "cannot be read|no table"),
        ({"action": "sped"}, "Did you mean"),
        ({"reward": "money"}, "no reward"),
        ({"period": 0.0}, "above zero"),
        ({"seconds": float("nan")}, "above zero"),
        ({"lap": 3}, "has no option"),
        ({"randomise": pd.DataFrame({"mass": [1.0]})}, "no parameter"),
        ({"randomise": pd.DataFrame({"m": [np.nan]})}, "finite numbers"),
    ],
)
def test_what_makes_no_world_is_a_sentence(options, said):
    with pytest.raises(BadInput, match=said):
        world(1, **options)


def test_actions_that_are_no_numbers_do_no_harm():
    racing = world(3)
    for action in ([np.nan, np.inf], [1e9, -1e9], [0.0, np.nan]):
        racing.step(np.tile(action, (3, 1)))
        assert np.all(np.isfinite(racing.observe()))


def begun(**rules):
    racing = world(8, action="speed", **rules)
    racing.reset(np.ones(8, dtype=bool), list(range(8)))
    return racing


def test_the_speed_that_is_shown_is_of_the_grip_that_is_asked_for_and_under_the_cap():
    shown = {usage: begun(usage=usage).observe()[:, OWN + 10 :] for usage in (0.8, 0.45)}
    plain = begun()
    np.testing.assert_array_equal(shown[0.8], plain.observe()[:, OWN + 10 :])
    slow = begun(usage=0.45)
    slow.z[:] = plain.z
    np.testing.assert_allclose(slow.observe()[:, OWN + 10 :], shown[0.8] * 0.75, rtol=1e-5)
    capped = begun(speed_cap=4.0)
    capped.z[:] = plain.z
    places = capped.observe()[:, OWN + 10 :]
    np.testing.assert_allclose(places, np.minimum(shown[0.8], 4.0 / plain.units["speed"]), rtol=1e-5)
    assert np.any(places < shown[0.8])
    np.testing.assert_array_equal(begun(usage_cap=0.45).observe(), begun(usage=0.45).observe())


def test_a_pair_of_shares_is_drawn_in_each_episode():
    racing = begun(usage=(0.4, 0.9))
    first = racing._pace.copy()
    assert len(set(first)) == 8
    racing.reset(np.array([True] + [False] * 7))
    assert racing._pace[0] != first[0]
    assert np.array_equal(racing._pace[1:], first[1:])
    assert np.all((racing._pace**2 * 0.8 >= 0.4) & (racing._pace**2 * 0.8 <= 0.9))


def test_the_reward_of_the_path_is_one_for_who_drives_it_as_fast_as_is_shown():
    racing = begun(reward="path")
    straight = int(np.argmin(np.abs(racing.track.curvature) + 10.0 * (racing.track.speed < 5.0)))
    s, wanted = racing.track.s[straight], racing.track.speed[straight]
    before, after = racing.z.copy(), racing.z.copy()
    after[:, -3], after[:, -2], after[:, -1] = s, 0.0, 0.0
    after[:, racing._plane] = [wanted, 0.0, 0.0]
    after[1, racing._plane[0]] = 0.9 * wanted
    after[2, -2] = 0.1 * racing.track.half_width
    after[3, -1] = np.pi / 3
    after[4, -2] = racing.edge + 0.01
    before[:, racing._plane] = after[:, racing._plane]
    reward, ended, _ = racing._judged(before, after, racing._last, np.zeros(8, dtype=bool))
    np.testing.assert_allclose(reward[:5], [1.0, 0.9, 1.0 - 0.1 / 1.1, 0.5, -10.0], rtol=1e-5)
    assert np.array_equal(np.flatnonzero(ended), [4])


@pytest.mark.parametrize("usage", [0.0, 1.5, "much", (0.9, 0.4), (0.1, 0.2, 0.3), np.nan])
def test_a_share_that_is_none_is_refused(usage):
    with pytest.raises(BadInput, match="usage"):
        Rules(usage=usage)


def test_drivers_remember_periods_that_they_saw():
    plain, own = (world(2, noise=True, action="speed", memory=n) for n in (0, 3))
    for one in (plain, own):
        one.reset(np.ones(2, dtype=bool), [1, 2])
    assert own.size == plain.size + 9
    start = own.observe()[:, -9:].reshape(2, 3, 3)
    assert np.all(start[:, :, :2] == 0.0)
    assert np.allclose(start[:, :, 2], own.z[:, [0]] / own.units["speed"])  # it has driven straight on
    known = []
    for k in range(4):
        seen = plain.observe()
        assert np.array_equal(own.observe()[:, :27], seen)
        known.insert(0, np.stack([np.full(2, 0.1 * k), seen[:, 2], seen[:, 0]], axis=1))
        for one in (plain, own):
            one.step(np.tile([0.1 * k, 0.3], (2, 1)))
    past = own.observe()[:, -9:].reshape(2, 3, 3)
    assert np.allclose(past, np.stack(known[:3], axis=1), atol=1e-6)
    with pytest.raises(BadInput, match="memory: a whole number from 0 to 50"):
        Rules(memory=-1)
