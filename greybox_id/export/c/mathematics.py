"""Elementary functions in C that a vehicle's equations need and that C libraries compute slowly.

A step of a single-track vehicle calls atan, atan2, sin, cos or tanh 38 times, each depending on the previous result:
latency counts. These implementations use tables of polynomials (atan) or of nearby angles (sine and cosine) and have
half the latency of the C library's; since they are inlined, the processor works on both axles at once. Their errors are
below five units in the last place, one for sine and cosine (tests/export/c/test_mathematics.py); arguments beyond the
tables are left to the C library.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from ...base.shorthands import Array
from ..template import filled

PER_UNIT = 32
"""Table entries per unit of the argument; a power of two."""
FAR = "0x1p47"
"""2^52 / PER_UNIT: doubles from here to twice this value are spaced like the tables' entries."""
ATAN_END, ANGLE_END = 4, 3
"""Ends of the tables. The angle pi, where the sine must be accurate to many digits, is beyond."""
DEGREE = 7
TAYLOR = 24
"""Degrees of the polynomials of atan, and of the series from which they are derived."""


FUNCTIONS: Mapping[str, tuple[str, ...]] = {
    "entry": (), "atan_near": ("entry",), "angles": ("entry",), "own_atan": ("atan_near",), "own_atan2": ("atan_near",),
    "own_sin": ("angles",), "own_cos": ("angles",), "own_sincos": ("angles",), "own_tanh": (), "own_fmin": (),
    "own_fmax": (), "own_sign": (),
}  # fmt: skip
"""Name in `c_mathematics.c` -> functions that it needs; those named own_ replace the C library's."""
EXACT = """#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST)
#error "The order of sums must not change: compile without -ffast-math, -Ofast or /fp:fast."
#elif defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "Infinities and NaN must be kept: compile without -ffinite-math-only."
#endif
"""
"""Rejects compiler options that change the arithmetic: results would be grossly wrong."""


def definitions(names: Iterable[str]) -> str:
    """C of the named functions, and of those that they need."""
    needed, waiting = set[str](), [*names]
    while waiting:
        needed.add(name := waiting.pop())
        waiting += FUNCTIONS[name]
    words: dict[str, Any] = {name.upper(): name in needed for name in FUNCTIONS}
    if "angles" in needed:
        words["ANGLES"] = _table("ANGLES", angles())
    if "atan_near" in needed:
        words["ATAN"] = _table("ATAN", atan_polynomials())
    return filled(
        "c_mathematics.c", "", PER_UNIT=PER_UNIT, FAR=FAR, ATAN_END=ATAN_END, ANGLE_END=ANGLE_END, **words
    ).removesuffix("\n")


def atan_polynomials() -> Array:
    """(entries, DEGREE + 1) coefficients of atan about k / PER_UNIT, lowest power first, in the offset from there.

    Each is the Taylor series economised on half an entry to both sides; about zero the series itself, which is odd, so
    that small arguments keep full relative accuracy.
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


def _table(name: str, rows: Array) -> str:
    lines = ",\n".join("    {" + ", ".join(float(value).hex() for value in row) + "}" for row in rows)
    return f"static const double {name}[{len(rows)}][{rows.shape[1]}] = {{\n{lines}\n}};\n"
