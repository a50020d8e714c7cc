"""One filter over the runs of a recording: where it starts, what it goes through, and smoothed backwards."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..base.shorthands import Array
from ..engine.compiler import CannotCompile, tell_slow
from .kernel import CompiledFilter, History, Kept, Kind, SigmaPoints
from .laid import LaidRun
from .plain import PlainFilter
from .state_space import StateSpace

GATE = 5.0
"""Readings further off than so many standard deviations count as noisier."""
START = 3.0
"""How much worse than its noise a state is known where a reading starts it, and than its scale where none does."""


class Filter(Protocol):
    """What filters: compiled, or in plain Python."""

    def run(
        self, x: Array, P: Array, s: Array, y: Array, p: Array, gate: float, kept: Kept
    ) -> tuple[Array, History | None]:
        """As `CompiledFilter.run`."""


@dataclass(frozen=True)
class Filtering:
    """A state space, what filters it, and how.

    Attributes
    ----------
    space : the model.
    filter : EKF or UKF.
    gate : in standard deviations.
    """

    space: StateSpace
    filter: Filter
    gate: float = GATE

    def costs(self, runs: Sequence[LaidRun], p: Array) -> Array:
        """(L,) half of minus two log-likelihoods of parameters (L, parameters), constants left out."""
        cost = np.zeros(len(p))
        x, P = self.begin(runs[0], p)
        for k, run in enumerate(runs):
            if k:
                x, P = self.begin(run, p, (x, P))
            cost += self.filter.run(x, P, run.segments, run.readings, p, self.gate, "nothing")[0]
        return cost

    def histories(self, runs: Sequence[LaidRun], p: Array, kept: Kept = "filtered") -> list[History]:
        """What the filter went through with parameters (parameters,), run by run."""
        result = []
        x, P = self.begin(runs[0], p[None])
        for k, run in enumerate(runs):
            if k:
                x, P = self.begin(run, p[None], (x, P))
            _, history = self.filter.run(x, P, run.segments, run.readings, p[None], self.gate, kept)
            assert history is not None
            result.append(history)
        return result

    def innovations(self, runs: Sequence[LaidRun], p: Array) -> list[tuple[Array, Array]]:
        """What filters of parameters (L, parameters) did not foresee, run by run: (L, S, m), and their variance."""
        result = []
        x, P = self.begin(runs[0], p)
        for k, run in enumerate(runs):
            if k:
                x, P = self.begin(run, p, (x, P))
            _, history = self.filter.run(x, P, run.segments, run.readings, p, self.gate, "innovations")
            assert history is not None
            result.append((history.off, history.spread))
        return result

    def begin(self, laid_run: LaidRun, p: Array, before: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
        """States and covariances at a run's start, (L, n) and (L, n, n).

        Parameters
        ----------
        before : those at the end of the run before, from which what is tracked is carried over.
        """
        space, model = self.space, self.space.model
        noise = dict(zip(space.noises, p.T[model.size :], strict=True))
        first = {name: laid_run.readings[0, k] for k, name in enumerate(model.outputs)}
        read = tuple(name for name in space.trace.names if np.isfinite(first.get(name, np.nan)))
        readings = np.array([first[name] for name in read])
        x, sd = np.zeros((len(p), space.size)), np.zeros((len(p), space.size))
        known = space.trace.size + len(space.tracked)
        parameters = np.ascontiguousarray(p[:, : model.size])
        x[:, : space.trace.size] = space.start(read)(readings, laid_run.run.inputs[0], parameters)
        for k, state in enumerate(model.states):
            sd[:, k] = START * noise[f"noise_{state.name}"] if state.name in read else START * state.scale
        settled = slice(len(space.trace.names), space.trace.size)
        sd[:, settled] = 0.1 * np.abs(x[:, settled]) + 1e-3
        x[:, space.trace.size : known] = [one.start for one in space.tracked]
        sd[:, space.trace.size : known] = [one.start_sd for one in space.tracked]
        for k, name in enumerate(space.coloured):
            sd[:, known + k] = noise[f"colour_{name}"]
        P = sd[:, :, None] ** 2 * np.eye(space.size)
        if before is not None:
            kept = slice(space.trace.size, known)
            x[:, kept], P[:, kept, kept] = before[0][:, kept], before[1][:, kept, kept]
        return x, P


def filtering(
    space: StateSpace, kind: Kind, points: SigmaPoints, gate: float = GATE, *, many: bool = False
) -> Filtering:
    """A compiled filter where there is a compiler, else one in plain Python, which is a thousand times slower.

    The compiled code of `many` EKFs side by side differs from that of one. The environment variable GREYBOX_COMPILE=1
    makes a missing compiler an error, 0 asks for plain Python.
    """
    stated = os.environ.get("GREYBOX_COMPILE")
    if stated != "0":
        try:
            return Filtering(space, CompiledFilter(space, kind, points, many=many), gate)
        except CannotCompile as error:
            if stated:
                raise
            tell_slow("The filter", "a thousand", error)
    return Filtering(space, PlainFilter(space, kind, points), gate)


LEAST = 1e-12
"""Variance, in shares of the largest, that any direction is taken to have: what has none cannot be divided by."""


def smoothed(history: History) -> tuple[Array, Array]:
    """States (S, n) and their covariance (S, n, n) given all readings of the run.

    The Rauch-Tung-Striebel smoother goes backwards through what a filter went through,

        G = forward predicted_P^-1,   x_s = x + G (x_s' - x'),   P_s = P + G (P_s' - P') G^T

    with ' for the next segment, x' and P' as predicted for it and `forward` the covariance of x with x'. It serves EKF
    and UKF alike. Source: Sarkka, Bayesian Filtering and Smoothing, 2013, Sec. 9.1 and 9.3.
    """
    x, P = history.filtered.copy(), history.filtered_P.copy()
    ahead = history.predicted_P[1:]
    scale = np.sqrt(np.maximum(np.einsum("kii->ki", ahead), 1e-300))
    scaled = ahead / (scale[:, :, None] * scale[:, None, :]) + LEAST * np.eye(x.shape[1])
    back = np.linalg.solve(scaled, history.forward[:-1].swapaxes(1, 2) / scale[:, :, None]) / scale[:, :, None]
    for k in range(len(x) - 2, -1, -1):
        G = back[k].T
        x[k] += G @ (x[k + 1] - history.predicted[k + 1])
        P[k] += G @ (P[k + 1] - history.predicted_P[k + 1]) @ G.T
    return x, P
