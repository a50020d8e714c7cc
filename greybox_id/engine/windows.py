"""Windows of a signal's past: every window of so many rows, and inner products with weights."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import as_strided

from ..base.shorthands import Array

_BLOCK = 40
"""Rows per matrix product in `weighted_windows`: wide enough for BLAS, narrow enough to waste little on the band."""


def windows(values: Array, length: int) -> Array:
    """Every window of `length` rows, as a view: (n, ...) -> (n - length + 1, ..., length), oldest first."""
    step = values.strides[0]
    shape = (len(values) - length + 1, *values.shape[1:], length)
    return as_strided(values, shape, (step, *values.strides[1:], step), writeable=False)


def samples(values: Array, length: int) -> Array:
    """Every window of a series, copied, (n - length + 1, length): stored by columns, as derivatives by weights are.

    BLAS takes no overlapping rows, and numpy multiplies a copy in a third of the time.
    """
    return np.ascontiguousarray(windows(values, length).T).T


def weighted_windows(values: Array, weights: Array) -> Array:
    """Inner products of weights with every window of the rows: (n, c), (L,) -> (n - L + 1, c).

    A block of results is a banded Toeplitz matrix times the rows it needs; as matrix products this runs an
    order of magnitude faster than summing shifted copies.
    """
    rows, length = len(values) - len(weights) + 1, len(weights)
    result = np.empty((rows, values.shape[1]))
    values = np.ascontiguousarray(values)
    blocks = rows // _BLOCK
    if blocks:
        row, column = values.strides
        shape = (blocks, _BLOCK + length - 1, values.shape[1])
        overlapping = as_strided(values, shape, (row * _BLOCK, row, column), writeable=False)
        np.matmul(_band(weights, _BLOCK), overlapping, out=result[: blocks * _BLOCK].reshape(blocks, _BLOCK, -1))
    left = rows - blocks * _BLOCK
    if left:
        result[blocks * _BLOCK :] = _band(weights, left) @ values[blocks * _BLOCK :]
    return result


def _band(weights: Array, rows: int) -> Array:
    band = np.zeros((rows, rows + len(weights) - 1))
    for row in range(rows):
        band[row, row : row + len(weights)] = weights
    return band
