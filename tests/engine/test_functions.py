"""Functions in line: within two units in the last place over all numbers, whatever the processor has."""

import platform

import casadi as cs
import numpy as np
import pytest
from compiled import needs_compiler
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from polynomials import as_c

from greybox_id.engine.kernel import Kernel
from greybox_id.engine.vectors import c_of

UNARY = ["sin", "cos", "exp", "tanh", "atan"]
AT = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, -2.2e-308, 1e-160, 1e300, -1.7e308, 9.9e8, 1.1e9, 1e22]
AT += [
    np.pi / 4,
    np.pi / 2,
    np.pi,
    355.0,
    2**0.5 - 1,
    2**0.5 + 1,
    19.9,
    20.1,
    0.34,
    -708.1,
    -745.1,
    -746.1,
    709.7,
    709.8,
]
PLAIN = "cc -mno-avx512f"
PROCESSORS = ["", PLAIN, f"{PLAIN} -mno-avx2", f"{PLAIN} -mno-fma"]
"""As it is; vectors of four and of two; no fused operation, so that a library is called."""

numbers = st.floats() | st.floats(-50, 50) | st.floats(-1e10, 1e10) | st.sampled_from(AT)


@pytest.fixture(scope="module", params=PROCESSORS)
def evaluated(request, tmp_path_factory):
    """(n, 2) numbers -> (n, 6), the functions of the first, and atan2 of both."""
    if request.param and platform.machine() != "x86_64":
        pytest.skip("flags of another processor")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("GREYBOX_CACHE", str(tmp_path_factory.mktemp("libraries")))
        if request.param:
            patched.setenv("CC", request.param)
        z, s, p = (cs.SX.sym(letter, count) for letter, count in (("z", 2), ("s", 0), ("p", 0)))
        y = cs.vertcat(*[getattr(cs, name)(z[0]) for name in UNARY], cs.atan2(z[0], z[1]))
        made = Kernel(*(cs.Function("f", [z, s, p], [result]) for result in (z * 1, y)), compiled=True)

        def run(values):
            return made.simulate(values, np.empty((len(values), 1, 0)), np.empty(0), [True])[1][:, 0]

        run(np.zeros((1, 2)))
    return run, 4 if "fma" in request.param else 2


@needs_compiler
@given(arrays(float, (11, 2), elements=numbers))
@example(np.array([[a, b] for a in AT for b in AT]))
def test_two_units_in_the_last_place_over_all_numbers(evaluated, values):
    run, units = evaluated
    exact = values.astype(np.longdouble)
    with np.errstate(all="ignore"):
        expected = [*(getattr(np, name.replace("atan", "arctan"))(exact[:, 0]) for name in UNARY), np.arctan2(*exact.T)]
        for name, found, true in zip([*UNARY, "atan2"], run(values).T, expected, strict=True):
            nearest = true.astype(float)
            same = (found == nearest) | (np.isnan(found) & np.isnan(nearest))
            off = np.where(same, 0, np.abs(found - true) / np.spacing(np.abs(nearest)))
            assert np.all(off <= units), (name, values[~(off <= units)])


@needs_compiler
@given(arrays(float, 8, elements=numbers))
def test_a_lane_knows_nothing_of_the_others(evaluated, values):
    run, _ = evaluated
    pairs = np.column_stack([values, values[::-1]])
    whole = run(pairs)
    for k in range(len(pairs)):
        np.testing.assert_array_equal(run(np.repeat(pairs[k : k + 1], 8, axis=0))[0], whole[k])


def test_coefficients_are_those_that_are_derived():
    lines = c_of("functions").splitlines()
    assert all(line in lines for line in as_c().splitlines())
    defined = [line.split()[1] for line in lines if line.startswith("#define") and "0x1." in line]
    assert defined == [line.split()[1] for line in as_c().splitlines()]
