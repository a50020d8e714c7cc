"""Sets of causes by their evidence, against the Gaussian density that it is; what is not wanted falls to its zone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from greybox_id.gap.estimation.problem import Linear
from greybox_id.gap.estimation.sparse import Behind, Quadratic, Sets

ODDS, ZONE, USUAL = 4.0, 0.01, 1.0


def linear(A, r, causes, belief=0.5, low=-np.inf):
    """A problem of residuals r with columns A: tolerances first, then so many causes; nothing has moved yet."""
    count = A.shape[1]
    main = np.arange(count) >= count - causes
    return Linear(
        columns=np.column_stack([r, A]), at=np.zeros(count), mean=np.zeros(count), low=np.where(main, low, -np.inf),
        high=np.full(count, np.inf),
        sd=np.where(main, ZONE, belief), cause=np.where(main, np.arange(count) - (count - causes), -1), main=main,
        moved=np.ones(count, dtype=bool),
    )  # fmt: skip


def drawn(truth, tolerances=2, rows=300, seed=0):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((rows, tolerances + len(truth)))
    u = np.concatenate([0.3 * rng.standard_normal(tolerances), truth])
    return A, A @ -u + rng.standard_normal(rows)  # residuals fall to noise where coordinates are u


def sets_of(own, causes, never=()):
    return Sets(Quadratic.of(own), np.full(causes, ZONE), np.full(causes, USUAL), np.full(causes, ODDS), never)


def switched(*there, of):
    found = np.zeros(of, dtype=bool)
    found[list(there)] = True
    return found


@pytest.mark.parametrize("there", [(), (0,), (1, 2)])
def test_a_set_scores_as_the_density_of_its_residuals(there):
    A, r = drawn([0.0, 0.8, -0.5], rows=40)
    own = sets_of(linear(A, r, 3), 3)
    on = switched(*there, of=3)
    sd = np.concatenate([[0.5, 0.5], np.where(on, USUAL, ZONE)])
    density = multivariate_normal(np.zeros(40), np.eye(40) + (A * sd**2) @ A.T).logpdf(r)
    assert own.base + own.score(on) == pytest.approx(density + 20 * np.log(2 * np.pi) - ODDS * len(there), abs=1e-6)


@pytest.mark.parametrize("rounding", [0.0, np.nan])
def test_a_sum_of_squares_that_rounding_made_less_than_nothing_is_no_evidence(rounding):
    """So it is of simulations that spin, whose residuals are 1e40 and more."""
    squares = Quadratic.of(linear(*drawn([0.0, 0.8]), 2))
    given = np.full(2, ZONE), np.full(2, USUAL), np.full(2, ODDS), ()
    assert np.isfinite(Sets(squares, *given).base)
    assert Sets(replace(squares, rr=rounding), *given).base == -np.inf


def test_a_set_that_explains_more_than_there_is_is_no_evidence():
    """Columns of simulations that spin are so large that products of them are rounding."""
    squares = Quadratic.of(linear(*drawn([0.0, 0.8]), 2))
    given = np.full(2, ZONE), np.full(2, USUAL), np.full(2, ODDS), ()
    second = switched(1, of=2)
    assert np.isfinite(Sets(squares, *given).score(second))
    off = np.where(squares.about.main, 1e90 * np.eye(len(squares.g))[-1], 0.0)
    assert Sets(replace(squares, g=squares.g + off), *given).score(second) == -np.inf


def test_sizes_are_those_of_the_posterior():
    A, r = drawn([0.0, 0.8, -0.5])
    own = sets_of(linear(A, r, 3), 3)
    size, sd = own.sizes(switched(1, 2, of=3))
    prior = np.diag(1 / np.array([0.5, 0.5, ZONE, USUAL, USUAL]) ** 2)
    covariance = np.linalg.inv(A.T @ A + prior)
    np.testing.assert_allclose(size, (-covariance @ A.T @ r)[2:], atol=1e-9)
    np.testing.assert_allclose(sd, np.sqrt(np.diag(covariance))[2:], rtol=1e-9)


def test_where_rounding_left_a_curvature_indefinite_nothing_is_known_of_sizes():
    """So it is of simulations that spin, whose derivatives are 1e40 and more."""
    squares = Quadratic.of(linear(*drawn([0.0, 0.8]), 2))
    G = squares.G.copy()
    G[-1, -2] = G[-2, -1] = 3.0 * np.sqrt(G[-1, -1] * G[-2, -2])
    indefinite = Sets(replace(squares, G=G), np.full(2, ZONE), np.full(2, USUAL), np.full(2, ODDS), ())
    both = switched(0, 1, of=2)
    assert indefinite.score(both) == -np.inf
    assert np.all(np.isinf(indefinite.sizes(both)[1]))


@pytest.mark.parametrize("seed", range(5))
def test_many_causes_at_once_and_nothing_else(seed):
    truth = np.zeros(30)
    truth[[2, 7, 11, 20, 29]] = [0.6, -0.5, 0.9, 0.4, -0.7]
    A, r = drawn(truth, seed=seed)
    own = sets_of(linear(A, r, 30), 30)
    assert set(np.flatnonzero(own.climbed(switched(of=30)))) == {2, 7, 11, 20, 29}
    assert set(np.flatnonzero(own.climbed(switched(0, 1, 3, of=30)))) == {2, 7, 11, 20, 29}


def test_where_nothing_acts_no_set_is_better_than_none():
    A, r = drawn(np.zeros(30), seed=3)
    own = sets_of(linear(A, r, 30), 30)
    assert not np.any(own.climbed(switched(of=30)))


def test_of_two_that_act_alike_one_is_surely_there_and_nothing_says_which():
    A, r = drawn([0.7, 0.0, 0.0])
    A[:, 3] = A[:, 2]  # the second does what the first does
    own = sets_of(linear(A, r, 3), 3)
    first, second, neither, third = (own.score(switched(*names, of=3)) for names in ((0,), (1,), (), (0, 2)))
    assert first == pytest.approx(second)
    assert first > neither + 7.0
    assert third < first - 2.0


def test_forms_of_one_another_are_never_there_together():
    A, r = drawn([0.7, 0.6])
    own = sets_of(linear(A, r, 2), 2, never=[(0, 1)])
    assert own.score(switched(0, 1, of=2)) == -np.inf
    assert np.sum(own.climbed(switched(of=2))) == 1


def test_a_magnitude_beyond_its_bound_explains_nothing():
    A, r = drawn([-0.7])
    assert not np.any(sets_of(linear(A, r, 1, low=0.0), 1).climbed(switched(of=1)))
    assert np.all(sets_of(linear(A, r, 1), 1).climbed(switched(of=1)))


def test_a_magnitude_beyond_its_bound_is_told():
    A, r = drawn([-0.7, 0.5])
    sets = sets_of(linear(A, r, 2, low=0.0), 2)
    assert list(sets.beyond(switched(0, 1, of=2))) == [True, False]
    assert not np.any(sets.beyond(switched(of=2)))


def test_what_a_set_costs_counts_another_magnitude_at_its_bound():
    """Without the first, the second would be below zero: it is held there, and the difference is finite."""
    A, r = drawn([1.0, 0.3])
    A[:, 3] = A[:, 2] + 0.3 * A[:, 3]
    r = A @ -np.array([0.1, 0.1, 1.0, -0.4]) + np.random.default_rng(1).standard_normal(300)
    sets = sets_of(linear(A, r, 2, low=0.0), 2)
    both, first, second = (switched(*names, of=2) for names in ((0, 1), (0,), (1,)))
    assert list(sets.beyond(both)) == [False, True]
    assert sets.score(both) == -np.inf
    assert sets.cost(both) == pytest.approx(sets.cost(first), abs=0.1)  # the second at its bound, but for its belief
    assert sets.cost(first) < sets.cost(second) - 10.0


def test_evidence_switches_off_what_a_recording_does_not_want():
    truth = np.zeros(12)
    truth[[3, 8]] = [0.8, -0.6]
    A, r = drawn(truth)
    squares = Quadratic.of(linear(A, r, 12))
    variance = np.full(12, 0.1)
    for _ in range(5):
        variance = squares.switched(variance, np.full(12, ZONE), np.full(12, USUAL))
    there = np.sqrt(variance) > 0.2
    assert set(np.flatnonzero(there)) == {3, 8}
    best = squares.best(variance)
    np.testing.assert_allclose(best[2:][there], [0.8, -0.6], atol=0.2)
    assert np.all(np.abs(best[2:][~there]) < 0.15)


@pytest.mark.parametrize(
    ("scores", "ends"),
    [
        ([-20.0, -19.9], [False, True]),  # 20 behind, after a step of 0.1
        ([-20.0, -12.0, -8.0, -7.5], [False, False, False, True]),
        ([-np.inf, -np.inf, -2.0, -1.0], [False, False, False, False]),  # a magnitude was beyond its bounds
        ([-1.0, 1.0, 1.1], [False, False, False]),  # it is ahead
    ],
)
def test_a_refit_is_given_up_where_its_steps_gain_too_little_for_what_it_lacks(scores, ends):
    behind = Behind(np.ones(1, dtype=bool), 3.0)
    steps = [SimpleNamespace(base=3.0, score=lambda included, score=score: score) for score in scores]
    assert [behind(step) for step in steps] == ends
