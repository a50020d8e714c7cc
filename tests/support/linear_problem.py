"""Linear problems out of given numbers, and noise of known colour."""

from types import SimpleNamespace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.signal import lfilter

from greybox_id.fitting.uncertainty import uncertainty


class Linear:
    """A linear problem out of given derivatives, at its optimum: per piece, y (rows, outputs) and J (rows, outputs, p).

    R: priors about zero; index: per piece, the unknowns it sees.
    """

    def __init__(self, y, J, R=None, index=None, bounds=None):
        index = index or [np.arange(J[0].shape[2])] * len(J)
        size = max(own.max() for own in index) + 1
        self.layout, self.copies = SimpleNamespace(index=tuple(index), size=size), len(J)
        self.free = np.ones(size, dtype=bool)
        self.bounds = bounds or (np.full(size, -np.inf), np.full(size, np.inf))
        self.R = sp.csr_matrix((0, size) if R is None else R)
        self.y, self.J = y, J
        X = np.vstack([self.wide(k) for k in range(len(J))] + [self.R.toarray()])
        self.X, self.data = X, np.concatenate([own.ravel() for own in y] + [np.zeros(self.R.shape[0])])
        self.x = la.lstsq(X, self.data)[0]

    def wide(self, k):
        """(rows * outputs, unknowns)."""
        full = np.zeros((self.J[k][..., 0].size, self.layout.size))
        full[:, self.layout.index[k]] = self.J[k].reshape(len(full), -1)
        return full

    def residuals(self, x, nodes):
        for y, J, index in zip(self.y, self.J, self.layout.index, strict=True):
            yield J @ x[index] - y, J

    def normal_equations(self, x, nodes):
        return SimpleNamespace(H=self.X.T @ self.X, g=self.X.T @ (self.X @ x - self.data))

    def told(self):
        return uncertainty(self, self.x, [])


def coloured(rng, rows, rho, sd=0.1):
    white = sd * np.sqrt(1 - rho**2) * rng.standard_normal((*np.atleast_1d(rows)[:-1], np.atleast_1d(rows)[-1] + 200))
    return lfilter([1.0], [1.0, -rho], white)[..., 200:]
