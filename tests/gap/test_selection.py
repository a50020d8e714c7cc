"""Forward selection: what acts is found alone and together, and what is compared has had the same chance."""

from dataclasses import replace

import numpy as np
import pytest
from gap_cases import GivenBench, axis, candidate, linear_bench, search_on, smooth_columns

from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.hypothesis import Start
from greybox_id.gap.estimation.noise import colour, white_noise
from greybox_id.gap.estimation.refit import refit
from greybox_id.gap.selection import _in_each_place, _let_go, _polished, select

SD, WORTH = np.array([0.1, 0.1]), 7.0


def selected(bench, count, nuisances=()):
    search = search_on(bench, SD, nuisances)

    def whitener(search, own):
        return white_noise(SD, bench.counted, bench.rows) if own is None else colour(own.e, bench.counted, bench.rows)

    return select(search, [candidate(k) for k in range(count)], whitener, lambda _: WORTH)


def settled_cost(search, own):
    (again,) = refit(search, [search.start_of(own)])
    return again.cost


def of_effects(*numbers):
    return {f"effect_{k}" for k in numbers}


@pytest.mark.parametrize("seed", range(3))
def test_two_effects_that_act_are_found_together(seed):
    X = smooth_columns(6, seed=seed)
    found = selected(linear_bench(X, [0, 1.0, 0, 0, -0.6, 0], SD, seed), 6)
    assert set(found.tried[0].names) == of_effects(1, 4)
    assert found.of(1)[0].names[0] in of_effects(1, 4)
    assert found.tried[0].cost < found.of(1)[0].cost - 10 * WORTH


def test_one_effect_is_named_with_its_next_partner_however_little_speaks_for_it():
    X = smooth_columns(5)
    small = 2.2 * SD[0] / np.sqrt(np.sum(X[:, :, 3] ** 2))  # 2.2 of its standard deviations
    found = selected(linear_bench(X, [0, 1.0, 0, small, 0], SD), 5)
    alone = next(own for own in found.tried if own.names == ("effect_1",))
    pair = next(own for own in found.tried if set(own.names) == of_effects(1, 3))
    assert 0 < alone.cost - pair.cost < WORTH


def test_rivals_of_the_best_are_refitted_where_it_stands():
    X = smooth_columns(4)
    X[:, :, 1] = X[:, :, 0] + 0.3 * X[:, :, 1]  # two that explain much the same

    def respond(p):  # a lag that is tolerated, whose effect bends
        return X[:, :, :2] @ p[:2] + X[:, :, 2] * p[2] + X[:, :, 3] * p[2] ** 2

    noise = SD * np.random.default_rng(0).standard_normal((400, 2))
    bench = GivenBench(respond, respond(np.array([1.0, 0.0, 1.4])) + noise, 3)
    found = selected(bench, 2, (axis(2, sd=1.0, low=0.0, gradual=False),))
    search, best = found.search, found.tried[0]
    assert best.names == ("effect_0",)
    with search.elsewhere():
        search.about(best)
        for own in found.tried:
            assert settled_cost(search, own) > own.cost - 1.0


def test_what_stands_in_an_effects_place_is_looked_for_beside_the_other_one():
    X = smooth_columns(8)
    search = search_on(linear_bench(X, [1.0, -0.6, *[0.0] * 6], SD), SD)
    own, base = [candidate(k) for k in range(8)], search.at_means()
    (pair,) = refit(search, [Start((own[0], own[2]), np.zeros(2), base.theta, base.linear)])
    (single,) = refit(search, [Start((own[2],), np.zeros(1), base.theta, base.linear)])
    replacing = _in_each_place(search, [single, pair], own, WORTH)
    best = min(replacing, key=lambda found: found.cost)
    assert set(best.names) == of_effects(0, 1)
    assert best.cost < pair.cost - 10 * WORTH
    assert len(replacing) <= 2 * CAL.replacing
    assert _in_each_place(search, [single], own, WORTH) == []
    assert (
        _in_each_place(search, [single, pair], own, 2 * (single.cost - pair.cost)) == []
    )  # a second effect gains too little


def test_polishing_goes_about_the_best_however_far_apart_as_long_as_that_gains(monkeypatch):
    X = smooth_columns(4)
    search = search_on(linear_bench(X, [0.085, 0.065, 0.06, 0.0], SD), SD)
    base = search.at_means()
    (nothing,) = refit(search, [Start((), np.empty(0), base.theta, base.linear)])
    found = refit(search, [Start((candidate(k),), np.zeros(1), base.theta, base.linear) for k in range(4)])
    found.sort(key=lambda own: own.cost)
    assert CAL.close * WORTH < found[1].cost - found[0].cost < found[2].cost - found[0].cost < CAL.near * WORTH
    about, plainly = [], search.about
    monkeypatch.setattr(search, "about", lambda own, **more: (about.append(own.names), plainly(own, **more)))
    _polished(search, nothing, found, found, WORTH)
    assert set(about) == {found[0].names, ()}
    about.clear()
    worse = [replace(own, cost=own.cost + 2 * CAL.enough) for own in found]
    _polished(search, nothing, worse, worse, WORTH)
    assert {own.names for own in found[:2]} == set(about) - {()}


def test_where_nothing_acts_no_effect_gains_what_it_must():
    X = smooth_columns(6)
    found = selected(linear_bench(X, np.zeros(6), SD), 6)
    assert found.base.cost - found.tried[0].cost < WORTH


def test_a_tolerance_further_off_than_it_reaches_is_let_go_as_an_effect():
    X = smooth_columns(2)
    search = search_on(linear_bench(X, [0.5, 0.02], SD), SD, [axis(0, sd=0.1), axis(1, sd=0.1)])
    (base,) = refit(search, [search.start_of(search.at_means())])
    (found,) = _let_go(search, base, [candidate(0), candidate(1)])
    assert found.names == ("effect_0",)
    assert found.m[0] == pytest.approx(0.5, abs=0.05)
    assert base.cost - found.cost == pytest.approx(0.5 * search.charge(base), rel=0.2)
