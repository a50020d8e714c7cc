"""Elementary functions in C: those of a vehicle's equations that a C library is slow at.

A step of a single-track vehicle asks 38 times for atan, atan2, sin, cos or tanh, each of which waits for the one
before: what counts is how long one takes from argument to result. These here look up polynomials (atan) or an angle
beside the one asked for (sine and cosine) and take half as long as the C library's; compiled into the code that asks
for them, the processor works on both axles at once. Their errors are below five units in the last place, of one for
sine and cosine (tests/export/c/test_mathematics.py); what lies beyond their tables is left to the C library.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from ...base.shorthands import Array

PER_UNIT = 32
"""Entries of the tables per unit of the argument; a power of two."""
FAR = "0x1p47"
"""2^52 / PER_UNIT: numbers from there to twice that are so far apart as the tables' entries."""
ATAN_END, ANGLE_END = 4, 3
"""Where the tables end. An angle of pi, where the sine has to be exact to many digits, is not among them."""
DEGREE = 7
TAYLOR = 24
"""Degrees of the polynomials of atan, and of the series that they are made from."""


@dataclass(frozen=True)
class Function:
    """A function in C.

    Attributes
    ----------
    text : its definition.
    needs : names of those it calls.
    """

    text: str
    needs: tuple[str, ...] = ()


EXACT = """#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST)
#error "The tables here need sums taken in the order in which they stand: no -ffast-math, -Ofast or /fp:fast."
#elif defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "What is not finite has to stay so: no -ffinite-math-only."
#endif
"""
"""Stops compilers that were told to compute something else than what is written: results would be off by a factor."""


def definitions(names: Iterable[str]) -> str:
    """C of the functions named, and of what they need."""
    result: dict[str, str] = {}

    def add(name: str) -> None:
        for other in FUNCTIONS[name].needs:
            add(other)
        result.setdefault(name, FUNCTIONS[name].text)

    for name in sorted(set(names)):
        add(name)
    return "\n".join(result.values())


def atan_polynomials() -> Array:
    """(entries, DEGREE + 1) coefficients of atan about k / PER_UNIT, lowest power first, of what x is beyond it.

    Each is its Taylor series economised on the half entry to both sides; about zero the series itself, which is odd,
    so that small arguments keep all their digits.
    """
    rows = []
    for c in np.arange(ATAN_END * PER_UNIT + 1) / PER_UNIT:
        k = np.arange(1, TAYLOR + 1)
        series = np.concatenate([[np.arctan(c)], -((-1.0) ** k) * ((c - 1j) ** -k).imag / k]) / (
            2.0 * PER_UNIT
        ) ** np.arange(TAYLOR + 1)
        if c > 0:
            series = chebyshev.cheb2poly(chebyshev.poly2cheb(series)[: DEGREE + 1])
        rows.append(series[: DEGREE + 1] * (2.0 * PER_UNIT) ** np.arange(DEGREE + 1))
    return np.array(rows)


def angles() -> Array:
    """(entries, 2) sine and cosine of k / PER_UNIT."""
    angle = np.arange(ANGLE_END * PER_UNIT + 1) / PER_UNIT
    return np.column_stack([np.sin(angle), np.cos(angle)])


def _table(name: str, about: str, rows: Array) -> str:
    lines = ",\n".join("    {" + ", ".join(float(value).hex() for value in row) + "}" for row in rows)
    return f"/* {about} */\nstatic const double {name}[{len(rows)}][{rows.shape[1]}] = {{\n{lines}\n}};\n"


def _turn(power: int) -> str:
    """Coefficient of the sine's (odd power) or cosine's (even) series."""
    return repr((-1.0) ** (power // 2) / math.factorial(power))


PLACE = Function(
    f"""\
/* the table's entry that is nearest to x >= 0; *beyond is how far beyond it x lies. Numbers from {FAR} on are
   multiples of 1 / {PER_UNIT}, which the last bits count. */
static INLINE size_t entry(double x, double *beyond)
{{
    const double shifted = x + {FAR};
    uint64_t bits;
    memcpy(&bits, &shifted, sizeof bits);
    *beyond = x - (shifted - {FAR});
    return (size_t)(bits & 255u);
}}
"""
)

ATAN_NEAR = Function(
    _table("ATAN", f"atan about k / {PER_UNIT}: polynomials of what is beyond it", atan_polynomials())
    + f"""
/* for 0 <= x < {ATAN_END} */
static INLINE double atan_near(double x)
{{
    double t;
    const double *const a = ATAN[entry(x, &t)];
    const double t2 = t * t, t4 = t2 * t2;
    return ((a[0] + a[1] * t) + (a[2] + a[3] * t) * t2) + ((a[4] + a[5] * t) * t4 + (a[6] + a[7] * t) * (t2 * t4));
}}
""",
    ("entry",),
)

ATAN = Function(
    f"""\
static INLINE double own_atan(double x)
{{
    const double size = fabs(x);
    return size < {ATAN_END}.0 ? copysign(atan_near(size), x) : atan(x);
}}
""",
    ("atan_near",),
)

ATAN2 = Function(
    f"""\
static INLINE double own_atan2(double y, double x)
{{
    const double size = fabs(y);
    return x > 1e-290 && x < 1e290 && size < {ATAN_END}.0 * x ? copysign(atan_near(size / x), y) : atan2(y, x);
}}
""",
    ("atan_near",),
)

ANGLES = Function(
    _table("ANGLES", f"sine and cosine of k / {PER_UNIT}", angles())
    + f"""
/* sine and cosine of |x| < {ANGLE_END}: those of the nearest entry, turned by the rest */
static INLINE void turned(double x, double *sine, double *cosine)
{{
    double t;
    const double *const a = ANGLES[entry(fabs(x), &t)];
    const double s = copysign(a[0], x), c = a[1], from = copysign(1.0, x) * t; /* the mirror image for x < 0 */
    const double t2 = t * t, t4 = t2 * t2;
    const double across = from * (({_turn(1)} + {_turn(3)} * t2) + ({_turn(5)} + {_turn(7)} * t2) * t4);
    const double back = t2 * (({_turn(2)} + {_turn(4)} * t2) + {_turn(6)} * t4);
    *sine = s + (s * back + c * across);
    *cosine = c + (c * back - s * across);
}}
""",
    ("entry",),
)

SIN = Function(
    f"""\
static INLINE double own_sin(double x)
{{
    double sine, cosine;
    if (!(fabs(x) < {ANGLE_END}.0)) {{
        return sin(x);
    }}
    turned(x, &sine, &cosine);
    return sine;
}}
""",
    ("angles",),
)

COS = Function(
    f"""\
static INLINE double own_cos(double x)
{{
    double sine, cosine;
    if (!(fabs(x) < {ANGLE_END}.0)) {{
        return cos(x);
    }}
    turned(x, &sine, &cosine);
    return cosine;
}}
""",
    ("angles",),
)

BOTH = Function(
    f"""\
static INLINE void own_sincos(double x, double *sine, double *cosine)
{{
    if (fabs(x) < {ANGLE_END}.0) {{
        turned(x, sine, cosine);
    }} else {{
        *sine = sin(x);
        *cosine = cos(x);
    }}
}}
""",
    ("angles",),
)

TANH = Function(
    """\
/* beyond 20 it is one to the last place */
static INLINE double own_tanh(double x)
{
    const double size = fabs(x);
    return size < 20.0 ? tanh(x) : size >= 20.0 ? copysign(1.0, x) : x;
}
"""
)

FMIN = Function("static INLINE double own_fmin(double a, double b)\n{\n    return a < b ? a : b == b ? b : a;\n}\n")
FMAX = Function("static INLINE double own_fmax(double a, double b)\n{\n    return a > b ? a : b == b ? b : a;\n}\n")
SIGN = Function("static INLINE double own_sign(double x)\n{\n    return x < 0.0 ? -1.0 : x > 0.0 ? 1.0 : x;\n}\n")

FUNCTIONS = {
    "entry": PLACE,
    "atan_near": ATAN_NEAR,
    "angles": ANGLES,
    "own_atan": ATAN,
    "own_atan2": ATAN2,
    "own_sin": SIN,
    "own_cos": COS,
    "own_sincos": BOTH,
    "own_tanh": TANH,
    "own_fmin": FMIN,
    "own_fmax": FMAX,
    "own_sign": SIGN,
}
"""Name -> function; those called own_ take the place of the C library's."""
