"""Scatter of model errors on recordings that are expected: under noise and unknown forces.

A diagnosis whitens residuals by the filter of these errors. A fit weighs residuals as independent, each by a factor for
its correlation. Model errors last for moments, are as large as a share of the forces, and grow where tyres work. The
sums of scores J'r then scatter by more than J'J, and the covariance of the estimate is H^-1 S H^-1 (as of the fit
itself, `uncertainty.sandwich`), S = J'J + the scatter under the model error of `estimation.model_error`. The
information of a plan is the inverse of that, H S^-1 H.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from ...base.machine_code import begun
from ...base.shorthands import Array, Index, Mask
from ...datasets.recording import Recording
from ...engine.motion.simulator import Simulator
from ...models.motion_model import MotionModel
from ..estimation.axes import scalars, shifting
from ..estimation.bench import Bench
from ..estimation.model_error import Amplitudes, ForceSizes, Linearised, linearised, model_error, unknown_forces
from ..estimation.unknown_forces import knows_unknown_forces, with_unknown_forces

ROUGH_RATE = 20.0
"""Rows a second with nearly the information of all: vehicles turn with 1 to 3 Hz, models of scale with up to 5."""


def sandwich(H: Array, S: Array) -> Array:
    """(q, q) inverse of an estimate's covariance, H S^-1 H; zero where it is not finite.

    Parameters
    ----------
    H : (q, q) curvature of the squares, all other free parameters eliminated.
    S : (q, q) covariance of their gradient.
    """
    unit = np.sqrt(np.maximum(np.diag(H), 0.0))
    there = unit > 0
    result = np.zeros_like(H)
    if not np.all(np.isfinite(H)) or not np.all(np.isfinite(S)) or not np.any(there):
        return result
    among, size = np.ix_(there, there), np.outer(unit[there], unit[there])
    inner = H[among] / size @ np.linalg.pinv(S[among] / size, rcond=1e-10, hermitian=True) @ (H[among] / size)
    result[among] = 0.5 * (inner + inner.T) * size
    return result


class Rough:
    """A model whose delays and latencies are all held at none: each of them cuts every row in two.

    They are known to milliseconds, while motions take tenths of a second: they shift information without changing it.

    Parameters
    ----------
    model : the model.
    kept : parameters that are not held, delays among them.
    """

    def __init__(self, model: MotionModel, kept: Collection[str]) -> None:
        late = shifting(model).difference(kept)
        held = [(k, one) for k, one in scalars(model) if one.name in late and one.bounds[0] <= 0]
        self.places = np.array([k for k, _ in held], dtype=np.intp)
        self.model = model.with_parameters(*(replace(one, value=0.0, fixed=True) for _, one in held))

    def of(self, p: Array) -> Array:
        """(parameters,) without delays."""
        result = np.array(p)
        result[self.places] = 0.0
        return result


class ExpectedErrors:
    """Model errors on recordings that are expected."""

    def __init__(self, model: MotionModel, amplitudes: Amplitudes) -> None:
        self.model, self.amplitudes = with_unknown_forces(model), amplitudes
        self.known = knows_unknown_forces(self.model)
        self.simulator = Simulator(self.model)
        self.simulator.kernel.prepare()
        self._sizes: ForceSizes | None = None

    def _about(self, recordings: Sequence[Recording], p: Array) -> tuple[Bench, Array, Linearised]:
        """The bench, all its parameters, and the error dynamics about its simulation."""
        bench, parameters = Bench(self.model, recordings, self.simulator), np.zeros(self.model.size)
        parameters[: len(p)] = p
        self._sizes = self._sizes or ForceSizes(bench)
        return bench, parameters, linearised(bench, parameters, self.amplitudes.noise, self._sizes)

    def scatter(self, recordings: Sequence[Recording], p: Array, G: Array, starts: Sequence[Index]) -> Array:
        """(recordings, q, q) covariance of each one's sum over readings of G times the errors by unknown forces.

        Parameters
        ----------
        recordings : commands, and readings that are expected; one unbroken run each, N rows in all.
        p : (parameters,) of the model where to linearise.
        G : (N, outputs, q).
        starts : of each recording, rows at which predictions start afresh.
        """
        if not self.known:
            return np.zeros((len(recordings), G.shape[2], G.shape[2]))
        bench, parameters, about = self._about(recordings, p)
        first = np.append(np.flatnonzero(about.first), len(about.first))
        begins = about.first.copy()
        if any(len(rows) > 1 for rows in starts):
            for (plan, _), rows, a in zip(bench.trajectory(parameters), starts, first, strict=False):
                begins[a + plan.row_segment[rows]] = True
        forces = unknown_forces(about, [self.amplitudes])
        scale, fade = forces.sd[..., 0], forces.correlation[..., 0]
        result = []
        for a, b in zip(first[:-1], first[1:], strict=True):
            c, d = about.pointer[a], about.pointer[b]
            result.append(_shaken(
                about.A[a:b], about.B[a:b] * scale[a:b, None], about.C[a:b], about.D[a:b] * scale[a:b, None],
                fade[a:b].copy(), begins[a:b], about.pointer[a : b + 1] - c, about.channel[c:d],
                np.ascontiguousarray(G[about.row[c:d], about.channel[c:d]]),
            ))  # fmt: skip
        return np.stack(result)

    def whitener(self, recording: Recording, p: Array, every: int = 1) -> Callable[[Array], Array]:
        """Function that whitens errors (N, outputs, ...); zero where there is no reading.

        Parameters
        ----------
        recording : commands, and readings that are expected.
        p : (parameters,) of the model where to linearise.
        every : number of readings that each row stands for.
        """
        fewer = replace(self.amplitudes, noise=self.amplitudes.noise / np.sqrt(every))
        if not self.known:
            counted = Bench(self.model, [recording], self.simulator).counted
            return lambda e: (e.T * (counted / np.hypot(fewer.noise, fewer.colour)).T).T
        bench, _, about = self._about([recording], p)
        return model_error(about, fewer, bench.counted).white


@begun
def _shaken(  # pragma: no cover
    A: Array, B: Array, C: Array, D: Array, fade: Array, begins: Mask,
    pointer: Index, channel: Index, G: Array,
) -> Array:  # fmt: skip
    """(q, q) covariance from unknown forces: of each of their shocks, by the adjoint error equations, backwards.

    The forces are processes of unit variance that decay by `fade` over a segment; they last over rows at which
    predictions start afresh, errors of the states do not.
    """
    forces, q = B.shape[2], G.shape[1]
    of_state, of_force, result = np.zeros((A.shape[1], q)), np.zeros((forces, q)), np.zeros((q, q))
    for k in range(len(A) - 1, -1, -1):
        left = fade[k].copy().reshape(forces, 1)
        shock = np.sqrt(1.0 - left * left) * of_force
        result += shock.T @ shock
        of_force = left * of_force + B[k].T @ of_state
        of_state = A[k].T @ of_state
        for r in range(pointer[k], pointer[k + 1]):
            of_state += np.outer(C[k, channel[r]], G[r])
            of_force += np.outer(D[k, channel[r]], G[r])
        if begins[k]:
            of_state[:] = 0.0
    return result + of_force.T @ of_force
