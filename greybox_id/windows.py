"""Sliding windows over rows, the arithmetic of finite memory."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from .parameter import Array

_BLOCK = 256  # rows summed at a time, so that they stay in the cache


def windows(values: Array, length: int) -> Array:
    """Every window of `length` rows, as a view: (n, ...) -> (n - length + 1, ..., length), oldest first."""
    return sliding_window_view(values, length, axis=0)


def weighted_windows(values: Array, weights: Array) -> Array:
    """Inner products of weights with every window of the rows: (n, c), (L,) -> (n - L + 1, c)."""
    rows = len(values) - len(weights) + 1
    result = np.empty((rows, values.shape[1]))
    for start in range(0, rows, _BLOCK):
        stop = min(start + _BLOCK, rows)
        part = values[start:stop] * weights[0]
        scratch = np.empty_like(part)
        for lag in range(1, len(weights)):
            np.multiply(values[start + lag : stop + lag], weights[lag], out=scratch)
            part += scratch
        result[start:stop] = part
    return result
