"""Functions of many samples: numpy's operations give what CasADi's virtual machine gives."""

import casadi as cs
import numpy as np
import pytest

from greybox_id.engine.virtual import BLOCK, SIDE_BY_SIDE, SampledFunction

x, y, p = cs.SX.sym("x"), cs.SX.sym("y"), cs.SX.sym("p", 2)
EXPRESSIONS = {
    "arithmetic": [x + y, x - y, x * y, x / y, -x, x * x, 2 * x, 1 / x, cs.sqrt(x), x**3, x**2.5, x**y, p[0] * x + 3.0],
    "tests": [x < y, x <= y, x == y, x != y, cs.logic_not(x), cs.logic_and(x, y), cs.logic_or(x, y)],
    "sums of tests": [(x < y) + (x < 2 * y), (x < y) - (y < x), -(x < y)],
    "cases": [cs.if_else(x > y, x, cs.sin(y)), cs.if_else(p[1] > 0, x, y), cs.fmin(x, y), cs.fmax(x, y), cs.sign(x)],
    "rounding": [cs.fabs(x), cs.copysign(x, y), cs.floor(x), cs.ceil(x), cs.fmod(x, y), cs.hypot(x, y)],
    "circular": [cs.sin(x), cs.cos(x), cs.tan(x), cs.asin(x), cs.acos(x), cs.atan(x), cs.atan2(x, y)],
    "hyperbolic": [cs.sinh(x), cs.cosh(x), cs.tanh(x), cs.asinh(x), cs.acosh(x), cs.atanh(x)],
    "exponential": [cs.exp(x), cs.log(x), cs.expm1(x), cs.log1p(x)],
    "other": [cs.erf(x), cs.remainder(x, y)],  # not in numpy as CasADi has it
    "arguments": [x, p[1], cs.SX(4.0)],
}


@pytest.mark.parametrize("kind", EXPRESSIONS)
@pytest.mark.parametrize("rows", [BLOCK + 1, 3 * SIDE_BY_SIDE // 2])
def test_many_samples_side_by_side_give_what_few_give(kind, rows):
    function = cs.Function("several", [cs.vertcat(x, y), p], [cs.densify(cs.vertcat(*EXPRESSIONS[kind]))])
    samples = np.random.default_rng(0).uniform(-3.0, 3.0, (rows, 2))
    samples[:6] = [[0.0, 1.0], [1.0, 0.0], [2.0, 2.0], [np.nan, 1.0], [1.0, np.nan], [np.inf, -np.inf]]
    given = np.array([0.7, -1.3])
    several = SampledFunction(function)
    few = np.vstack([several(samples[k : k + 50], given) for k in range(0, rows, 50)])
    np.testing.assert_allclose(several(samples, given), few, rtol=1e-14, atol=1e-15)
