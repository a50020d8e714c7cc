"""The Kalman filter of model error, compiled: likelihoods of several amplitudes, and innovations by given gains.

States are errors about a simulation (A, B, C, D per segment, `model_error.Linearised`), unknown forces that decay, and
slow errors of readings. Readings are taken one by one; lanes, which lie innermost, differ in amplitudes alone.
"""

import numpy as np

from ...base.machine_code import begun


@begun
def likelihood(  # type: ignore[no-untyped-def]  # pragma: no cover
    A, B, C, D, scale, fade, slow, white, colour, start, first, pointer, channel, coloured, r, gain, size
):
    """(L,) negative log-likelihood of residuals under each lane's amplitudes; gains of the first lane if requested."""
    S, nz, _ = A.shape
    nd, nc, L = B.shape[2], colour.shape[0], white.shape[1]
    n = nz + nd + nc
    P, d, M = np.zeros((n, n, L)), np.zeros((n, L)), np.zeros((nz, n, L))
    h, g, t, f = np.zeros((n, L)), np.zeros((n, L)), np.zeros((n, L)), np.zeros((n, L))
    s, nu, nll, over = np.zeros(L), np.zeros(L), np.zeros(L), np.zeros(L)
    keep, flat = size.shape[0] > 0, n * L
    F, N = np.zeros((nd, n, L)), np.zeros((nz + nd, nz, L))
    rows, sums, products = P.reshape(n, flat), g.reshape(flat), M.reshape(nz, flat)  # long loops take less time
    pushed, turned = F.reshape(nd, flat), N.reshape(nz + nd, nz * L)
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
            value = n
            for m in range(nc):
                if coloured[m] == c:
                    value = nz + nd + m
            for q in range(flat):
                sums[q] = rows[value, q] if value < n else 0.0
            for b in range(nz):
                y = C[k, c, b]
                for x in range(L):
                    h[b, x] = y
                if y != 0.0:
                    for q in range(flat):
                        sums[q] += y * rows[b, q]
            for j in range(nd):
                y = D[k, c, j]
                for x in range(L):
                    h[nz + j, x] = y * scale[k, j, x]
                if y != 0.0:
                    for a in range(n):
                        for x in range(L):
                            g[a, x] += h[nz + j, x] * P[nz + j, a, x]
            for x in range(L):
                s[x] = white[c, x]
                nu[x] = r[i]
            if value < n:
                for x in range(L):
                    s[x] += g[value, x]
                    nu[x] -= d[value, x]
            for a in range(nz + nd):
                for x in range(L):
                    s[x] += h[a, x] * g[a, x]
                    nu[x] -= h[a, x] * d[a, x]
            for x in range(L):
                nll[x] += 0.5 * (nu[x] * nu[x] / s[x] + np.log(s[x]))
            for x in range(L):
                over[x] = 1.0 / s[x]
            for a in range(n):
                for x in range(L):
                    t[a, x] = g[a, x] * over[x]
            if keep:
                size[i] = np.sqrt(s[0])
                for a in range(n):
                    gain[i, a] = t[a, 0]
            for a in range(n):
                for x in range(L):
                    d[a, x] += t[a, x] * nu[x]
                for b in range(n):
                    for x in range(L):
                        P[a, b, x] -= g[a, x] * t[b, x]
        if k + 1 == S or first[k + 1]:
            continue
        for a in range(nd):
            for x in range(L):
                f[nz + a, x] = fade[k, a, x]
        for a in range(nc):
            for x in range(L):
                f[nz + nd + a, x] = slow[k, a, x]
        for j in range(nd):
            for b in range(n):
                for x in range(L):
                    F[j, b, x] = scale[k, j, x] * P[nz + j, b, x]
        for a in range(nz):
            for q in range(flat):
                products[a, q] = 0.0
            for i in range(nz):
                y = A[k, a, i]
                if y != 0.0:
                    for q in range(flat):
                        products[a, q] += y * rows[i, q]
            for j in range(nd):
                y = B[k, a, j]
                if y != 0.0:
                    for q in range(flat):
                        products[a, q] += y * pushed[j, q]
        for a in range(nz, n):
            for b in range(nz, n):
                for x in range(L):
                    P[a, b, x] *= f[a, x] * f[b, x]
        for j in range(nd):
            for x in range(L):
                P[nz + j, nz + j, x] += 1.0 - f[nz + j, x] * f[nz + j, x]
        for m in range(nc):
            for x in range(L):
                P[nz + nd + m, nz + nd + m, x] += colour[m, x] * (1.0 - f[nz + nd + m, x] * f[nz + nd + m, x])
        for a in range(nz):
            for b in range(nz, n):
                for x in range(L):
                    P[a, b, x] = M[a, b, x] * f[b, x]
                    P[b, a, x] = P[a, b, x]
        for a in range(nz):
            for i in range(nz):
                for x in range(L):
                    N[i, a, x] = M[a, i, x]
            for j in range(nd):
                for x in range(L):
                    N[nz + j, a, x] = scale[k, j, x] * M[a, nz + j, x]
        for b in range(nz):
            for q in range(nz * L):
                rows[b, q] = 0.0
            for i in range(nz):
                y = A[k, b, i]
                if y != 0.0:
                    for q in range(nz * L):
                        rows[b, q] += y * turned[i, q]
            for j in range(nd):
                y = B[k, b, j]
                if y != 0.0:
                    for q in range(nz * L):
                        rows[b, q] += y * turned[nz + j, q]
        for a in range(nz):
            for x in range(L):
                h[a, x] = 0.0
            for i in range(nz):
                y = A[k, a, i]
                if y != 0.0:
                    for x in range(L):
                        h[a, x] += y * d[i, x]
            for j in range(nd):
                y = B[k, a, j]
                if y != 0.0:
                    for x in range(L):
                        h[a, x] += y * scale[k, j, x] * d[nz + j, x]
        for a in range(nz):
            for x in range(L):
                d[a, x] = h[a, x]
        for a in range(nz, n):
            for x in range(L):
                d[a, x] *= f[a, x]
    return nll


@begun
def innovations(  # type: ignore[no-untyped-def]  # pragma: no cover
    A, B, C, D, scale, fade, slow, first, pointer, channel, coloured, values, gain, size, place, result
):
    """Whiten values, (N, K), at the places of readings, by known gains; the result has the same places."""
    S, nz, _ = A.shape
    nd, nc, K = B.shape[2], slow.shape[1], values.shape[1]
    n = nz + nd + nc
    d, moved = np.zeros((n, K)), np.zeros((nz, K))
    for k in range(S):
        if first[k]:
            d[:] = 0.0
        for i in range(pointer[k], pointer[k + 1]):
            c, at = channel[i], place[i]
            for x in range(K):
                result[at, x] = values[at, x]
            for a in range(nz):
                value = C[k, c, a]
                if value != 0.0:
                    for x in range(K):
                        result[at, x] -= value * d[a, x]
            for j in range(nd):
                value = D[k, c, j] * scale[k, j]
                if value != 0.0:
                    for x in range(K):
                        result[at, x] -= value * d[nz + j, x]
            for m in range(nc):
                if coloured[m] == c:
                    for x in range(K):
                        result[at, x] -= d[nz + nd + m, x]
            for a in range(n):
                value = gain[i, a]
                for x in range(K):
                    d[a, x] += value * result[at, x]
            value = 1.0 / size[i]
            for x in range(K):
                result[at, x] *= value
        if k + 1 == S or first[k + 1]:
            continue
        for a in range(nz):
            for x in range(K):
                moved[a, x] = 0.0
            for b in range(nz):
                value = A[k, a, b]
                if value != 0.0:
                    for x in range(K):
                        moved[a, x] += value * d[b, x]
            for j in range(nd):
                value = B[k, a, j] * scale[k, j]
                if value != 0.0:
                    for x in range(K):
                        moved[a, x] += value * d[nz + j, x]
        for a in range(nz):
            for x in range(K):
                d[a, x] = moved[a, x]
        for j in range(nd):
            for x in range(K):
                d[nz + j, x] *= fade[k, j]
        for m in range(nc):
            for x in range(K):
                d[nz + nd + m, x] *= slow[k, m]
