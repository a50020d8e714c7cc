"""Changes of vehicles are found, dated and sized; steady fleets stay so."""

import numpy as np

from greybox_id.fleet.drift import drifted
from greybox_id.fleet.hierarchy import Informed


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
    changes = [own for own in drifted(Informed(seen.information, vector, seen.vehicle, seen.vehicles), order, x).changes
               if own.drifts and own.vehicle == 0]  # fmt: skip
    assert {own.parameter for own in changes} >= {0, 2}


def test_a_vehicle_of_few_recordings_is_not_tested():
    seen, order, x = fleet(1, vehicles=3, each=3)
    assert drifted(seen, order, x).changes == ()
