"""What self-tests have in common: tables of numbers, and how two are compared."""

from __future__ import annotations

from ...parameter import Array
from .naming import numbers

POINTS = 100
TOLERANCE, RELAXED_TOLERANCE = 1e-12, 1e-10
"""How far numbers may differ, relative to their own size and to a thousandth of the largest of their kind; where
quantities are relaxed, whose exponential formulas cancel digits, a hundred times as far."""

COMPARE = """\
static double worst = 0.0;

/* entries of one result against those expected, relative to an entry and to a thousandth of the largest one */
static void compare(const double *found, const double *expected, int count, double largest)
{
    int k;
    for (k = 0; k < count; k++) {
        const double off = fabs(found[k] - expected[k]) / (fabs(expected[k]) + 1e-3 * largest + 1e-300);
        if (worst == worst && !(off <= worst)) { /* what is no number stays the worst */
            worst = off;
        }
    }
}
"""


def table(name: str, rows: Array) -> str:
    """C of an array of rows."""
    lines = ",\n".join(f"    {{\n{numbers(row)}\n    }}" for row in rows)
    return f"static const double {name}[{len(rows)}][{rows.shape[1]}] = {{\n{lines}\n}};\n"
