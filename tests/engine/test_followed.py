"""One trajectory from row to row, set back to readings: as simulated row by row."""

import casadi as cs
import numpy as np
import pytest
from compiled import needs_compiler

from greybox_id.engine.kernel import Kernel

ROWS = 60
both_ways = pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_compiler)])


def kernel(compiled):
    """Two states that act on each other."""
    z, s, p = cs.SX.sym("z", 2), cs.SX.sym("s"), cs.SX.sym("p")
    step = cs.Function("step", [z, s, p], [cs.vertcat(0.9 * z[0] + s, cs.sin(z[0]) + p * s)])
    return Kernel(step, cs.Function("read", [z, s, p], [z]), compiled=compiled)


def drive(seed=0):
    """Numbers of segments, parameters, where rows begin (none, one or three segments each), and what is given."""
    random = np.random.default_rng(seed)
    begins = np.concatenate(([0], np.cumsum(random.choice([0, 1, 3], ROWS - 1))))
    return random.standard_normal((begins[-1] + 2, 1)), random.random(1), begins, random.standard_normal((ROWS, 2))


def row_by_row(made, s, p, begins, z, given, complete):
    z = z.copy()
    for row in range(1, ROWS):
        own = s[None, begins[row - 1] : begins[row]]
        led, _ = made.simulate(z[row - 1 : row], own, p, np.zeros(own.shape[1], dtype=bool))
        z[row] = np.where(complete[row] & given, z[row], led[0, -1])
    return z


@both_ways
@pytest.mark.parametrize("given", [(True, False), (False, True), (True, True), (False, False)])
@pytest.mark.parametrize("share", [0.0, 0.7, 1.0])
def test_it_is_what_a_simulation_of_each_row_gives(given, share, compiled):
    made, (s, p, begins, z) = kernel(compiled), drive()
    complete = np.random.default_rng(1).random(ROWS) < share
    expected = row_by_row(made, s, p, begins, z, np.array(given), complete)
    assert np.array_equal(made.followed(s, p, begins, z.copy(), given, complete), expected)


@both_ways
def test_rows_that_do_not_match_are_refused(compiled):
    made, (s, p, begins, z), complete = kernel(compiled), drive(), np.ones(ROWS, dtype=bool)
    for wrong in (
        (begins[1:], z, [True, False], complete),
        (begins, z, [True], complete),
        (begins, z, [True, False], complete[1:]),
        (begins[::-1], z, [True, False], complete),
        (begins + 3, z, [True, False], complete),
    ):
        with pytest.raises(ValueError, match="do not match"):
            made.followed(s, p, *wrong)
