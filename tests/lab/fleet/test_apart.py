"""Recordings whose estimate belongs to another optimum are set apart; changes and other vehicles are not."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from greybox_lab.fleet.drift import drifted
from greybox_lab.fleet.hierarchy import Informed, population
from greybox_lab.fleet.joined import spared, strangers


def fleet(seed, vehicles=12, each=8, size=3, wrong=(), shifted=(), step=0.0):
    """Half poorly excited; `wrong` lie six off with a narrow interval, `shifted` vehicles as a whole, 0 steps."""
    rng = np.random.default_rng(seed)
    truth = rng.normal(0.0, 0.1, (vehicles, size))
    truth[list(shifted)] += 3.0
    information, vector, of = [], [], []
    for v in range(vehicles):
        for r in range(each):
            sd = 0.02 * (rng.uniform(3, 10) if r % 2 else 1.0)
            own = sd**2 * (np.eye(size) + 0.4)
            at = truth[v] + 0.01 * rng.normal(size=size) + step * np.eye(size)[2] * (v == 0 and r >= each // 2)
            if (v, r) in wrong:
                at, own = at - 6.0 * np.eye(size)[0], np.eye(size) * 0.02**2
            information.append(np.linalg.inv(own))
            vector.append(information[-1] @ rng.multivariate_normal(at, own))
            of.append(v)
    seen = Informed(np.array(information), np.array(vector), np.array(of), vehicles)
    order = [np.arange(v * each, (v + 1) * each) for v in range(vehicles)]
    return truth, seen, order, [np.linspace(0, 1, each)] * vehicles


WRONG = {(1, 1), (1, 5), (4, 3), (7, 7)}


@pytest.mark.parametrize("seed", range(3))
def test_other_optima_are_set_apart_and_move_nothing(seed):
    truth, seen, order, x = fleet(seed, wrong=WRONG)
    found = drifted(seen, order, x)
    assert {(int(j) // 8, int(j) % 8) for j in np.flatnonzero(found.apart)} == WRONG
    assert not any(change.drifts for change in found.changes)
    _, clean, _, _ = fleet(seed)
    assert np.max(np.abs(found.population.vehicle - truth)) < 0.06
    assert np.allclose(found.population.spread, population(clean).spread, rtol=0.1)
    spoilt = population(seen)
    assert np.abs(spoilt.vehicle - truth).max() > 5 * np.abs(found.population.vehicle - truth).max()


def test_a_fleet_without_has_none_apart():
    count = sum(int(drifted(*fleet(seed)[1:]).apart.sum()) for seed in range(20))
    assert count <= 4  # one fleet in twenty has one or more: 1 expected


def test_a_vehicle_that_lies_apart_as_a_whole_keeps_its_recordings():
    truth, seen, order, x = fleet(5, shifted=(3,))
    found = drifted(seen, order, x)
    assert not found.apart.any()
    assert np.allclose(found.population.vehicle[3], truth[3], atol=0.06)


def test_a_large_step_is_a_change_and_sets_nothing_apart():
    _, seen, order, x = fleet(6, each=10, step=1.0)
    found = drifted(seen, order, x)
    changes = [change for change in found.changes if change.drifts]
    assert [(change.vehicle, change.parameter, change.kind, change.at) for change in changes] == [(0, 2, "step", 5)]
    assert not found.apart.any()


def test_few_recordings_are_held_against_the_fleet():
    _, seen, _, _ = fleet(7, vehicles=20, each=2, wrong={(4, 0)})
    assert np.flatnonzero(strangers(seen)).tolist() == [8]


@settings(max_examples=15)
@example(seed=391, unit=1e-6)
@given(seed=st.integers(0, 10_000), unit=st.sampled_from([1e-6, 1e-2, 1e3, 1e7]))
def test_units_and_order_of_recordings_are_all_one(seed, unit):
    _, seen, order, x = fleet(seed, vehicles=5, each=5, wrong={(1, 1)})
    scale = np.array([1.0, unit, 1.0])
    other = Informed(
        seen.information / np.outer(scale, scale), seen.vector / scale, seen.vehicle, seen.vehicles
    )  # of a parameter in another unit
    one, two = drifted(seen, order, x), drifted(other, order, x)
    assert np.array_equal(one.apart, two.apart)
    assert np.allclose(one.today * scale, two.today, rtol=1e-3, atol=1e-3 * np.abs(scale) * 0.1)
    shuffled = np.random.default_rng(seed).permutation(len(seen.vector))
    back = np.argsort(shuffled)
    three = drifted(
        Informed(seen.information[shuffled], seen.vector[shuffled], seen.vehicle[shuffled], seen.vehicles),
        [back[rows] for rows in order], x,
    )  # fmt: skip
    assert np.array_equal(one.apart, three.apart[back])
    assert np.allclose(one.today, three.today, atol=1e-6)


def test_a_parameter_that_only_one_recording_informs_is_not_lost():
    _, seen, _, _ = fleet(8, vehicles=3, each=4)
    information = seen.information.copy()
    information[1:, 0, :] = information[1:, :, 0] = 0.0
    alone = Informed(information, seen.vector, seen.vehicle, seen.vehicles)
    apart = np.zeros(len(seen.vector), dtype=bool)
    apart[[0, 3]] = True
    assert np.flatnonzero(spared(alone, apart)).tolist() == [3]
