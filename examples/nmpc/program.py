"""The quadratic program of a real-time iteration, sparse, stage by stage, for PIQP (Schwan et al., CDC 2023).

Its unknowns are steps from the plan: of a stage's state z and of its control, which is the rates of the commands and
the slack of the track. Its constraints are where a stage leads and the two edges of the track.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as cs
import numpy as np
from numpy.typing import NDArray
from prediction import Prediction
from wishes import Wishes

Array = NDArray[np.float64]

LEAST = 1e-8
"""Curvature of what costs nothing."""


class Linear(NamedTuple):
    """What the problem is like about a plan, at its N stages.

    Attributes
    ----------
    after, steps : (N, n) and (N, n, n + m), where stages lead, and its derivatives by z and rates.
    off, change : (N, r) and (N, r, n), deviations at the plan's next stage, and their derivatives.
    kept, moves : (N, soft) and (N, soft, n), what is to stay within -1 and 1 there, and its derivatives.
    """

    after: Array
    steps: Array
    off: Array
    change: Array
    kept: Array
    moves: Array


class Program:
    """The program for one vehicle.

    Parameters
    ----------
    prediction, wishes : see there.
    soft : how many quantities are to stay within -1 and 1.
    """

    def __init__(self, prediction: Prediction, wishes: Wishes, soft: int) -> None:
        n, m, N = prediction.size, prediction.inputs, wishes.stages
        self._shape, self._newest, units = (n, m, soft, N), prediction.newest, wishes.units
        self._low, self._high, self._fastest = wishes.low / units, wishes.high / units, wishes.fastest / units
        self._thrift, self._price = (units / wishes.rates) ** 2, wishes.beyond
        width = n + m + soft
        self._A = np.zeros((N, n + 2 * soft, width + n))
        own = prediction.own
        self._A[:, :n, : n + m], self._A[:, :n, width:] = prediction.pattern, -np.eye(n)
        self._A[:, n : n + soft, n + m : width] = -np.eye(soft)
        self._A[:, n + soft :, n + m : width] = np.eye(soft)
        self._A[:, n:, width : width + own] = 1.0
        self._H = np.zeros((N + 1, width, width))
        prices = np.concatenate((self._thrift, np.full(soft, self._price)))
        self._H[:, :n, :n], self._H[:, :own, :own], self._H[:-1, n:, n:] = np.eye(n), 1.0, np.diag(prices)
        self._unknowns = N * width + n
        self._in_A = _places(self._A, self._A.shape[1], width, (N * self._A.shape[1], self._unknowns))
        self._in_H = _places(self._H, width, width, (self._unknowns, self._unknowns))
        options = {"error_on_fail": False, "print_time": False}
        self._solver = cs.conic("program", "piqp", {"h": self._in_H[0], "a": self._in_A[0]}, options)

    def solved(self, z: Array, plan: Array, rates: Array, linear: Linear) -> tuple[Array, Array] | None:
        """A better plan and its rates; None where the program was not solved.

        Parameters
        ----------
        z : (n,) as measured.
        plan, rates : (N + 1, n) and (N, m), about which everything is linear.
        linear : what was found there.
        """
        n, m, soft, N = self._shape
        after, steps, off, change, kept, moves = linear
        self._A[:, :n, : n + m] = steps
        self._A[:, n:, n + m + soft :] = np.concatenate((moves, moves), axis=1)
        self._H[:, :n, :n] = LEAST * np.eye(n)
        self._H[1:, :n, :n] += change.transpose(0, 2, 1) @ change
        gradient = np.zeros((N + 1, n + m + soft))
        gradient[1:, :n] = np.einsum("kr,krn->kn", off, change)
        gradient[:-1, n : n + m], gradient[:-1, n + m :] = self._thrift * rates, self._price

        low, high = np.full((N + 1, n + m + soft), -np.inf), np.full((N + 1, n + m + soft), np.inf)
        low[0, :n] = high[0, :n] = z - plan[0]
        low[1:, self._newest] = self._low - plan[1:, self._newest]
        high[1:, self._newest] = self._high - plan[1:, self._newest]
        low[:-1, n : n + m], high[:-1, n : n + m] = -self._fastest - rates, self._fastest - rates
        low[:-1, n + m :] = 0.0
        least, most = np.full((N, n + 2 * soft), -np.inf), np.full((N, n + 2 * soft), np.inf)
        least[:, :n] = most[:, :n] = plan[1:] - after
        most[:, n : n + soft], least[:, n + soft :] = 1.0 - kept, -1.0 - kept

        (H, at_H), (A, at_A), u = self._in_H, self._in_A, self._unknowns
        found = self._solver(
            h=cs.DM(H, self._H.ravel()[at_H]), a=cs.DM(A, self._A.ravel()[at_A]), g=gradient.ravel()[:u],
            lbx=low.ravel()[:u], ubx=high.ravel()[:u], lba=least.ravel(), uba=most.ravel(),
        )  # fmt: skip
        if not self._solver.stats()["success"]:
            return None
        w = np.append(np.asarray(found["x"]), np.zeros(m + soft)).reshape(N + 1, -1)
        return plan + w[:, :n], rates + w[:-1, n : n + m]


def _places(blocks: Array, down: int, across: int, shape: tuple[int, int]) -> tuple[cs.Sparsity, NDArray[np.int64]]:
    """Pattern of a matrix of blocks, each so far down and across from the one before, and its entries among theirs."""
    stage, row, column = np.nonzero(blocks)
    rows, columns = stage * down + row, stage * across + column
    order = np.lexsort((rows, columns))
    pattern = cs.Sparsity.triplet(*shape, rows[order].tolist(), columns[order].tolist())
    return pattern, np.flatnonzero(blocks)[order]
