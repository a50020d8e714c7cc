"""Simulations from elsewhere, of which a part is known: lanes end where they meet what they were before."""

import casadi as cs
import numpy as np
import pytest
from compiled import needs_compiler

from greybox_id.engine.kernel import Kernel, KnownSimulation

SEGMENTS, LANES = 400, 21
both_ways = pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_compiler)])


def kernel(share, compiled):
    """Two states: one keeps such a share of itself in each segment, the other remembers nothing; both are read."""
    z, s, p = cs.SX.sym("z", 2), cs.SX.sym("s"), cs.SX.sym("p")
    step = cs.Function("step", [z, s, p], [cs.vertcat(share * z[0] + s, p * s)])
    return Kernel(step, cs.Function("read", [z, s, p], [z]), compiled=compiled)


def given(seed=0):
    """Numbers, parameters, where it is read, and where states are kept."""
    random = np.random.default_rng(seed)
    keeps = np.arange(SEGMENTS + 1) % 20 == 0
    return random.standard_normal((LANES, SEGMENTS, 1)), random.random((LANES, 1)), np.arange(SEGMENTS) % 3 == 1, keeps


def starts(moved=()):
    """Where lanes begin, those that are named elsewhere."""
    result = np.random.default_rng(1).standard_normal((LANES, 2))
    result[list(moved), 0] += 0.1
    return result


@both_ways
@pytest.mark.parametrize("share", [0.5, 0.9, 1.0])
@pytest.mark.parametrize("moved", [(), (0,), range(3, 12), range(LANES)])
def test_from_elsewhere_it_is_what_a_simulation_from_there_gives(share, moved, compiled):
    made, near = kernel(share, compiled), np.full(2, 1e-12)
    known = KnownSimulation(made.simulate(starts(), *given()), near)
    found, afresh = made.simulate(starts(moved), *given(), known), made.simulate(starts(moved), *given())
    for one, other in zip(found, afresh, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=2e-12)


@needs_compiler
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_what_was_forgotten_is_not_simulated_again(share):
    """After 60 segments 0.5 of a start is below 1e-12; what keeps all of it is simulated to the end."""
    made = kernel(share, True)
    z, y = made.simulate(starts(), *given())
    y[:, -1] = np.nan
    _, y = made.simulate(starts(range(LANES)), *given(), KnownSimulation((z, y), np.full(2, 1e-12)))
    assert np.isnan(y[:, -1]).all() == (share < 1.0)
    assert np.isfinite(y[:, :-1]).all()


@needs_compiler
def test_lanes_that_begin_where_they_did_are_left_alone():
    made, moved = kernel(1.0, True), [4, 17]
    z, y = made.simulate(starts(), *given())
    y[:] = np.nan
    _, y = made.simulate(starts(moved), *given(), KnownSimulation((z, y), np.zeros(2)))
    assert np.flatnonzero(np.isfinite(y).all(axis=(1, 2))).tolist() == moved
    assert np.isnan(np.delete(y, moved, axis=0)).all()


@needs_compiler
def test_where_beginnings_were_not_kept_all_lanes_are_simulated():
    made, (s, p, reads, keeps) = kernel(0.5, True), given()
    keeps[0] = False
    known = KnownSimulation(made.simulate(starts(), s, p, reads, keeps), np.full(2, 1e-12))
    for one, other in zip(
        made.simulate(starts(range(LANES)), s, p, reads, keeps, known),
        made.simulate(starts(range(LANES)), s, p, reads, keeps),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=2e-12)


@needs_compiler
def test_a_start_that_is_no_number_meets_nothing():
    made = kernel(0.5, True)
    known = KnownSimulation(made.simulate(starts(), *given()), np.full(2, 1e-12))
    z0 = starts()
    z0[5, 0] = np.nan
    z, y = made.simulate(z0, *given(), known)
    assert np.isnan(z[5, :, 0]).all()
    assert np.isnan(y[5, :, 0]).all()
    assert np.isfinite(np.delete(y, 5, axis=0)).all()


@needs_compiler
def test_what_is_known_must_be_of_the_same_call():
    made, (s, p, reads, keeps) = kernel(0.5, True), given()
    z, y = made.simulate(starts(), s, p, reads, keeps)
    for known in (
        KnownSimulation((z[:, 1:], y), np.zeros(2)),
        KnownSimulation((z, y[:, 1:]), np.zeros(2)),
        KnownSimulation((z, y), np.zeros(3)),
    ):
        with pytest.raises(ValueError, match="known"):
            made.simulate(starts(), s, p, reads, keeps, known)
