"""What runs have in common and how they scatter, on runs whose numbers are read directly."""

from types import SimpleNamespace

import numpy as np
import pytest

from greybox_id.gap.changes.between_runs import VaryingNumber, common, explained, values_of
from greybox_id.gap.estimation.descent import Curve, descended

NUMBERS = (
    VaryingNumber("shared", False, 0.0, 10.0, 1e-3, -50.0, 50.0),
    VaryingNumber("varies", False, 0.0, 10.0, 1e-3, -50.0, 50.0),
)


class Read:
    """A ride is what is read of its numbers, and the standard deviation of that."""

    numbers = NUMBERS

    def cost(self, ride, x):
        return 0.5 * float(np.sum(((x - ride.read) / ride.sd) ** 2))

    def curve(self, ride, x, moved=None):
        del moved
        g, H = (x - ride.read) / ride.sd**2, np.diag(1 / ride.sd**2)
        return Curve(self.cost(ride, x), g, H, g[None])


def ride(read, sd):
    return SimpleNamespace(read=np.asarray(read, float), sd=np.asarray(sd, float))


def runs(count, scatter, sd, seed=0):
    rng = np.random.default_rng(seed)
    return [ride([3.0, 1.0 + scatter * rng.standard_normal() + sd * rng.standard_normal()], [0.01, sd])
            for _ in range(count)]  # fmt: skip


def test_values_stay_within_their_bounds():
    assert values_of(NUMBERS, np.array([99.0, -99.0])) == {"shared": 50.0, "varies": -50.0}


@pytest.mark.parametrize("scatter", [0.2, 1.0])
def test_scatter_is_learned_from_many_runs(scatter):
    known = common(Read(), runs(60, scatter, 0.1), {"varies": 0.5}, {"varies": 4.0})
    for _ in range(4):
        known = common(Read(), runs(60, scatter, 0.1), {"varies": 0.5}, {"varies": 4.0}, known)
    assert known.scatter[1] == pytest.approx(scatter, rel=0.25)
    assert known.scatter[0] == 0.0
    assert known.x == pytest.approx([3.0, 1.0], abs=3 * scatter / np.sqrt(60))


@pytest.mark.parametrize(("apart", "least", "most"), [(0.01, 0.0, 0.15), (1.0, 0.7, 1.2)])
def test_how_much_a_vehicle_scatters_follows_from_all_its_numbers(apart, least, most):
    names = [f"n{k}" for k in range(6)]
    reader = Read()
    reader.numbers = tuple(VaryingNumber(name, False, 0.0, 10.0, 1e-3, -50.0, 50.0) for name in names)
    signs = np.array([1, -1, 1, 1, -1, 1])
    two = [ride(side * apart * 0.5 * np.sqrt(0.5) * signs, np.full(6, 1e-3)) for side in (-1, 1)]
    known = common(reader, two, dict.fromkeys(names, 0.5), dict.fromkeys(names, 4.0))
    assert np.all((known.scatter > least * 0.5) & (known.scatter < most * 0.5))
    one = common(Read(), [ride([3.0, side * 0.01], [0.01, 1e-3]) for side in (-1, 1)], {"varies": 0.5}, {"varies": 4.0})
    assert one.scatter[1] > 0.3  # a single number says little


def test_runs_that_differ_somewhat_less_than_usual_leave_the_usual_scatter():
    names = [f"n{k}" for k in range(6)]
    reader = Read()
    reader.numbers = tuple(VaryingNumber(name, False, 0.0, 10.0, 1e-3, -50.0, 50.0) for name in names)
    usual, prior_runs = dict.fromkeys(names, 0.5), dict.fromkeys(names, 4.0)
    two = [ride(np.full(6, side * 0.6 * 0.5 * np.sqrt(0.5)), np.full(6, 1e-3)) for side in (-1, 1)]
    known = common(reader, two, usual, prior_runs)
    assert known.scatter == pytest.approx(np.sqrt((4.0 + 0.6**2) / 5.0) * 0.5, rel=0.02)
    four = [ride(np.full(6, side * 0.1 * 0.5 * np.sqrt(0.5)), np.full(6, 1e-3)) for side in (-1, 1, -1, 1)]
    assert np.all(common(reader, four, usual, prior_runs).scatter < 0.2 * 0.5)


def test_runs_that_tell_nothing_leave_the_usual_scatter():
    blind = [ride([3.0, 40.0 * (-1) ** k], [0.01, 1e4]) for k in range(6)]
    known = common(Read(), blind, {"varies": 0.5}, {"varies": 4.0})
    assert known.scatter[1] == pytest.approx(0.5, rel=0.05)


def test_runs_stay_within_bounds_and_what_lies_beyond_is_no_scatter():
    beyond = [ride([3.0, -80.0], [0.01, 1.0]) for _ in range(3)]  # the bound is at -50
    known = common(Read(), beyond, {"varies": 0.5}, {"varies": 4.0})
    firm = (
        3 / 0.5**2
    )  # of three runs at the bound; what is believed, 0 with an sd of 10, draws their mean a little back
    assert known.x[1] == pytest.approx(-50.0 * firm / (firm + 1 / 10.0**2), abs=1e-4)
    assert known.x[1] + known.deviations[:, 1] == pytest.approx(-50.0, abs=1e-9)
    assert known.scatter[1] < 0.6


def test_scatter_that_is_specified_is_not_learned():
    known = common(Read(), runs(20, 2.0, 0.1), {"varies": 0.5}, {"varies": np.inf})
    assert known.scatter[1] == 0.5


def test_a_further_run_is_as_uncertain_as_the_mean_and_the_scatter():
    known = common(Read(), runs(10, 0.5, 0.1), {"varies": 0.5}, {"varies": 4.0})
    assert known.of_a_run[1, 1] == pytest.approx(known.covariance[1, 1] + known.scatter[1] ** 2)
    assert known.of_a_run[0, 0] == pytest.approx(known.covariance[0, 0])


def test_an_explanation_is_the_mean_of_belief_and_reading():
    own = ride([2.0, 4.0], [1.0, 1.0])
    found = explained(Read(), [own], np.zeros(2), np.zeros(2), np.diag([1.0, 3.0]))
    assert found.x == pytest.approx([1.0, 3.0])
    assert pytest.approx(np.diag([2.0, 4.0 / 3.0])) == found.H


def test_what_would_leave_its_bounds_is_held_there():
    own = ride([2.0, 400.0], [1.0, 1.0])
    found = explained(Read(), [own], np.zeros(2), np.zeros(2), np.diag([1e6, 1e6]))
    assert found.x == pytest.approx([2.0, 50.0], rel=1e-3)


@pytest.mark.parametrize("known", [0.3, 1.0, 4.0])
def test_a_hessian_that_is_wrong_by_a_factor_in_some_directions_leads_to_the_minimum_all_the_same(known):
    rng = np.random.default_rng(3)
    n = 12
    ways = np.linalg.qr(rng.standard_normal((n, n)))[0]
    true = ways @ np.diag(np.geomspace(1.0, 1e5, n)) @ ways.T
    told = ways @ np.diag(np.geomspace(1.0, 1e5, n) * np.where(np.arange(n) % 2, 1.0, known)) @ ways.T
    best, counted = rng.standard_normal(n), []

    def cost(u):
        return 0.5 * float((u - best) @ true @ (u - best))

    def curve(u):
        counted.append(u)
        return Curve(cost(u), true @ (u - best), told)

    wide = np.full(n, 50.0)
    _, found = descended(cost, curve, best + 0.3 * rng.standard_normal(n), -wide, wide)
    assert found.cost < 0.3
    assert len(counted) < 30
    bound = best + wide
    bound[0] = best[0] - 0.2
    u, found = descended(cost, curve, best - 0.5, -wide, bound)
    assert u[0] == pytest.approx(bound[0], abs=0.01)
    rest = np.linalg.solve(true[1:, 1:], true[1:, 0] * 0.2)  # where the first is held at its bound
    assert found.cost - cost(best + np.concatenate([[-0.2], rest])) < 0.5
