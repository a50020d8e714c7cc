"""Eliminating what a short piece tells changes nothing about the rest."""

import numpy as np
import pytest
import scipy.sparse as sp
from linear_problem import Linear

from greybox_id.fitting.uncertainty import sandwich


def predictions(rng, pieces=80, rows=15):
    """Short predictions: two parameters that all pieces share, two starts of each piece's own that fade."""
    fading = np.exp(-np.arange(rows) / 4.0)
    y, J, index = [], [], []
    for k in range(pieces):
        own = np.zeros((rows, 1, 4))
        own[:, 0, :2] = 0.3 + np.cumsum(rng.standard_normal((rows, 2)), axis=0) / 5.0
        own[:, 0, 2], own[:, 0, 3] = fading, fading**2
        J.append(own)
        y.append(rng.standard_normal((rows, 1)) + own @ np.array([1.0, -1.0, *rng.standard_normal(2)]))
        index.append(np.array([0, 1, 2 + 2 * k, 3 + 2 * k]))
    return y, J, index


@pytest.mark.parametrize("believed", [False, True])
def test_eliminating_the_starts_of_short_predictions_changes_nothing(monkeypatch, believed):
    y, J, index = predictions(np.random.default_rng(7))
    R = sp.diags([0.5] * 162).tocsr()[[0, 2, 3, 9]] if believed else None
    problem = Linear(y, J, R, index)
    short = problem.told()
    assert short.blocks == 40  # of two pieces each
    monkeypatch.setattr(sandwich, "LOCAL", 0.0)
    monkeypatch.setattr(sandwich, "LONGER", np.inf)
    monkeypatch.setattr(sandwich, "FEWEST", short.blocks)  # the same blocks
    full = problem.told()
    assert full.blocks == short.blocks
    np.testing.assert_allclose(short.independent, full.independent, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(short.covariance[:2, :2], full.covariance[:2, :2], rtol=1e-3)
    np.testing.assert_allclose(short.dof[:2], full.dof[:2], rtol=1e-3)


def test_the_start_of_a_short_prediction_is_as_uncertain_as_its_few_rows_leave_it():
    rng = np.random.default_rng(8)
    y, J, index = predictions(rng)
    told = Linear(y, J, index=index).told()
    np.testing.assert_allclose(told.sd[2:], np.sqrt(np.diag(told.independent))[2:], rtol=0.15)  # the noise has sd 1
    assert np.all((told.dof[2:] >= 1.0) & (told.dof[2:] <= 15.0))


@pytest.mark.parametrize("rows", [3, 8])
def test_leverages_follow_from_rows_as_from_products_and_are_none_without_rows(rows):
    J, U = np.random.default_rng(rows).standard_normal((rows, 5)) / 9.0, np.eye(5)
    of_rows = sandwich.Blocks(np.ones(5, bool), np.zeros((1, 5, 5)), [(0, J)], *[np.zeros(0)] * 6, 0.0, 1.0, 1.0)
    products = np.stack([J.T @ J, np.zeros((5, 5))])
    of_products = sandwich.Blocks(np.ones(5, bool), products, [], *[np.zeros(0)] * 6, 0.0, 1.0, 1.0)
    for block in (0, 1):
        (share, Q), (every, P) = (each.leverages(block, np.ones(5, bool), U) for each in (of_rows, of_products))
        np.testing.assert_allclose((Q * share) @ Q.T, (P * every) @ P.T, atol=1e-12)
        np.testing.assert_allclose((P * every) @ P.T, products[block], atol=1e-12)
