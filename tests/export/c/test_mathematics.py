"""Elementary functions against the C library's, in units of the last place."""

import ctypes

import numpy as np
import pytest
from compiled import compiled

from greybox_id.export.c.functions import INLINE
from greybox_id.export.c.mathematics import ATAN_END, FUNCTIONS, PER_UNIT, atan_polynomials, definitions

HEAD = "#include <math.h>\n#include <stdint.h>\n#include <string.h>\n"
ONE = "void many_{0}(const double *x, double *y, int n);\nvoid many_{0}(const double *x, double *y, int n)\n" \
    "{{ int k; for (k = 0; k < n; k++) y[k] = own_{0}(x[k]); }}\n"  # fmt: skip
TWO = "void many_{0}(const double *a, const double *b, double *y, int n);\n" \
    "void many_{0}(const double *a, const double *b, double *y, int n)\n" \
    "{{ int k; for (k = 0; k < n; k++) y[k] = own_{0}(a[k], b[k]); }}\n"  # fmt: skip
BOTH = "void many_sincos(const double *x, double *s, double *c, int n);\n" \
    "void many_sincos(const double *x, double *s, double *c, int n)\n" \
    "{ int k; for (k = 0; k < n; k++) own_sincos(x[k], &s[k], &c[k]); }\n"  # fmt: skip
SINGLE, PAIRED = ("atan", "sin", "cos", "tanh", "sign"), ("atan2", "fmin", "fmax")
NUMPY = {"atan": np.arctan, "atan2": np.arctan2, "fmin": np.fmin, "fmax": np.fmax, "sign": np.sign}


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mathematics")
    programs = [ONE.format(name) for name in SINGLE] + [TWO.format(name) for name in PAIRED] + [BOTH]
    (folder / "all.c").write_text("\n".join([HEAD, INLINE, definitions(FUNCTIONS), *programs]))
    return ctypes.CDLL(str(compiled([folder / "all.c"], folder / "all.so", "-shared", "-fPIC")))


def evaluated(library, name, *given):
    results = [np.empty_like(given[0]) for _ in range(2 if name == "sincos" else 1)]
    places = [ctypes.c_void_p(array.ctypes.data) for array in (*given, *results)]
    getattr(library, f"many_{name}")(*places, ctypes.c_int(len(given[0])))
    return results


def arguments(seed=0, count=200_000):
    """Of every size, of both signs, and those where something changes."""
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-12, 3, count)
    edges = [0.0, -0.0, 0.5 / 32, ATAN_END, np.nextafter(ATAN_END, 0), 3.0, np.nextafter(3.0, 0), 20.0, 1e300, 5e-324]
    usual = rng.uniform(-5, 5, count)
    return np.concatenate([sizes * rng.choice([-1, 1], count), usual, edges, np.negative(edges)])


@pytest.mark.parametrize("name", SINGLE)
def test_a_function_of_one_number_is_right_to_four_units_in_the_last_place(library, name):
    x = arguments()
    (found,) = evaluated(library, name, x)
    true = NUMPY.get(name, getattr(np, name, None))(x)
    unit = np.spacing(np.maximum(np.abs(true), 1.0 if name in ("sin", "cos") else 5e-324))
    assert np.max(np.abs(found - true) / unit) <= 4


@pytest.mark.parametrize("name", PAIRED)
def test_a_function_of_two_numbers_is_right_in_every_quadrant(library, name):
    rng = np.random.default_rng(1)
    a, b = rng.permutation(arguments(2)), rng.permutation(arguments(3))
    (found,) = evaluated(library, name, a, b)
    true = NUMPY[name](a, b)
    assert np.max(np.abs(found - true) / np.spacing(np.maximum(np.abs(true), 1e-290))) <= 5


def test_sine_and_cosine_together_are_those_alone(library):
    x = arguments()
    sine, cosine = evaluated(library, "sincos", x)
    np.testing.assert_array_equal(sine, evaluated(library, "sin", x)[0])
    np.testing.assert_array_equal(cosine, evaluated(library, "cos", x)[0])


@pytest.mark.parametrize("name", ["atan", "sin", "cos", "tanh", "sign"])
def test_what_is_not_finite_is_what_the_c_library_says(library, name):
    x = np.array([np.nan, np.inf, -np.inf])
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(evaluated(library, name, x)[0], NUMPY.get(name, getattr(np, name, None))(x))


def test_the_other_number_is_taken_where_one_is_not_a_number(library):
    a, b = np.array([np.nan, 1.0, np.nan]), np.array([2.0, np.nan, np.nan])
    for name in ("fmin", "fmax"):
        np.testing.assert_array_equal(evaluated(library, name, a, b)[0], [2.0, 1.0, np.nan])


def test_polynomials_meet_where_one_ends_and_the_next_begins():
    rows = atan_polynomials()
    half = 0.5 / PER_UNIT
    ends, begins = rows @ half ** np.arange(8), rows @ (-half) ** np.arange(8)
    np.testing.assert_allclose(ends[:-1], begins[1:], rtol=1e-15, atol=0)
