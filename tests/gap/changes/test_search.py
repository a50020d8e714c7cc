"""Which numbers changed, alone or together, on recordings that read them directly."""

from types import SimpleNamespace

import numpy as np
import pytest

from greybox_id.gap.changes.between_runs import Common, VaryingNumber
from greybox_id.gap.changes.search import NONE, ChangeSearch, margin
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.descent import Curve

NAMES = ("grip", "arm", "offset", "delay")
SCATTER, WIDTH = 0.1, 1.0


class Read:
    """A ride reads sums of its numbers."""

    numbers = tuple(VaryingNumber(name, False, 0.0, 1.0, 1e-3, -20.0, 20.0, SCATTER, WIDTH) for name in NAMES)

    def cost(self, ride, x):
        return 0.5 * float(np.sum(((ride.of @ x - ride.read) / ride.sd) ** 2))

    def costs(self, ride, several):
        return [self.cost(ride, x) for x in several]

    def curve(self, ride, x, moved=None):
        del moved
        g = ride.of.T @ (ride.of @ x - ride.read) / ride.sd**2
        return Curve(self.cost(ride, x), g, ride.of.T @ ride.of / ride.sd**2, g[None])


def ride(changes, of=None, seed=0, sd=0.05):
    rng, n = np.random.default_rng(seed), len(NAMES)
    of = np.eye(n) if of is None else np.asarray(of, float)
    x = np.array([changes.get(name, 0.0) for name in NAMES]) + 0.5 * SCATTER * rng.standard_normal(n)
    return SimpleNamespace(of=of, read=of @ x + sd * rng.standard_normal(len(of)), sd=sd)


COUNT = len(NAMES)
KNOWN = Common(Read.numbers, tuple(range(COUNT)), np.zeros(COUNT), 1e-4 * np.eye(COUNT), np.full(COUNT, SCATTER),
               np.zeros((2, COUNT)), np.zeros((2, COUNT)), Read())  # fmt: skip


def searched(changes, of=None, judged=None, **more):
    others = [ride(changes if judged is None else judged, of, 2)]
    return ChangeSearch(KNOWN, [ride(changes, of, 1)], others, **more)


def named(search):
    return {NAMES[place] for place in search.best()}


@pytest.mark.parametrize("changes", [{"grip": -1.5, "offset": 1.0}, {"grip": 2.0, "arm": -1.0, "delay": 1.5}])
def test_several_changes_are_named_each_with_its_size(changes):
    search = searched(changes)
    assert named(search) == {*changes}
    best = search.best()
    assert {NAMES[k]: search.sizes(best)[k] for k in best} == pytest.approx(changes, abs=4 * SCATTER)
    assert all(search.probability(k) > 0.95 for k in best)
    assert all(search.probability(k) < 0.05 for k in range(len(NAMES)) if k not in best)


def test_a_size_is_what_recordings_say_and_not_drawn_towards_none():
    """A mount yawed by .30 rad came out as .14: what a change may be was .04 wide, and the recording no surer."""
    rides = [ride({"grip": 4.0}, None, seed, sd=0.8) for seed in (1, 2)]
    search = ChangeSearch(KNOWN, rides[:1], rides[1:])
    (place,) = search.best()
    read = rides[0].read[place]
    assert search.sets[frozenset({place})].shift[place] < 0.75 * read
    assert search.sizes(frozenset({place}))[place] == pytest.approx(read, rel=0.05)


def test_a_refit_begins_with_other_numbers_as_they_were_too():
    """Without the change they have moved to absorb it: from there, a late unit came out at half its latency."""
    search = searched({"grip": 1.5, "offset": 1.0})
    starts = search._promising(NONE, NAMES.index("delay"))[1]
    others = np.arange(COUNT) != NAMES.index("delay")
    moved = search.sets[NONE].explained.x
    assert [bool(np.array_equal(each[others], KNOWN.x[others])) for each in starts].count(True) == 1
    assert not np.allclose(moved, KNOWN.x, atol=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_one_change_names_only_one(name):
    search = searched({name: 1.2})
    assert named(search) == {name}
    assert max(search.gains(search.best())) > 20.0


def test_no_change_names_none():
    for scatter in ({}, {"grip": 1.5 * SCATTER, "delay": -1.5 * SCATTER}):
        search = searched(scatter)
        assert search.best() == NONE
        assert all(search.probability(k) < 0.1 for k in range(len(NAMES)))


def test_a_mixture_that_fits_best_alone_gives_way_to_what_it_mixes():
    of = [[1.0, 1.0, 0.0, 0.0], [0.0, 1.0, 1.0, 0.0], [3.0, 0.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    search = searched({"grip": 1.0, "offset": 1.0}, of)
    assert named(search) == {"grip", "offset"}
    mixed = frozenset({NAMES.index("arm")})
    assert mixed not in search.sets or search.weight(mixed) < search.weight(search.best())


def test_changes_that_act_alike_share_a_probability_and_leave_the_other_one_alone():
    of = [[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    search = searched({"grip": 1.0, "delay": -1.5}, of)
    grip, arm, delay = (NAMES.index(name) for name in ("grip", "arm", "delay"))
    best = search.best()
    assert best in ({grip, delay}, {arm, delay})
    (other,) = {grip, arm} - best
    assert search.alike(best, *(best - {delay})) == (other,)
    assert search.probability(grip) == pytest.approx(0.5, abs=0.05)
    assert search.probability(grip, arm) > 0.95
    assert search.alike(best, delay) == ()


def test_what_other_recordings_do_not_show_is_not_named_beside_what_they_show():
    search = searched({"grip": -1.5, "arm": 1.0}, judged={"grip": -1.5})
    assert named(search) == {"grip"}


def test_each_half_judges_what_the_other_one_chose():
    changes = {"grip": -1.5, "offset": 1.0}
    halves = [[ride(changes, seed=k)] for k in (1, 2)]
    search = ChangeSearch(KNOWN, [half[0] for half in halves], [], halves)
    assert named(search) == {*changes}
    once = ChangeSearch(KNOWN, [halves[0][0]], [], [halves[0], [ride({}, seed=3)]])
    assert named(once) == set()


def test_a_change_counts_by_all_recordings_and_by_those_that_did_not_choose_it():
    cost, elsewhere = CAL.cost_changed, CAL.cost_held_out

    def least(chosen, judged, apart=True):
        return margin(chosen + (judged if apart else 0.0), chosen, judged, 0.0, cost)

    assert least(cost + 50.0, elsewhere - 1.0) == pytest.approx(-1.0)
    assert least(elsewhere + 0.5, elsewhere + 40.0) == pytest.approx(2 * elsewhere + 40.5 - cost)  # both suffice
    assert least(elsewhere + 0.5, elsewhere + 1.0) == pytest.approx(2 * elsewhere + 1.5 - cost)
    assert least(elsewhere - 1.0, cost + 50.0) == pytest.approx(-1.0)
    assert least(cost - 1.0, elsewhere + 90.0, apart=False) == pytest.approx(-1.0)


def test_of_two_names_that_one_recording_hardly_tells_apart_the_other_recording_decides():
    def of(alike):
        return [[1.0, 1.0 - alike, 0.0, 0.0], [0.0, alike, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]

    grip, arm = NAMES.index("grip"), NAMES.index("arm")
    first, second = ride({"grip": 0.8}, of(0.05), 1), ride({"grip": 0.8}, of(0.6), 2)
    search = ChangeSearch(KNOWN, [first], [second])
    assert named(search) == {"grip"}
    gap = search.total(frozenset({grip})) - search.total(frozenset({arm}))
    assert search.weight(frozenset({grip})) - search.weight(frozenset({arm})) > 0.9 * gap > 3.0


def test_what_would_be_further_off_than_ever_changes_is_no_change():
    assert margin(180.0, 90.0, 90.0, 1.1 * CAL.reach_sd, CAL.cost_changed) == -np.inf
    assert named(searched({"grip": 1.2 * CAL.reach_sd * WIDTH})) == set()


def test_where_nothing_may_be_named_nothing_is():
    search = searched({"grip": 1.5}, nameless=NAMES)
    assert search.tried == []
    assert search.best() == NONE
