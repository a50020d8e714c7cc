"""The filter of model error in C, `error_filter.c`; without a C compiler in Numba, `error_filter`, to the same numbers.

C is preferred: loading Numba takes as long as a tenth of a diagnosis.
"""

from __future__ import annotations

import ctypes
import os
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array, Index, Mask
from ...engine.compiler import CannotCompile, library
from ...engine.vectors import WIDE, c_of


def likelihood(
    F: Array, H: Array, sd: Array, fade: Array, colour: Array, slow: Array, white: Array, start: Array,
    first: Mask, pointer: Index, channel: Index, r: Array, gain: Array, size: Array, fisher: Array,
) -> Array:  # fmt: skip
    """See `error_filter.likelihood`."""
    made = _library()
    if made is None:
        from .error_filter import likelihood as in_numba  # imported here: it loads Numba

        result: Array = in_numba(
            F, H, sd, fade, colour, slow, white, start, first, pointer, channel, r, gain, size, fisher
        )
        return result
    (segments, nz, n), channels, (_, forces, lanes) = F.shape, H.shape[1], sd.shape
    nll, scratch = np.empty(lanes), np.empty(WIDE * (1 + n * (n + 2 * nz + 7)))
    given = (F, H, sd, fade, colour, slow, white, start, first, pointer, channel, r, gain)
    each = np.empty((2, len(r) if len(fisher) else 0, lanes))  # logarithms of variances, and innovations
    results = (_place(array) if array.size else None for array in (size, *each))
    made.likelihood(
        segments, nz, n, channels, forces, lanes, *map(_place, given), *results, _place(nll), _place(scratch)
    )
    if len(fisher):
        root = np.exp(-0.5 * each[0, :, :1])  # one over the first lane's standard deviation
        loud, off = np.sqrt(0.5) * (each[0] - each[0, :, :1]), root * (each[1] - each[1, :, :1])
        fisher += loud.T @ loud + off.T @ off
    return nll


def innovations(
    F: Array, H: Array, decay: Array, first: Mask, pointer: Index, channel: Index, gain: Array, size: Array,
    place: Index, values: Array, result: Array,
) -> None:  # fmt: skip
    """See `error_filter.innovations`."""
    made = _library()
    if made is None:
        from .error_filter import innovations as in_numba  # imported here: it loads Numba

        in_numba(F, H, decay, first, pointer, channel, gain, size, place, values, result)
        return
    (segments, nz, n), (_, channels, _), columns = F.shape, H.shape, values.shape[1]
    scratch = np.empty(WIDE + (columns + WIDE) * (nz + n + 2))
    given = (F, H, decay, first, pointer, channel, gain, size, place, values, result, scratch)
    made.innovations(segments, nz, n, channels, columns, *map(_place, given))


def _place(array: NDArray[np.generic]) -> int:
    """Address of an array, which C reads in order."""
    assert array.flags.c_contiguous
    assert array.dtype in (np.float64, np.intp, np.bool_)
    return int(array.ctypes.data)


@cache
def _library() -> ctypes.CDLL | None:
    """The compiled filter; None without a compiler, or where nothing is to be compiled."""
    if os.environ.get("GREYBOX_COMPILE") == "0":
        return None
    source = "\n".join([c_of("vectors"), Path(__file__).with_name("error_filter.c").read_text("utf-8")])
    try:
        made = library(lambda: [source], source)
    except CannotCompile:
        return None
    made.likelihood.argtypes = [ctypes.c_ssize_t] * 6 + [ctypes.c_void_p] * 18
    made.innovations.argtypes = [ctypes.c_ssize_t] * 5 + [ctypes.c_void_p] * 12
    made.likelihood.restype = made.innovations.restype = None
    return made
