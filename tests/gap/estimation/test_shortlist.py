"""The shortlist: the true cause promises most, about as much as it gains, and wrong starts promise nothing."""

import numpy as np
import pytest
from gap_cases import GivenBench, axis, linear_bench, search_on
from gap_cases import candidate as gradual

from greybox_id.gap.estimation.axes import Candidate
from greybox_id.gap.estimation.hypothesis import Start
from greybox_id.gap.estimation.refit import refit
from greybox_id.gap.estimation.shortlist import BETWEEN, from_where_best, promises

SD = np.array([0.1, 0.1])


def columns(count, rows=500, seed=0):
    return np.random.default_rng(seed).standard_normal((rows, 2, count))


def base_of(search):
    return refit(search, [search.start_of(search.at_means())])[0]


def test_the_cause_promises_most_and_what_it_promises_comes_true():
    X = columns(5)
    search = search_on(linear_bench(X, [0.02, 0, 0.3, 0, 0], SD), SD, [axis(0, sd=0.05)])
    base = base_of(search)
    found = promises(search, base, [gradual(k) for k in range(1, 5)])
    assert found[0].candidate.effect == "effect_2"
    assert found[0].gain > 10 * found[1].gain
    assert [own.gain for own in found] == sorted((own.gain for own in found), reverse=True)
    refitted = refit(search, [Start((found[0].candidate,), np.array(found[0].start), base.theta, base.linear)])[0]
    assert base.cost - refitted.cost == pytest.approx(found[0].gain, rel=1e-6)
    assert refitted.m[0] == pytest.approx(found[0].start[0], rel=1e-6)
    assert found[0].sd == pytest.approx(np.sqrt(search.covariance(refitted)[0, 0]), rel=1e-6)


def test_what_a_hypothesis_has_already_promises_no_more():
    X = columns(3)
    search = search_on(linear_bench(X, [0.3, 0.2, 0], SD), SD)
    base = base_of(search)
    (one,) = refit(search, [Start((gradual(0),), np.zeros(1), base.theta, base.linear)])
    found = promises(search, one, [gradual(k) for k in range(3)])
    assert [own.candidate.effect for own in found] == ["effect_1", "effect_2"]


def test_what_tolerances_take_up_is_told_so():
    X = columns(2)
    X[:, :, 1] = X[:, :, 0] + 0.01 * X[:, :, 1]
    search = search_on(linear_bench(X, [0, 0], SD), SD, [axis(0, sd=10.0)])
    (own,) = promises(search, base_of(search), [gradual(1)])
    assert own.told < 1e-3
    search = search_on(linear_bench(X, [0, 0], SD), SD)
    (own,) = promises(search, base_of(search), [gradual(1)])
    assert own.told == pytest.approx(1.0)


def kinked(truth):
    """Nothing happens below a magnitude of one."""
    X = columns(1)

    def respond(p):
        return X[:, :, 0] * max(p[0] - 1.0, 0.0)

    noise = SD * np.random.default_rng(1).standard_normal((500, 2))
    return GivenBench(respond, respond(np.array([truth])) + noise, 1)


def test_of_several_starts_the_best_is_kept():
    search = search_on(kinked(3.0), SD)
    own = Candidate("play", (axis(0, low=0.0),), ((0.5,), (1.5,), (2.7,), (9.0,)), gradual=False)
    (found,) = promises(search, base_of(search), [own])
    assert found.start == (2.7,)
    assert from_where_best([found], [own])[0].starts == ((2.7,),)


def test_where_an_effect_was_best_alone_is_a_start_beside_others():
    search = search_on(kinked(3.0), SD)
    own = Candidate("play", (axis(0, low=0.0),), ((1.5,), (9.0,)), gradual=False)
    base = base_of(search)
    found = promises(search, base, [own])
    (single,) = refit(search, [Start((own,), np.array([1.5]), base.theta, base.linear)])
    assert single.m[0] == pytest.approx(3.0, abs=0.1)
    (known,) = from_where_best(found, [own], [single])
    assert 9.0 / BETWEEN < found[0].start[0] < 4.0  # nine is too much
    assert known.starts == (found[0].start, tuple(single.m))
    (again,) = promises(search, base, [known])
    assert again.start == tuple(single.m)


def test_a_start_without_any_effect_or_in_the_wrong_direction_promises_nothing():
    search = search_on(kinked(3.0), SD)
    assert promises(search, base_of(search), [Candidate("play", (axis(0),), ((0.5,),), gradual=False)]) == []
    X = columns(1)
    search = search_on(linear_bench(X, [-0.5], SD), SD)
    assert promises(search, base_of(search), [Candidate("lag", (axis(0, low=0.0),), ((0.4,),), gradual=False)]) == []
    bounded = Candidate("lag", (axis(0, low=0.0),), ((0.4,),))
    assert promises(search, base_of(search), [bounded]) == []


def test_a_start_that_leaves_the_range_of_numbers_is_passed_over():
    X = columns(1)

    def respond(p):
        return X[:, :, 0] * p[0] if p[0] < 5 else np.full((500, 2), np.nan)

    search = search_on(GivenBench(respond, respond(np.array([2.0])), 1), SD)
    (found,) = promises(search, base_of(search), [Candidate("own", (axis(0),), ((9.0,), (1.6,)), gradual=False)])
    assert found.start == pytest.approx((2.0,))


def test_beyond_the_next_start_nothing_is_promised():
    X = columns(1)
    search = search_on(GivenBench(lambda p: X[:, :, 0] * p[0] ** 2, X[:, :, 0] * 30.0**2, 1), SD)
    assert promises(search, base_of(search), [Candidate("ellipse", (axis(0, low=0.0),), ((1.0,), (2.0,)))]) != []
    sudden = Candidate("ellipse", (axis(0, low=0.0),), ((1.0,), (2.0,)), gradual=False)
    assert promises(search, base_of(search), [sudden]) == []


def test_a_start_is_moved_by_the_power_its_effect_grows_with():
    X = columns(1)
    search = search_on(GivenBench(lambda p: X[:, :, 0] * p[0] ** 2, X[:, :, 0] * 3.0**2, 1), SD)
    own = Candidate("ellipse", (axis(0, low=0.0),), ((1.0,), (2.0,), (30.0,)), gradual=False)
    (found,) = promises(search, base_of(search), [own])
    assert found.start == pytest.approx((3.0,))


def test_a_gradual_effect_with_a_second_parameter_starts_where_the_line_leads():
    X = columns(2)

    def respond(p):
        return p[0] * np.where(p[1] > 0, X[:, :, 0], X[:, :, 1])

    bench = GivenBench(respond, respond(np.array([2.0, 1.0])), 2)
    own = Candidate("wind", (axis(0, low=0.0), axis(1)), ((0.3, 1.0), (0.3, -1.0)))
    search = search_on(bench, SD)
    (found,) = promises(search, base_of(search), [own])
    assert found.start == pytest.approx((2.0, 1.0))


def test_one_start_at_most_is_kept_of_what_has_none():
    search = search_on(linear_bench(columns(1), [1.0], SD), SD)
    found = promises(search, base_of(search), [gradual(0)])
    assert from_where_best(found, [gradual(0)]) == [gradual(0)]


def test_nuisances_go_along_to_where_a_candidate_is_tried():
    X = columns(2)
    X[:, :, 1] = X[:, :, 0] + 0.2 * X[:, :, 1]
    search = search_on(linear_bench(X, [0.0, 1.0], SD), SD, [axis(0, sd=0.5)])
    base = base_of(search)
    (found,) = promises(search, base, [gradual(1)])
    assert base.theta[0] > 0.8  # it has taken up most of the gap
    assert found.start[0] == pytest.approx(1.0, abs=0.1)
    assert abs(found.nuisances[0]) < 0.1


@pytest.mark.parametrize("starts", [(), ((0.1,),)], ids=["by its derivative", "from a start"])
def test_what_lies_beyond_a_bound_is_not_promised(starts):
    X = columns(1)
    search = search_on(linear_bench(X, [1.0], SD), SD)
    base = base_of(search)
    bounded = Candidate("effect_0", (axis(0, high=0.25),), starts)
    (found,) = promises(search, base, [bounded])
    assert found.start[0] == pytest.approx(0.25)
    (refitted,) = refit(search, [Start((bounded,), np.array(found.start), base.theta, base.linear)])
    assert found.gain == pytest.approx(base.cost - refitted.cost, rel=1e-6)


def test_of_starts_of_another_second_parameter_the_one_that_gets_further_within_its_bounds_is_kept():
    """A second parameter so large that the effect is hardly there asks for more of it than there can be."""
    X = columns(1)[:, :, 0]
    search = search_on(GivenBench(lambda p: 0.2 * X * p[0] / (1 + p[1]), 0.1 * X, 2), SD)
    own = Candidate("warmth", (axis(0, high=0.8), axis(1, low=0.0)), ((0.05, 0.0), (0.05, 99.0)))
    (found,) = promises(search, base_of(search), [own])
    assert found.start[1] == 0.0
    assert found.gain > 0
