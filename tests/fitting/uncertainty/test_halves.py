"""Parts of a drive differ by more than its blocks do, or they do not: an F test whose chances are as stated."""

import numpy as np
import pytest

from greybox_id.fitting.uncertainty.halves import BLOCKS, OTHERS, Deviations, _contrasts

PARAMETERS = 5


def deviations(rng, scatter=1.0, change=0.0, first=4):
    """Blocks of 200 readings of five parameters, whose own deviations are noise `scatter` times as large as stated."""
    functions = rng.standard_normal((BLOCKS * 200, 3))
    J = rng.standard_normal((BLOCKS * 200, PARAMETERS))
    block = np.repeat(np.arange(BLOCKS), 200)
    moved = scatter * rng.standard_normal((BLOCKS, PARAMETERS)) / np.sqrt(200)
    moved[first:] += change
    residuals = np.sum(J * moved[block], axis=1) + functions @ [0.3, 0.0, -0.2]
    later = [J * (block == k)[:, None] for k in range(1, BLOCKS)]
    table = np.hstack([J, functions, *later])
    return Deviations.of(table.T @ table, table.T @ residuals, np.ones(3), np.full(PARAMETERS, 1.0))


@pytest.mark.parametrize("first", [1, 2, 4, 6])
def test_contrasts_are_orthonormal_and_the_first_is_between_the_parts(first):
    table = np.array(_contrasts(range(first)))
    np.testing.assert_allclose(table @ table.T, np.eye(BLOCKS - 1), atol=1e-12)
    np.testing.assert_allclose(table @ np.ones(BLOCKS), 0.0, atol=1e-12)
    assert np.ptp(table[0, :first]) == np.ptp(table[0, first:]) == 0.0


@pytest.mark.parametrize("scatter", [1.0, 3.0])
def test_parts_of_one_vehicle_are_told_apart_as_seldom_as_stated_however_much_its_blocks_scatter(scatter):
    rng = np.random.default_rng(11)
    chances = np.array([deviations(rng, scatter).chance(range(4)) for _ in range(400)])
    assert 0.02 < np.mean(chances < 0.05) < 0.09
    assert 0.42 < np.mean(chances < 0.5) < 0.58


@pytest.mark.parametrize("first", [*OTHERS, 4])
def test_a_change_is_told_where_it_is(first):
    rng = np.random.default_rng(12)
    chances = {k: deviations(np.random.default_rng(12), 2.0, 0.6, first).chance(range(k)) for k in (*OTHERS, 4)}
    assert min(chances, key=lambda k: chances[k]) == first
    assert chances[first] < 1e-4
    assert deviations(rng, 2.0).chance(range(first)) > 0.01


def test_a_block_of_its_own_is_told_from_the_others():
    found = deviations(np.random.default_rng(13))
    assert found.chance([5]) > 0.01
    lone = deviations(np.random.default_rng(13), change=0.6, first=7)
    assert lone.chance([7]) < 1e-4
    assert lone.chance([7]) < lone.chance(range(4))


def test_parameters_that_nothing_shows_differ_in_no_part():
    nothing = Deviations(np.zeros((14, 14)), np.zeros(14), np.ones(2))
    assert nothing.chance(range(4)) == 1.0
