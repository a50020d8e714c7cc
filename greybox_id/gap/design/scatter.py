"""How far a fit of a plan would scatter: noise and the forces that no equations know, as its least squares take them.

A fit counts residuals as if they were independent, each for as much as the correlation leaves that it has seen. What
equations leave out lasts for moments, is as large as a share of the forces, and grows where tyres work. The sums of
scores J'r then scatter by more than J'J, and the covariance of the estimate is H^-1 S H^-1 (as of the fit itself,
`uncertainty.sandwich`), S = J'J + the scatter under the model error of `estimation.model_error`. The information of a
plan is the inverse of that, H S^-1 H.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...base.machine_code import begun
from ...base.shorthands import Array, Index
from ...datasets.recording import Recording
from ...engine.motion.shooting import MotionProblem
from ...engine.motion.simulator import Simulator
from ...engine.motion.trace import MotionTrace
from ...models.motion_model import MotionModel
from ..estimation.bench import Bench
from ..estimation.calibration import CAL
from ..estimation.model_error import Amplitudes, ForceSizes, linearised, model_error
from ..estimation.unknown_forces import knows_unknown_forces, with_unknown_forces


@dataclass(frozen=True)
class Scores:
    """What a recording tells of q numbers, all else that is free let go.

    Attributes
    ----------
    H : (q, q) curvature of the squares.
    S : (q, q) covariance of their gradient.
    """

    H: Array
    S: Array

    @property
    def information(self) -> Array:
        """(q, q) inverse of the estimate's covariance, H S^-1 H; zero where it is not finite."""
        unit = np.sqrt(np.maximum(np.diag(self.H), 0.0))
        there = unit > 0
        result = np.zeros_like(self.H)
        if not np.all(np.isfinite(self.H)) or not np.all(np.isfinite(self.S)) or not np.any(there):
            return result
        among, size = np.ix_(there, there), np.outer(unit[there], unit[there])
        H, S = self.H[among] / size, self.S[among] / size
        inner = H @ np.linalg.pinv(S, rcond=1e-10, hermitian=True) @ H
        result[among] = 0.5 * (inner + inner.T) * size
        return result


class Rough:
    """A model of which all delays and latencies are held at none: each of them cuts every row in two.

    They are known to milliseconds beside motions of tenths of a second, and shift what is told without changing it.

    Parameters
    ----------
    model : the model.
    kept : parameters that stay as they are, the delays among them, too.
    """

    def __init__(self, model: MotionModel, kept: Collection[str] = ()) -> None:
        trace = MotionTrace(model)
        columns = trace.timing.jac_sparsity(0, 0).get_triplet()[1] if trace.shift_count else []
        names = [parameter.name for parameter in model.parameters for _ in range(parameter.size)]
        self.places = np.array([k for k in sorted(set(columns)) if names[k] not in kept], dtype=np.intp)
        held = {names[k] for k in self.places if model[names[k]].shape == () and model[names[k]].bounds[0] <= 0}
        self.places = np.array([k for k in self.places if names[k] in held], dtype=np.intp)
        self.model = model.with_parameters(*(replace(model[name], value=0.0, fixed=True) for name in held))

    def of(self, p: Array) -> Array:
        """(parameters,) without delays."""
        result = np.array(p)
        result[self.places] = 0.0
        return result


def by_interval(problem: MotionProblem, x: Array) -> Iterator[tuple[Index, Array, Array]]:
    """Per interval: rows that it predicts, weighted residuals (rows, outputs), their derivative by its unknowns."""
    nodes = problem.simulated_nodes(x)
    order, edges = nodes.cut.by_owner
    order = np.arange(edges[-1]) if order is None else order
    for (e, J), a, b in zip(problem.residuals(x, nodes), edges[:-1], edges[1:], strict=True):
        yield np.unique(order[a:b] // e.shape[1]), e, J


class ForceScatter:
    """What unknown forces add to the covariance of the sum of scores, on recordings that are expected.

    Parameters
    ----------
    model : that is fitted.
    noise : (outputs,) standard deviations of its readings, with which it is told where a recording starts.

    Notes
    -----
    Model error is of the size that diagnoses of vehicles without a gap left (`estimation.calibration`: form, floor,
    memory).
    """

    def __init__(self, model: MotionModel, noise: Array) -> None:
        self.model, self.noise = with_unknown_forces(model), noise
        self.simulator = Simulator(self.model)
        self.simulator.kernel.prepare()
        self.sizes: ForceSizes | None = None

    def of(self, recordings: Sequence[Recording], p: Array, G: Array, starts: Sequence[Index], every: int = 1) -> Array:
        """(recordings, q, q) covariance of each one's sum over its readings of G times what the forces make of them.

        Parameters
        ----------
        recordings : commands, and readings that are expected; one unbroken run each, N rows in all.
        p : (parameters,) of the model where to linearise.
        G : (N, outputs, q).
        starts : of each recording, rows at which predictions start afresh.
        every : so many readings stand behind each.
        """
        noise = self.noise / np.sqrt(every)
        if not knows_unknown_forces(self.model):
            return np.zeros((len(recordings), G.shape[2], G.shape[2]))
        value = np.concatenate([p, np.zeros(self.model.size - len(p))])
        bench = Bench(self.model, recordings, self.simulator)
        self.sizes = self.sizes or ForceSizes(bench)
        about = linearised(bench, value, noise, self.sizes)
        first = np.append(np.flatnonzero(about.first), len(about.first))
        begins = about.first.copy()
        if any(len(rows) > 1 for rows in starts):
            for (plan, _), rows, a in zip(bench.trajectory(value), starts, first, strict=False):
                begins[a + plan.row_segment[rows]] = True
        floor = np.where(about.axis == 0, 0.5, 1.0) * CAL.floor * about.mass
        scale = np.hypot(floor, CAL.form * about.force)
        fade = np.exp(-about.length / CAL.memory)
        known = np.ascontiguousarray(G[about.row, about.channel])
        result = []
        for a, b in zip(first[:-1], first[1:], strict=True):
            c, d = about.pointer[a], about.pointer[b]
            result.append(
                _shaken(
                    about.A[a:b],
                    about.B[a:b],
                    about.C[a:b],
                    about.D[a:b],
                    scale[a:b],
                    fade[a:b],
                    begins[a:b],
                    about.pointer[a : b + 1] - c,
                    about.channel[c:d],
                    known[c:d],
                )
            )
        return np.stack(result)


class Whitening:
    """Whitens residuals on recordings that are expected, as a diagnosis does.

    Parameters
    ----------
    model : that is diagnosed.
    amplitudes : of model error and noise.
    """

    def __init__(self, model: MotionModel, amplitudes: Amplitudes) -> None:
        self.model, self.amplitudes = with_unknown_forces(model), amplitudes
        self.simulator = Simulator(self.model)
        self.simulator.kernel.prepare()
        self.sizes: ForceSizes | None = None

    def of(self, recording: Recording, p: Array, every: int = 1) -> Callable[[Array], Array]:
        """What makes errors (N, outputs, ...) independent and of unit variance; where there is no reading, zero.

        Parameters
        ----------
        recording : commands, and readings that are expected.
        p : (parameters,) of the model where to linearise.
        every : so many readings stand behind each.
        """
        amplitudes = self.amplitudes
        fewer = replace(amplitudes, noise=amplitudes.noise / np.sqrt(every))
        bench = Bench(self.model, [recording], self.simulator)
        if not knows_unknown_forces(self.model):
            return lambda e: (e.T * (bench.counted / np.hypot(fewer.noise, amplitudes.colour)).T).T
        self.sizes = self.sizes or ForceSizes(bench)
        whole = np.concatenate([p, np.zeros(self.model.size - len(p))])
        return model_error(linearised(bench, whole, amplitudes.noise, self.sizes), fewer, bench.counted).white


@begun
def _shaken(  # pragma: no cover
    A: Array, B: Array, C: Array, D: Array, scale: Array, fade: Array, begins: NDArray[np.bool_],
    pointer: Index, channel: Index, G: Array,
) -> Array:  # fmt: skip
    """(q, q) what unknown forces add: of each of their shocks, by the adjoint of the errors' equations, the last first.

    The forces are processes of unit variance times `scale`, of which `fade` is left after a segment; they last over
    rows at which predictions start afresh, errors of the states do not.
    """
    S, n, _ = A.shape
    forces, q = B.shape[2], G.shape[1]
    of_state, of_force, moved = np.zeros((n, q)), np.zeros((forces, q)), np.zeros((n, q))
    result = np.zeros((q, q))
    for k in range(S - 1, -1, -1):
        shock = 1.0 - fade[k] * fade[k]
        for j in range(forces):
            for x in range(q):
                for y in range(x + 1):
                    result[x, y] += shock * of_force[j, x] * of_force[j, y]
        for j in range(forces):
            for x in range(q):
                of_force[j, x] *= fade[k]
            for a in range(n):
                value = B[k, a, j] * scale[k, j]
                if value != 0.0:
                    for x in range(q):
                        of_force[j, x] += value * of_state[a, x]
        moved[:] = 0.0
        for a in range(n):
            for i in range(n):
                value = A[k, a, i]
                if value != 0.0:
                    for x in range(q):
                        moved[i, x] += value * of_state[a, x]
        of_state[:] = moved
        for r in range(pointer[k], pointer[k + 1]):
            c = channel[r]
            for a in range(n):
                value = C[k, c, a]
                if value != 0.0:
                    for x in range(q):
                        of_state[a, x] += value * G[r, x]
            for j in range(forces):
                value = D[k, c, j] * scale[k, j]
                if value != 0.0:
                    for x in range(q):
                        of_force[j, x] += value * G[r, x]
        if begins[k]:
            of_state[:] = 0.0
    for j in range(forces):
        for x in range(q):
            for y in range(x + 1):
                result[x, y] += of_force[j, x] * of_force[j, y]
    for x in range(q):
        for y in range(x):
            result[y, x] = result[x, y]
    return result
