"""What moves along a series: means, medians, greatest values and Gaussian smoothing, in numpy alone.

SciPy's filters do the same; loading them takes longer than most files take to be read and checked.
"""

from __future__ import annotations

import numpy as np

from .shorthands import Array

REACH = 4.0
"""Standard deviations after which a Gaussian is nothing."""


def moving_mean(values: Array, width: int) -> Array:
    """(n,) mean of `width` values about each, an odd number; the series is mirrored at its ends."""
    mirrored = np.pad(values, width // 2, mode="symmetric")
    return np.convolve(mirrored, np.full(width, 1.0 / width), mode="valid")


def smoothed(values: Array, sd: float) -> Array:
    """(n,) values under a Gaussian of so many rows' standard deviation; the series is mirrored at its ends."""
    reach = int(REACH * sd + 0.5)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sd) ** 2)
    return np.convolve(np.pad(values, reach, mode="symmetric"), weights / np.sum(weights), mode="valid")


def moving_maximum(values: Array, width: int) -> Array:
    """(n,) greatest of `width` values about each, an odd number; beyond the ends there are none."""
    result, size = np.pad(values, width // 2, constant_values=-np.inf), 1
    while 2 * size <= width:
        result, size = np.maximum(result[:-size], result[size:]), 2 * size
    rest = width - size
    return np.maximum(result[:-rest], result[rest:]) if rest else result


def median_of_five(values: Array) -> Array:
    """(n,) median of five values about each; the series is mirrored at its first and its last value."""
    padded, count = np.pad(values, 2, mode="reflect"), len(values)
    a, b, c, d, e = (padded[k : k + count] for k in range(5))
    low, high = np.maximum(np.minimum(a, b), np.minimum(c, d)), np.minimum(np.maximum(a, b), np.maximum(c, d))
    middle: Array = np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), e))
    return middle


class CubicSpline:
    """The cubic spline through equally spaced values, read at places that are equally spaced as well.

    Its coefficients are the values' convolution with the kernel that undoes the weights 1/6, 4/6, 1/6, which falls by
    2 - sqrt(3) with each row; the series goes on turned about its ends. Source: Unser, Splines: a perfect fit for
    signal and image processing, IEEE Signal Processing Magazine 16 (1999).
    """

    def __init__(self, values: Array) -> None:
        fall, reach = np.sqrt(3.0) - 2.0, min(PREFILTER, len(values) - 1)
        kernel = np.sqrt(3.0) * fall ** np.abs(np.arange(-reach, reach + 1))
        self._before = 2
        turned = np.pad(values, reach + self._before, mode="reflect", reflect_type="odd")
        self._coefficients = np.convolve(turned, kernel, mode="valid")

    def shifted(self, first: int, count: int, by: float) -> Array:
        """(count,) values at first + by, first + 1 + by, ...; within the series, or a row beyond."""
        whole = int(np.floor(by))
        t = by - whole
        weights = np.array([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6.0
        begin = first + whole - 1 + self._before
        coefficient = self._coefficients[begin : begin + count + 3]
        return np.convolve(coefficient, weights[::-1], mode="valid")


PREFILTER = 28
"""Rows after which the kernel of a spline's coefficients is 1e-16."""
