"""The Kalman filter of model error in C, `error_filter.c`; without a C compiler in Numba, to the same numbers.

The state x = (z, w) holds errors z of the simulation's states, and Gauss-Markov processes w: slow errors of readings,
then unknown forces. Over a segment, z becomes F x, and w decays. A residual is h x plus white noise, where h is its
channel's row of H. Residuals are taken one by one (Anderson & Moore, Optimal Filtering, 1979, 6.4). Lanes differ in
amplitudes alone.

C is preferred: loading Numba takes as long as a tenth of a diagnosis.
"""

from __future__ import annotations

import ctypes
import os
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...base.machine_code import begun
from ...base.shorthands import Array, Index, Mask
from ...engine.compiler import CannotCompile, library
from ...engine.vectors import WIDE, c_of


def filtered(
    F: Array, H: Array, start: Array, colour: Array, slow: Array, sd: Array, fade: Array, white: Array, first: Mask,
    pointer: Index, channel: Index, r: Array,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Filter residuals under each lane's amplitudes.

    Parameters
    ----------
    F, H : (S, nz, n), (S, channels, n) of all segments.
    start : (nz,) variances of z where runs begin.
    colour, slow : (slow errors, L), (S, L) standard deviations of slow errors, and their correlation over a segment.
    sd, fade : (S, forces, L) the same of unknown forces.
    white : (channels, L) variances of white noise.
    first : (S,) whether a run begins.
    pointer : (S + 1,) index of the first reading of each segment.
    channel, r : (R,) of each reading; its residual.

    Returns
    -------
    innovations, variances : (R, L) of the innovations.
    gains : (R, n) of the first lane.
    """
    (segments, nz, n), (channels, lanes) = F.shape, white.shape
    innovation, variance, gain = np.empty((len(r), lanes)), np.empty((len(r), lanes)), np.empty((len(r), n))
    given = (F, H, start, colour, slow, sd, fade, white, first, pointer, channel, r, innovation, variance, gain)
    in_c = _library()
    if in_c is None:
        _filtered(*given)
    else:
        scratch = np.empty(WIDE * (1 + n * (n + 2 * nz + 7)))
        in_c.filtered(segments, nz, n, channels, len(colour), lanes, *map(_address, given), _address(scratch))
    return innovation, variance, gain


def innovations(
    F: Array, H: Array, decay: Array, first: Mask, pointer: Index, channel: Index, gain: Array, size: Array,
    place: Index, values: Array, result: Array,
) -> None:  # fmt: skip
    """Innovations of values, (N, K), over their standard deviations; the result has the same places.

    The filter is that of `filtered`, with known gains and standard deviations `size`; `decay`, (S, n - nz), are factors
    of the processes, and `place`, (R,), is each reading's.
    """
    given = (F, H, decay, first, pointer, channel, gain, size, place, values, result)
    in_c = _library()
    if in_c is None:
        _innovations(*given)
    else:
        (segments, nz, n), channels, columns = F.shape, H.shape[1], values.shape[1]
        scratch = np.empty(WIDE + (columns + WIDE) * (nz + n + 2))
        in_c.innovations(segments, nz, n, channels, columns, *map(_address, given), _address(scratch))


@cache
def _library() -> ctypes.CDLL | None:
    """The compiled filter; None without a compiler, or where nothing is to be compiled."""
    if os.environ.get("GREYBOX_COMPILE") == "0":
        return None
    source = "\n".join([c_of("vectors"), Path(__file__).with_suffix(".c").read_text("utf-8")])
    try:
        made = library(lambda: [source], source)
    except CannotCompile:
        return None
    made.filtered.argtypes = [ctypes.c_ssize_t] * 6 + [ctypes.c_void_p] * 16
    made.innovations.argtypes = [ctypes.c_ssize_t] * 5 + [ctypes.c_void_p] * 12
    made.filtered.restype = made.innovations.restype = None
    return made


def _address(array: NDArray[np.generic]) -> int:
    """Address of an array, which C reads in order."""
    assert array.flags.c_contiguous
    assert array.dtype in (np.float64, np.intp, np.bool_)
    return int(array.ctypes.data)


@begun
def _filtered(  # pragma: no cover
    F: Array, H: Array, start: Array, colour: Array, slow: Array, sd: Array, fade: Array, white: Array, first: Mask,
    pointer: Index, channel: Index, r: Array, innovation: Array, variance: Array, gain: Array,
) -> None:  # fmt: skip
    (S, nz, n), c = F.shape, len(colour)
    x, P, g, K = np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros(n)
    decay, driven = np.zeros(n - nz), np.zeros(n - nz)
    for lane in range(white.shape[1]):
        for k in range(S):
            if first[k]:
                x[:] = 0.0
                P[:] = np.diag(np.concatenate((start, colour[:, lane] ** 2, sd[k, :, lane] ** 2)))
            for i in range(pointer[k], pointer[k + 1]):
                h, s, nu = H[k, channel[i]], white[channel[i], lane], r[i]
                g[:] = 0.0
                for a in range(n):
                    if h[a] != 0.0:  # few are not
                        for b in range(n):
                            g[b] += h[a] * P[a, b]
                for a in range(n):
                    s += h[a] * g[a]
                    nu -= h[a] * x[a]
                for a in range(n):
                    K[a] = g[a] / s
                    x[a] += K[a] * nu
                    for b in range(n):
                        P[a, b] -= K[a] * g[b]
                innovation[i, lane], variance[i, lane] = nu, s
                if lane == 0:
                    gain[i] = K
            if k + 1 < S and not first[k + 1]:
                for j in range(c):
                    decay[j], driven[j] = slow[k, lane], colour[j, lane] ** 2 * (1.0 - slow[k, lane] ** 2)
                for j in range(n - nz - c):
                    rho, now, later = fade[k, j, lane], sd[k, j, lane], sd[k + 1, j, lane]
                    decay[c + j], driven[c + j] = rho * later / now, later**2 * (1.0 - rho**2)
                M = F[k] @ P
                x[:nz] = F[k] @ x
                P[:nz, :nz] = M @ F[k].T
                for b in range(nz, n):
                    x[b] *= decay[b - nz]
                    for a in range(nz):
                        P[a, b] = P[b, a] = M[a, b] * decay[b - nz]
                    for a in range(nz, n):
                        P[a, b] *= decay[a - nz] * decay[b - nz]
                    P[b, b] += driven[b - nz]


@begun
def _innovations(  # pragma: no cover
    F: Array, H: Array, decay: Array, first: Mask, pointer: Index, channel: Index, gain: Array, size: Array,
    place: Index, values: Array, result: Array,
) -> None:  # fmt: skip
    S, nz, n = F.shape
    x = np.zeros((n, values.shape[1]))
    for k in range(S):
        if first[k]:
            x[:] = 0.0
        for i in range(pointer[k], pointer[k + 1]):
            h, nu = H[k, channel[i]], result[place[i]]
            nu[:] = values[place[i]]
            for a in range(n):
                for q in range(len(nu)):
                    nu[q] -= h[a] * x[a, q]
            for a in range(n):
                for q in range(len(nu)):
                    x[a, q] += gain[i, a] * nu[q]
            nu /= size[i]
        if k + 1 < S and not first[k + 1]:
            x[:nz] = F[k] @ x
            for a in range(nz, n):
                x[a] *= decay[k, a - nz]
