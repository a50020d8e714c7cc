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
    known = common(Read(), runs(60, scatter, 0.1), {"varies": 0.5})
    for _ in range(4):
        known = common(Read(), runs(60, scatter, 0.1), {"varies": 0.5}, known)
    assert known.scatter[1] == pytest.approx(scatter, rel=0.25)
    assert known.scatter[0] == 0.0
    assert known.x == pytest.approx([3.0, 1.0], abs=3 * scatter / np.sqrt(60))


NAMES = [f"n{k}" for k in range(6)]


def reader_of_several():
    reader = Read()
    reader.numbers = tuple(VaryingNumber(name, False, 0.0, 10.0, 1e-3, -50.0, 50.0) for name in NAMES)
    return reader


@pytest.mark.parametrize(("apart", "least", "most"), [(0.01, 0.0, 0.05), (1.0, 0.6, 1.4)])
def test_how_much_a_vehicle_scatters_follows_from_all_its_numbers(apart, least, most):
    signs = np.array([1, -1, 1, 1, -1, 1])
    three = [ride(side * apart * 0.5 * signs, np.full(6, 1e-3)) for side in (-1, 0, 1)]
    known = common(reader_of_several(), three, dict.fromkeys(NAMES, 0.5))
    assert np.all((known.scatter > least * 0.5) & (known.scatter < most * 0.5))


def test_a_single_number_says_less_of_its_scatter_than_several():
    three = [ride(np.full(6, 0.005 * side), np.full(6, 1e-3)) for side in (-1, 0, 1)]
    several = common(reader_of_several(), three, dict.fromkeys(NAMES, 0.5)).scatter
    alone = common(Read(), [ride([3.0, 0.005 * side], [0.01, 1e-3]) for side in (-1, 0, 1)], {"varies": 0.5}).scatter
    assert alone[1] > 1.5 * several[0]


def test_few_runs_leave_a_scatter_uncertain_and_a_further_run_is_expected_to_differ_by_as_much_more():
    alike = [ride([3.0, 1.0 + 0.02 * side], [0.01, 1e-3]) for side in (-1, 0, 1)]
    many = [ride([3.0, 1.0 + 0.02 * side], [0.01, 1e-3]) for side in (-1, 0, 1) * 10]
    of_few, of_many = (common(Read(), some, {"varies": 0.5}).scatter[1] for some in (alike, many))
    assert of_many == pytest.approx(0.02 * np.sqrt(2 / 3), rel=0.1)
    assert 1.3 * of_many < of_few < 0.1


def test_one_number_may_scatter_more_than_others_of_its_vehicle():
    rng = np.random.default_rng(0)
    sizes = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.5])
    eight = [ride(sizes * rng.standard_normal(6), np.full(6, 1e-3)) for _ in range(8)]
    known = common(reader_of_several(), eight, dict.fromkeys(NAMES, 0.5))
    assert np.all(known.scatter[:5] < 0.06)
    assert known.scatter[5] > 0.25


def test_a_single_run_shows_no_scatter():
    assert common(Read(), [ride([3.0, 1.0], [0.01, 1e-3])], {"varies": 0.5}).scatter[1] == 0.5


def test_runs_that_tell_nothing_leave_the_usual_scatter():
    blind = [ride([3.0, 40.0 * (-1) ** k], [0.01, 1e4]) for k in range(6)]
    known = common(Read(), blind, {"varies": 0.5})
    assert known.scatter[1] == pytest.approx(0.5, rel=0.05)


def test_runs_stay_within_bounds_and_what_lies_beyond_is_no_scatter():
    beyond = [ride([3.0, -80.0], [0.01, 1.0]) for _ in range(3)]  # the bound is at -50
    known = common(Read(), beyond, {"varies": 0.5})
    firm = (
        3 / 0.5**2
    )  # of three runs at the bound; what is believed, 0 with an sd of 10, draws their mean a little back
    assert known.x[1] == pytest.approx(-50.0 * firm / (firm + 1 / 10.0**2), abs=1e-4)
    assert known.x[1] + known.deviations[:, 1] == pytest.approx(-50.0, abs=1e-9)
    assert known.scatter[1] < 0.6


def test_a_further_run_is_as_uncertain_as_the_mean_and_the_scatter():
    known = common(Read(), runs(10, 0.5, 0.1), {"varies": 0.5})
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
