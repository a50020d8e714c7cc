"""The Kalman filter of model error, compiled: likelihoods of amplitudes side by side, and innovations by known gains.

States are errors about a simulation (A, B, C, D per segment, `model_error.Linearised`), unknown forces that fade, and
slow errors of readings. Readings are taken one by one; lanes, which lie innermost, differ in amplitudes alone.
"""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def likelihood(  # type: ignore[no-untyped-def]  # pragma: no cover
    A, B, C, D, scale, fade, slow, white, colour, start, first, pointer, channel, coloured, r, gain, size
):
    """(L,) negative log-likelihood of residuals under each lane's amplitudes; gains of the first lane where wanted."""
    S, nz, _ = A.shape
    nd, nc, L = B.shape[2], colour.shape[0], white.shape[1]
    n = nz + nd + nc
    P, d, M = np.zeros((n, n, L)), np.zeros((n, L)), np.zeros((nz, n, L))
    h, g, s, nu = np.zeros((n, L)), np.zeros((n, L)), np.zeros(L), np.zeros(L)
    nll = np.zeros(L)
    keep = size.shape[0] > 0
    for k in range(S):
        if first[k]:
            P[:] = 0.0
            d[:] = 0.0
            for i in range(nz):
                P[i, i] = start[i]
            for j in range(nd):
                P[nz + j, nz + j] = 1.0
            for m in range(nc):
                P[nz + nd + m, nz + nd + m] = colour[m]
        for i in range(pointer[k], pointer[k + 1]):
            c = channel[i]
            for a in range(nz):
                h[a] = C[k, c, a]
            for j in range(nd):
                h[nz + j] = D[k, c, j] * scale[k, j]
            for m in range(nc):
                h[nz + nd + m] = 1.0 if coloured[m] == c else 0.0
            for a in range(n):
                for x in range(L):
                    g[a, x] = 0.0
                for b in range(nz + nd):
                    for x in range(L):
                        g[a, x] += P[a, b, x] * h[b, x]
                for m in range(nc):
                    if coloured[m] == c:
                        for x in range(L):
                            g[a, x] += P[a, nz + nd + m, x]
            for x in range(L):
                s[x] = white[c, x]
                nu[x] = r[i]
            for a in range(n):
                for x in range(L):
                    s[x] += h[a, x] * g[a, x]
                    nu[x] -= h[a, x] * d[a, x]
            for x in range(L):
                nll[x] += 0.5 * (nu[x] * nu[x] / s[x] + np.log(s[x]))
            if keep:
                size[i] = np.sqrt(s[0])
                for a in range(n):
                    gain[i, a] = g[a, 0] / s[0]
            for a in range(n):
                for x in range(L):
                    d[a, x] += g[a, x] * nu[x] / s[x]
                for b in range(n):
                    for x in range(L):
                        P[a, b, x] -= g[a, x] * g[b, x] / s[x]
        if k + 1 == S or first[k + 1]:
            continue
        for a in range(nz):
            for b in range(n):
                for x in range(L):
                    M[a, b, x] = 0.0
                for i in range(nz):
                    if A[k, a, i] != 0.0:
                        for x in range(L):
                            M[a, b, x] += A[k, a, i] * P[i, b, x]
                for j in range(nd):
                    if B[k, a, j] != 0.0:
                        for x in range(L):
                            M[a, b, x] += B[k, a, j] * scale[k, j, x] * P[nz + j, b, x]
        for a in range(nd + nc):
            for b in range(nd + nc):
                for x in range(L):
                    fa = fade[k, a, x] if a < nd else slow[k, a - nd, x]
                    fb = fade[k, b, x] if b < nd else slow[k, b - nd, x]
                    P[nz + a, nz + b, x] *= fa * fb
        for j in range(nd):
            for x in range(L):
                P[nz + j, nz + j, x] += 1.0 - fade[k, j, x] ** 2
        for m in range(nc):
            for x in range(L):
                P[nz + nd + m, nz + nd + m, x] += colour[m, x] * (1.0 - slow[k, m, x] ** 2)
        for a in range(nz):
            for b in range(nd + nc):
                for x in range(L):
                    f = fade[k, b, x] if b < nd else slow[k, b - nd, x]
                    P[a, nz + b, x] = M[a, nz + b, x] * f
                    P[nz + b, a, x] = P[a, nz + b, x]
        for a in range(nz):
            for b in range(a + 1):
                for x in range(L):
                    s[x] = 0.0
                for i in range(nz):
                    if A[k, b, i] != 0.0:
                        for x in range(L):
                            s[x] += A[k, b, i] * M[a, i, x]
                for j in range(nd):
                    if B[k, b, j] != 0.0:
                        for x in range(L):
                            s[x] += B[k, b, j] * scale[k, j, x] * M[a, nz + j, x]
                for x in range(L):
                    P[a, b, x] = s[x]
                    P[b, a, x] = s[x]
        for a in range(nz):
            for x in range(L):
                h[a, x] = 0.0
                for i in range(nz):
                    h[a, x] += A[k, a, i] * d[i, x]
                for j in range(nd):
                    h[a, x] += B[k, a, j] * scale[k, j, x] * d[nz + j, x]
        for a in range(nz):
            for x in range(L):
                d[a, x] = h[a, x]
        for j in range(nd):
            for x in range(L):
                d[nz + j, x] *= fade[k, j, x]
        for m in range(nc):
            for x in range(L):
                d[nz + nd + m, x] *= slow[k, m, x]
    return nll


@njit(cache=True, error_model="numpy")
def innovations(  # type: ignore[no-untyped-def]  # pragma: no cover
    A, B, C, D, scale, fade, slow, first, pointer, channel, coloured, values, gain, size
):
    """(R, K) whitened values, by gains that are known."""
    S, nz, _ = A.shape
    nd, nc, K = B.shape[2], slow.shape[1], values.shape[1]
    n = nz + nd + nc
    d, moved = np.zeros((n, K)), np.zeros((nz, K))
    found = np.empty(values.shape)
    for k in range(S):
        if first[k]:
            d[:] = 0.0
        for i in range(pointer[k], pointer[k + 1]):
            c = channel[i]
            for x in range(K):
                found[i, x] = values[i, x]
            for a in range(nz):
                own = C[k, c, a]
                if own != 0.0:
                    for x in range(K):
                        found[i, x] -= own * d[a, x]
            for j in range(nd):
                own = D[k, c, j] * scale[k, j]
                if own != 0.0:
                    for x in range(K):
                        found[i, x] -= own * d[nz + j, x]
            for m in range(nc):
                if coloured[m] == c:
                    for x in range(K):
                        found[i, x] -= d[nz + nd + m, x]
            for a in range(n):
                own = gain[i, a]
                for x in range(K):
                    d[a, x] += own * found[i, x]
            own = 1.0 / size[i]
            for x in range(K):
                found[i, x] *= own
        if k + 1 == S or first[k + 1]:
            continue
        for a in range(nz):
            for x in range(K):
                moved[a, x] = 0.0
            for b in range(nz):
                own = A[k, a, b]
                if own != 0.0:
                    for x in range(K):
                        moved[a, x] += own * d[b, x]
            for j in range(nd):
                own = B[k, a, j] * scale[k, j]
                if own != 0.0:
                    for x in range(K):
                        moved[a, x] += own * d[nz + j, x]
        for a in range(nz):
            for x in range(K):
                d[a, x] = moved[a, x]
        for j in range(nd):
            for x in range(K):
                d[nz + j, x] *= fade[k, j]
        for m in range(nc):
            for x in range(K):
                d[nz + nd + m, x] *= slow[k, m]
    return found
