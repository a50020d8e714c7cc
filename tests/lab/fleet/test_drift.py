"""Changes of vehicles are found, dated and sized; steady fleets stay so."""

import numpy as np
import pytest

from greybox_lab.fleet.changes import _tail
from greybox_lab.fleet.drift import drifted
from greybox_lab.fleet.hierarchy import Informed


def fleet(seed, vehicles=30, each=20, size=3):
    """Vehicles 0 to 3 lose a fifth of parameter 0 over the series, 4 and 5 jump in parameter 2 at recording 8."""
    rng, x = np.random.default_rng(seed), np.linspace(0, 1, each)
    information, vector, of = [], [], []
    for v in range(vehicles):
        at = rng.normal(0.0, 0.1, size)
        for r in range(each):
            moved = np.array([np.log(0.8) * x[r] * (v < 4), 0.0, 0.15 * (r >= 8) * (v in (4, 5))])
            sd = 0.03 * (rng.uniform(3, 10) if rng.random() < 0.5 else 1.0)
            own = sd**2 * (np.eye(size) + 0.4)
            read = rng.multivariate_normal(at + moved + 0.02 * rng.normal(size=size), own)
            information.append(np.linalg.inv(own))
            vector.append(information[-1] @ read)
            of.append(v)
    order = [np.arange(v * each, (v + 1) * each) for v in range(vehicles)]
    return Informed(np.array(information), np.array(vector), np.array(of), vehicles), order, [x] * vehicles


def test_changes_are_found_and_steady_vehicles_are_left_alone():
    found, false, held, dated = 0, 0, 0, 0
    for seed in range(3):
        changes = [own for own in drifted(*fleet(seed)).changes if own.drifts]
        found += len({own.vehicle for own in changes if own.vehicle < 6})
        false += len({own.vehicle for own in changes if own.vehicle >= 6})
        for own in changes:
            if own.vehicle < 4 and own.parameter == 0 and own.kind == "slope":
                held += abs(own.change - np.log(0.8)) < 1.96 * np.sqrt(own.variance)
            if own.vehicle in (4, 5) and own.parameter == 2 and own.kind == "step":
                dated += abs(own.at - 8) <= 1
        assert all(0 <= own.probability <= 1 for own in changes)
    assert found >= 17
    assert false <= 2
    assert held >= 9
    assert dated >= 4


def test_two_changes_of_one_vehicle_are_both_found():
    seen, order, x = fleet(11)
    vector = seen.vector.copy()
    late = order[0][10:]
    vector[late] += seen.information[late][:, :, 2] * 0.2
    changes = drifted(Informed(seen.information, vector, seen.vehicle, seen.vehicles), order, x).changes
    changes = [change for change in changes if change.drifts and change.vehicle == 0]
    assert {change.parameter for change in changes} >= {0, 2}


def test_a_vehicle_of_few_recordings_is_not_tested():
    seen, order, x = fleet(1, vehicles=3, each=3)
    assert drifted(seen, order, x).changes == ()


def moving(seed, move, vehicles=12, each=16):
    """Vehicles 0 to 3 move in parameter 1 as `move` tells: a generator and the number of recordings -> shifts."""
    rng, x = np.random.default_rng(seed), np.linspace(0, 1, each)
    information, vector, of, truth = [], [], [], []
    for v in range(vehicles):
        at, moved = rng.normal(0.0, 0.1, 2), move(rng, each) if v < 4 else np.zeros(each)
        truth.append(moved)
        for r in range(each):
            own = (0.03 * (rng.uniform(3, 10) if rng.random() < 0.5 else 1.0)) ** 2 * (np.eye(2) + 0.4)
            information.append(np.linalg.inv(own))
            read = rng.multivariate_normal(at + [0.0, moved[r]] + 0.02 * rng.normal(size=2), own)
            vector.append(information[-1] @ read)
            of.append(v)
    order = [np.arange(v * each, (v + 1) * each) for v in range(vehicles)]
    return truth, (Informed(np.array(information), np.array(vector), np.array(of), vehicles), order, [x] * vehicles)


def test_the_interval_of_a_date_holds():
    within, found, widths = 0, 0, []
    for seed in range(12):
        truth, given = moving(seed, lambda rng, n: 0.25 * (np.arange(n) >= rng.integers(3, n - 3)))
        for change in drifted(*given).changes:
            if change.drifts and change.kind == "step" and change.vehicle < 4:
                at = int(np.flatnonzero(truth[change.vehicle])[0])
                found += 1
                assert change.earliest <= change.at <= change.latest
                within += change.earliest <= at <= change.latest
                widths.append(change.latest - change.earliest)
    assert found >= 25
    assert within >= 0.9 * found
    assert np.mean(widths) < 4  # of sixteen recordings


def test_a_walk_is_found_and_followed():
    kinds, held, found, left = [], 0, 0, []
    for seed in range(4):
        truth, given = moving(seed, lambda rng, n: np.append(0.0, np.cumsum(rng.normal(0.0, 0.12, n - 1))))
        both = drifted(*given)
        assert not any(own.drifts and own.vehicle >= 4 for own in both.changes)
        for own in both.changes:
            if own.drifts and own.parameter == 1:
                kinds.append(own.kind)
                found += 1
                near = abs(own.change - truth[own.vehicle][-1]) < 1.96 * np.sqrt(own.variance)
                held += own.kind == "walk" and near
                left.append(np.std(own.moved - truth[own.vehicle]) / np.std(truth[own.vehicle]))
    assert found >= 13
    assert np.mean(left) < 0.4
    assert kinds.count("walk") >= 0.7 * found
    assert held >= 0.85 * kinds.count("walk")


@pytest.mark.parametrize("weights", [[1.0], [1.0, 1.0, 1.0], [5.0, 1.0, 0.1], [3.0, 2.0, 1.0, 0.5, 0.2]])
def test_tails_of_sums_of_squares_are_near_what_is_drawn(weights):
    drawn = np.sum(np.array(weights) * np.random.default_rng(1).normal(size=(400_000, len(weights))) ** 2, axis=1)
    for share in (0.01, 0.001):
        assert _tail(np.sort(weights), float(np.quantile(drawn, 1 - share))) == pytest.approx(share, rel=0.2)
