"""Where the coefficients in `engine/functions.c` come from: interpolation at Chebyshev nodes, in fifty digits.

    python tests/support/polynomials.py

Each polynomial approximates what is left of a function after its first terms, over the interval that range reduction
leaves. Nodes of Chebyshev make the error nearly as small as any polynomial of that degree can (Trefethen,
Approximation Theory and Approximation Practice, 2013, ch. 16).
"""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal, getcontext
from math import factorial

getcontext().prec = 60
TERMS = 200


def series(coefficient: Callable[[int], Decimal | int], z: Decimal) -> Decimal:
    """The sum of a power series."""
    total = Decimal(0)
    for k in reversed(range(TERMS)):
        total = total * z + coefficient(k)
    return total


def cosine(x: Decimal) -> Decimal:
    """Cosine by its series."""
    return series(lambda k: Decimal((-1) ** k) / factorial(2 * k), x * x)


def pi() -> Decimal:
    """Machin's formula."""
    return 16 * Decimal(1) / 5 * _arctan(Decimal(1) / 25) - 4 * Decimal(1) / 239 * _arctan(Decimal(1) / 239**2)


def _arctan(z: Decimal) -> Decimal:
    """atan(x) / x, with z = x^2."""
    return series(lambda k: Decimal((-1) ** k) / (2 * k + 1), z)


def interpolated(function: Callable[[Decimal], Decimal], low: Decimal, high: Decimal, degree: int) -> list[float]:
    """Coefficients, lowest first, of the polynomial that meets a function at Chebyshev nodes."""
    count = degree + 1
    nodes = [(low + high) / 2 + (high - low) / 2 * cosine(pi() * (2 * k + 1) / (2 * count)) for k in range(count)]
    divided = [function(node) for node in nodes]  # Newton's divided differences
    for order in range(1, count):
        for k in reversed(range(order, count)):
            divided[k] = (divided[k] - divided[k - 1]) / (nodes[k] - nodes[k - order])
    result = [Decimal(0)] * count
    for k in reversed(range(count)):  # multiply by (x - node), add
        result = [below - nodes[k] * here for below, here in zip([Decimal(0), *result[:-1]], result, strict=True)]
        result[0] += divided[k]
    return [float(value) for value in result]


def parts(number: Decimal, count: int) -> list[float]:
    """A number as a sum of doubles, largest first."""
    result = list[float]()
    for _ in range(count):
        result.append(float(number))
        number -= Decimal(result[-1])
    return result


def coefficients() -> dict[str, list[float]]:
    """By the name that each list has in C.

    SINE: (sin x - x) / x^3 and COSINE: (cos x - 1 + x^2/2) / x^4, in x^2, |x| <= pi/4.
    ARCTANGENT: (atan x - x) / x^3, in x^2, |x| <= 1/2.
    EXPONENTIAL: (exp x - 1 - x) / x^2, |x| <= log(2)/2.
    """
    quarter, narrow, half = (pi() / 4) ** 2, Decimal("0.25"), Decimal(2).ln() / 2
    wider = Decimal("1.0001")  # rounding may leave a little more than the interval
    return {
        "HALF_PI": parts(pi() / 2, 3),
        "QUARTER_PI": parts(pi() / 4, 2),
        "LOG_2": parts(Decimal(2).ln(), 2),
        "PER_HALF_PI": parts(2 / pi(), 1),
        "PER_LOG_2": parts(1 / Decimal(2).ln(), 1),
        "SINE": interpolated(
            lambda z: series(lambda k: Decimal((-1) ** (k + 1)) / factorial(2 * k + 3), z),
            Decimal(0),
            quarter * wider,
            5,
        ),
        "COSINE": interpolated(
            lambda z: series(lambda k: Decimal((-1) ** k) / factorial(2 * k + 4), z), Decimal(0), quarter * wider, 5
        ),
        "ARCTANGENT": interpolated(
            lambda z: series(lambda k: Decimal((-1) ** (k + 1)) / (2 * k + 3), z), Decimal(0), narrow * wider, 11
        ),
        "EXPONENTIAL": interpolated(
            lambda x: series(lambda k: Decimal(1) / factorial(k + 2), x), -half * wider, half * wider, 10
        ),
    }


def as_c() -> str:
    """The lines of C that define them."""
    return "\n".join(
        f"#define {name}{f'_{k}' if len(values) > 1 else ''} {value.hex()}"
        for name, values in coefficients().items()
        for k, value in enumerate(values)
    )


if __name__ == "__main__":
    print(as_c())
