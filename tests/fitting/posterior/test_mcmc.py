"""What chains draw from, and steps towards the middle, against what is known in closed form."""

import numpy as np
import pytest

from greybox_id.fitting.posterior.density import DrawnNumber, Target
from greybox_id.fitting.posterior.mcmc import BURN_IN, FORGET, TAIL, Ensemble, TowardsMiddle, begun, middle, moved

COUNTED = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.02], [0.0, 0.02, 0.25]])


class Normal:
    """A density of two lengths and an angle, normal about a centre."""

    centre = np.array([2.0, 1.0, 0.0])
    bounds = (np.array([-50.0, -50.0, -50.0]), np.array([50.0, 50.0, 50.0]))
    coordinates = tuple(DrawnNumber(name, unit, name) for name, unit in (("a", "m"), ("b", "m"), ("c", "rad")))

    def __call__(self, points):
        off = points - self.centre
        return -0.5 * np.einsum("ni,ij,nj->n", off, np.linalg.inv(COUNTED), off)

    def within(self, points):
        return np.all((points >= self.bounds[0]) & (points <= self.bounds[1]), axis=1)


@pytest.mark.parametrize("grown", [1.0, 4.0])
def test_it_is_as_wide_as_the_covariance_that_lasting_errors_widen(grown):
    """Along one direction lasting errors make it wider, along the others they would make it narrower, and do not."""
    along = np.array([1.0, -1.0, 0.5])
    lasting = 0.5 * COUNTED + grown * np.outer(along, along) * 0.5
    target = Target(Normal(), COUNTED, lasting)
    rng = np.random.default_rng(0)
    off = rng.standard_normal((50, 3))
    whole = target.factor @ target.factor.T
    own = -0.5 * np.einsum("ni,ij,nj->n", off, np.linalg.inv(whole), off)
    assert target(target.centre + off) == pytest.approx(own, rel=1e-6)
    for wider in (whole - COUNTED, whole - lasting):
        assert np.min(np.linalg.eigvalsh(wider)) > -1e-9
    same = Target(Normal(), COUNTED, COUNTED)
    assert same.factor @ same.factor.T == pytest.approx(COUNTED, abs=1e-8)


def test_steps_towards_the_middle_leave_a_t_distribution_as_it_is():
    factor = np.array([[1.0, 0.0], [0.7, 0.5]])
    move, random = TowardsMiddle(np.array([1.0, -1.0]), factor), np.random.RandomState(0)
    rng = np.random.default_rng(1)

    def far(at):
        return np.sum(((at - move.centre) @ move.inverse.T) ** 2, axis=1)

    count = 40000
    at = (
        move.centre + (rng.standard_normal((count, 2)) * np.sqrt(TAIL / rng.chisquare(TAIL, count))[:, None]) @ factor.T
    )
    before = np.quantile(far(at), [0.1, 0.5, 0.9, 0.99])
    for _ in range(5):
        other, correction = move(at, random)
        density = -0.5 * (TAIL + 2) * (np.log1p(far(other) / TAIL) - np.log1p(far(at) / TAIL))
        assert density + correction == pytest.approx(np.zeros(count), abs=1e-9)  # every step is accepted
        at = other
    assert np.quantile(far(at), [0.1, 0.5, 0.9, 0.99]) == pytest.approx(before, rel=0.06)
    assert np.mean(at, axis=0) == pytest.approx(move.centre, abs=0.03)


def test_the_middle_is_what_the_burn_in_was_like():
    target = Target(Normal(), COUNTED, COUNTED)
    rng = np.random.default_rng(2)
    burnt = np.array([3.0, 0.0, 1.0]) + 2.0 * rng.standard_normal((BURN_IN, 400, 3)) @ target.factor.T
    own = middle(target, Ensemble(BURN_IN, burnt[-1], np.zeros(400), 0, 0, burnt))
    assert own.centre == pytest.approx([3.0, 0.0, 1.0], abs=0.05)
    assert own.factor @ own.factor.T == pytest.approx(4.0 * COUNTED, rel=0.1, abs=0.01)
    early = middle(target, Ensemble(FORGET, burnt[0], np.zeros(400), 0, 0, burnt[:FORGET]))
    assert np.array_equal(early.centre, target.centre)


def test_chains_draw_from_the_density():
    target = Target(Normal(), COUNTED, COUNTED)
    kept = []

    def until(own):
        kept.append(own.at)
        return own.block == 300

    moved(target, begun(target, 3), 3, until)
    drawn = target.to_theta(np.concatenate(kept[BURN_IN:]))
    assert np.mean(drawn, axis=0) == pytest.approx(Normal.centre, abs=0.05)
    assert np.cov(drawn.T) == pytest.approx(COUNTED, rel=0.15, abs=0.01)
