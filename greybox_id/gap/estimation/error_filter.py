"""The Kalman filter of model error, compiled: likelihoods of several amplitudes, and innovations by given gains.

The state x = (z, w) holds errors z of the simulation's states, and Gauss-Markov processes w: slow errors of readings,
then unknown forces. Over a segment, z becomes F x, and w decays. A residual is h x plus white noise, where h is its
channel's row of H. Residuals are taken one by one (Anderson & Moore, Optimal Filtering, 1979, 6.4). Lanes, which lie
innermost, differ in amplitudes alone.
"""

import numpy as np
from numpy.typing import NDArray

from ...base.machine_code import begun, compiled
from ...base.shorthands import Array

Index = NDArray[np.intp]


@begun
def likelihood(  # pragma: no cover
    F: Array, H: Array, sd: Array, fade: Array, colour: Array, slow: Array, white: Array, start: Array,
    first: NDArray[np.bool_], pointer: Index, channel: Index, r: Array, gain: Array, size: Array, fisher: Array,
) -> Array:  # fmt: skip
    """Negative log-likelihood of residuals under each lane's amplitudes.

    Parameters
    ----------
    F, H : (S, nz, n), (S, channels, n) of all segments.
    sd, fade : (S, forces, L) standard deviations of unknown forces, and their correlations over a segment.
    colour, slow : (slow errors, L), (S, L) the same of readings' slow errors.
    white : (channels, L) variances of white noise.
    start : (nz,) variances of z where runs begin.
    first : (S,) whether a run begins.
    pointer : (S + 1,) index of the first reading of each segment.
    channel, r : (R,) of each reading; its residual.
    gain, size : (R, n), (R,) results: the first lane's gains, and standard deviations of its innovations; or empty.
    fisher : (L, L) result: Fisher information of differences of the lanes from the first one; or empty.

    Returns
    -------
    (L,).
    """
    (S, nz, n), L = F.shape, white.shape[1]
    x, P = np.zeros((n, L)), np.zeros((n, n, L))
    g, K, s, nu, precision = np.zeros((n, L)), np.zeros((n, L)), np.zeros(L), np.zeros(L), np.zeros(L)
    decay, driven = np.zeros((n - nz, L)), np.zeros((n - nz, L))
    M, N, moved = np.zeros((nz, n, L)), np.zeros((n, nz, L)), np.zeros((nz, L))
    g1, P1, M1, N1 = g.reshape(1, n * L), P.reshape(n, n * L), M.reshape(nz, n * L), N.reshape(n, nz * L)
    nll, logarithm, loud, off = np.zeros(L), np.zeros(L), np.zeros(L), np.zeros(L)
    for k in range(S):
        if first[k]:
            _begin(x, P, start, colour, sd[k])
        for i in range(pointer[k], pointer[k + 1]):
            c = channel[i]
            h = H[k, c : c + 1]
            _product(g1, h, P1)  # rows of all lanes at once: long loops take less time
            _innovation(x, h, white[c], r[i], g, s, nu)
            _update(x, P, g, s, nu, precision, K)
            for lane in range(L):
                logarithm[lane] = np.log(s[lane])
                nll[lane] += 0.5 * (nu[lane] * nu[lane] / s[lane] + logarithm[lane])
            if len(fisher) > 0:
                _inform(fisher, logarithm, nu, s[0], loud, off)
            if len(size) > 0:
                size[i] = np.sqrt(s[0])
                for a in range(n):
                    gain[i, a] = K[a, 0]
        if k + 1 < S and not first[k + 1]:
            _processes(colour, slow[k], sd[k], fade[k], sd[k + 1], decay, driven)
            _predict_states(x, F[k], moved)
            _product(M1, F[k], P1)
            _transpose(M, N)
            _product(P1, F[k], N1)
            _predict_processes(x, P, M, decay, driven)
    return nll


@begun
def innovations(  # pragma: no cover
    F: Array, H: Array, decay: Array, first: NDArray[np.bool_], pointer: Index, channel: Index, gain: Array,
    size: Array, place: Index, values: Array, result: Array,
) -> None:  # fmt: skip
    """Innovations of values, (N, K), over their standard deviations; the result has the same places.

    The filter is that of `likelihood`, with known gains and sizes; `decay`, (S, n - nz), are factors of the processes,
    and `place`, (R,), is each reading's.
    """
    (S, nz, n), columns = F.shape, values.shape[1]
    x, expected, moved = np.zeros((n, columns)), np.zeros((1, columns)), np.zeros((nz, columns))
    for k in range(S):
        if first[k]:
            x[:] = 0.0
        for i in range(pointer[k], pointer[k + 1]):
            c, nu = channel[i], result[place[i]]
            _product(expected, H[k, c : c + 1], x)
            for q in range(columns):
                nu[q] = values[place[i], q] - expected[0, q]
            for a in range(n):
                factor = gain[i, a]
                for q in range(columns):
                    x[a, q] += factor * nu[q]
            factor = 1.0 / size[i]
            for q in range(columns):
                nu[q] *= factor
        if k + 1 < S and not first[k + 1]:
            _predict_states(x, F[k], moved)
            for a in range(nz, n):
                factor = decay[k, a - nz]
                for q in range(columns):
                    x[a, q] *= factor


@compiled
def _begin(x: Array, P: Array, start: Array, colour: Array, sd: Array) -> None:  # pragma: no cover
    """Mean and covariance where a run begins."""
    x[:] = 0.0
    P[:] = 0.0
    a = 0
    for variance in start:
        P[a, a] = variance
        a += 1
    for stationary in (colour, sd):
        for lanes in stationary:
            P[a, a] = lanes * lanes
            a += 1


@compiled
def _innovation(  # pragma: no cover
    x: Array, h: Array, white: Array, r: float, g: Array, s: Array, nu: Array
) -> None:
    """A reading's innovation nu = r - h x, its variance s = h P h' + white, and g = P h'; h is (1, n)."""
    n, L = x.shape
    for q in range(L):
        s[q] = white[q]
        nu[q] = r
    for a in range(n):
        factor = h[0, a]
        if factor != 0.0:
            for q in range(L):
                s[q] += factor * g[a, q]
                nu[q] -= factor * x[a, q]


@compiled
def _update(  # pragma: no cover
    x: Array, P: Array, g: Array, s: Array, nu: Array, precision: Array, K: Array
) -> None:
    """Gain K = g / s, mean x + K nu and covariance P - g K'."""
    n, L = x.shape
    for q in range(L):
        precision[q] = 1.0 / s[q]
    for a in range(n):
        for q in range(L):
            K[a, q] = g[a, q] * precision[q]
            x[a, q] += K[a, q] * nu[q]
    for a in range(n):
        for b in range(n):
            for q in range(L):
                P[a, b, q] -= g[a, q] * K[b, q]


@compiled
def _inform(  # pragma: no cover
    fisher: Array, logarithm: Array, nu: Array, s: float, loud: Array, off: Array
) -> None:
    """Add what a reading tells of differences between lanes: half the square of log s, and that of nu / sqrt(s)."""
    L, root = len(nu), 1.0 / np.sqrt(s)
    for q in range(L):
        loud[q] = np.sqrt(0.5) * (logarithm[q] - logarithm[0])
        off[q] = root * (nu[q] - nu[0])
    for p in range(L):
        for q in range(L):
            fisher[p, q] += loud[p] * loud[q] + off[p] * off[q]


@compiled
def _processes(  # pragma: no cover
    colour: Array, slow: Array, sd: Array, fade: Array, later: Array, decay: Array, driven: Array
) -> None:
    """Factors by which the processes decay over a segment, and variances that are added."""
    nc = len(colour)
    for m in range(nc):
        for q in range(len(slow)):
            decay[m, q] = slow[q]
            driven[m, q] = colour[m, q] * colour[m, q] * (1.0 - slow[q] * slow[q])
    for j in range(len(sd)):
        for q in range(len(slow)):
            decay[nc + j, q] = fade[j, q] * later[j, q] / sd[j, q]
            driven[nc + j, q] = later[j, q] * later[j, q] * (1.0 - fade[j, q] * fade[j, q])


@compiled
def _predict_states(x: Array, F: Array, moved: Array) -> None:  # pragma: no cover
    """The mean of z after a segment, F x."""
    _product(moved, F, x)
    for a in range(len(F)):
        for q in range(x.shape[1]):
            x[a, q] = moved[a, q]


@compiled
def _predict_processes(x: Array, P: Array, M: Array, decay: Array, driven: Array) -> None:  # pragma: no cover
    """Mean and covariance of w after a segment, and its covariance with z; M = F P, of what was before the segment."""
    nz, n, L = M.shape
    for i in range(n - nz):
        for q in range(L):
            x[nz + i, q] *= decay[i, q]
        for a in range(nz):
            for q in range(L):
                P[a, nz + i, q] = M[a, nz + i, q] * decay[i, q]
                P[nz + i, a, q] = P[a, nz + i, q]
        for j in range(n - nz):
            for q in range(L):
                P[nz + i, nz + j, q] *= decay[i, q] * decay[j, q]
        for q in range(L):
            P[nz + i, nz + i, q] += driven[i, q]


@compiled
def _transpose(M: Array, N: Array) -> None:  # pragma: no cover
    """M with rows and columns exchanged, into N."""
    for a in range(M.shape[0]):
        for b in range(M.shape[1]):
            for q in range(M.shape[2]):
                N[b, a, q] = M[a, b, q]


@compiled
def _product(result: Array, M: Array, X: Array) -> None:  # pragma: no cover
    """M X into the beginnings of the rows of the result; zeros of M cost nothing."""
    for a in range(M.shape[0]):
        for q in range(X.shape[1]):
            result[a, q] = 0.0
        for i in range(M.shape[1]):
            factor = M[a, i]
            if factor != 0.0:
                for q in range(X.shape[1]):
                    result[a, q] += factor * X[i, q]
