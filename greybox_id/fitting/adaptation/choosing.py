"""What a short recording says for each way of adapting a model to it, by blocked cross-validation on it alone.

Everything is linearised about the fit once: a fold's fit is then the solution of a linear system, and comparing forty
candidates on eight folds costs less than one step of a fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack
from scipy.special import stdtrit

from ...base.shorthands import Array, Index
from ...datasets.recording import Recording
from ...engine.least_squares import prior_rows
from ...engine.shooting import Problem
from ...engine.trace import Trace
from ...models.memory_model import MemoryModel
from ..scores.memory import predictions
from ..scores.timing import moving
from .subsets import members

STRENGTHS = (1.0, 0.5, 0.2)
"""What the old recording counts beside the new one, as a factor on its standard deviations: at one, a second of it
tells the car as well as a new second does. Infinity, the fit itself, is the candidate that is always there."""
FOLD, GAP, SHORT = 5.0, 1.0, 1.0
"""Seconds held out at a time, left out beside them, and that count as one piece where candidates are compared."""
CONFIDENCE = 0.95
BETWEEN_RUNS = 0.25
"""Standard deviation of the logarithm of an error between runs of one car and driver: what the four runs of the
RoboRacer's training recording scatter about their own network, 0.089, 0.080, 0.056 and 0.055 rad/s."""
TOLD_BY = 3
"""Degrees of freedom that this counts for beside a fit's own training runs: it is told by four runs."""


@dataclass(frozen=True)
class AdaptedCandidate:
    """One way of adapting a part.

    Attributes
    ----------
    free : the set of parameters that moves; "" for none.
    strength : of what the training data said, one of `STRENGTHS`; infinite where nothing moves.
    timing : whether readings are aligned first.
    pieces : (pieces,) cross-validated mean square of pieces of the new seconds, in noise variances.
    """

    free: str
    strength: float
    timing: bool
    pieces: Array

    @property
    def error(self) -> float:
        """Cross-validated error, in noise standard deviations."""
        return float(np.sqrt(np.mean(self.pieces)))

    @property
    def words(self) -> str:
        """As a person says it."""
        named = [
            *(["timing"] if self.timing else []),
            *([f"{self.free} (strength {self.strength:g})"] if self.free else []),
        ]
        return " + ".join(named) or "zero-shot"


class LinearisedPart:
    """A part about its own values on the new seconds.

    Parameters
    ----------
    part : with priors about its own values.
    recording : its new seconds; rows without readings are left out.
    noise : output -> standard deviation that residuals count as.
    learnt : (parameters, parameters) what the training data said about the part, as a precision.
    """

    def __init__(self, part: MemoryModel, recording: Recording, noise: Mapping[str, float], learnt: Array) -> None:
        self.part, self.recording, self.learnt = part, recording, learnt
        self.problem = Problem(Trace(part), [recording], noise=np.array([noise[name] for name in part.outputs]))
        result = list(self.problem.residuals(self.problem.start, []))
        self.r = np.concatenate([item for item, _ in result])
        self.J = np.concatenate([item for _, item in result])
        first = [run.rows.start + run.first for run in self.problem.runs]
        self.rows = np.concatenate(
            [start + np.arange(len(item)) for start, (item, _) in zip(first, result, strict=True)]
        )
        starts = [start for start, _ in recording.runs]
        self.run = np.searchsorted(starts, self.rows, side="right") - 1
        per = 1.0 / part.sample_time
        self.fold, self.piece = (self._cut(starts, round(seconds * per)) for seconds in (FOLD, SHORT))
        self.gap = round(GAP * per)

    def _cut(self, starts: Sequence[int], length: int) -> Index:
        """Number of the stretch of so many rows that a row lies in, counted within runs."""
        key = self.run * 10**6 + (self.rows - np.array(starts)[self.run]) // max(1, length)
        return np.asarray(np.unique(key, return_inverse=True)[1])

    def mask(self, free: str) -> Array:
        """(parameters,) whether a parameter of a set moves."""
        names = members(free, self.part) if free else ()
        return np.concatenate([np.full(parameter.size, parameter.name in names) for parameter in self.part.parameters])

    def candidates(self, free: str, timing: bool) -> list[AdaptedCandidate]:
        """Every strength of a set, cross-validated; the fit itself where the set is empty."""
        moving = self.mask(free)
        if not np.any(moving):
            return [] if free else [AdaptedCandidate("", np.inf, timing, self._pieces(self.r))]
        J = self.J[:, :, moving]
        R = prior_rows(self.part.parameters)[0].toarray()[:, moving]
        believed, learnt = R.T @ R, self.learnt[np.ix_(moving, moving)]
        predicted = {strength: self.r.copy() for strength in STRENGTHS}
        for fold in range(int(self.fold.max()) + 1):
            held = self.fold == fold
            low, high = self.rows[held].min(), self.rows[held].max()
            near = (self.rows >= low - self.gap) & (self.rows <= high + self.gap) & (self.run == self.run[held][0])
            A, b = J[~near].reshape(-1, J.shape[2]), self.r[~near].ravel()
            H, g = A.T @ A, A.T @ b
            for strength, item in predicted.items():
                item[held] += J[held] @ -_solved(H + believed + strength**2 * learnt, g)
        return [AdaptedCandidate(free, strength, timing, self._pieces(item)) for strength, item in predicted.items()]

    def _pieces(self, residuals: Array) -> Array:
        square = np.mean(residuals**2, axis=1)
        return np.bincount(self.piece, square) / np.bincount(self.piece)

    def stretches(self, residuals: Array) -> Array:
        """Mean squares of stretches of several seconds, which hardly know of each other."""
        return np.bincount(self.fold, np.mean(residuals**2, axis=1)) / np.bincount(self.fold)


def _solved(H: Array, b: Array) -> Array:
    unit = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    _, result, failed = lapack.dposv(H * np.outer(unit, unit) + 1e-12 * np.eye(len(H)), unit * b)
    return np.asarray(unit * result) if not failed else np.zeros_like(b)


def chosen(candidates: Sequence[AdaptedCandidate]) -> AdaptedCandidate:
    """The best one, or the simplest that is not surely worse; candidates in order, the simplest first.

    Simpler is what moves fewer parameters, and of one set what is held more to what was learnt. It is preferred to the
    best where the difference of their pieces is not above its standard error.
    """
    best = min(candidates, key=lambda item: float(np.mean(item.pieces)))
    return next(
        candidate for candidate in candidates if candidate is best or not surely_better(best.pieces, candidate.pieces)
    )


def surely_better(new: Array, old: Array) -> bool:
    """Whether pieces fall by more than the standard error of their paired difference."""
    if len(new) != len(old):
        return bool(np.mean(new) < np.mean(old))
    gain = old - new
    return bool(np.mean(gain) > np.std(gain, ddof=1) / np.sqrt(len(gain))) if len(gain) > 1 else False


def between_runs(part: MemoryModel, trained: Sequence[Recording] | None) -> float:
    """Standard deviation of the logarithm of an error between runs: what training runs tell, beside `BETWEEN_RUNS`."""
    logs = []
    for recording in trained or ():
        seen = predictions(part, recording)
        driven = moving(recording)[seen.rows] > 0
        for run in np.unique(seen.run):
            value = driven & (seen.run == run)
            if np.count_nonzero(value) * recording.sample_time >= FOLD:
                logs.append(
                    0.5 * np.log(max(float(np.mean((seen.predicted[value] - seen.measured[value]) ** 2)), 1e-300))
                )
    if len(logs) < 2:
        return BETWEEN_RUNS
    squares = TOLD_BY * BETWEEN_RUNS**2 + float(np.sum((np.array(logs) - np.mean(logs)) ** 2))
    return float(np.sqrt(squares / (TOLD_BY + len(logs) - 1)))


def foretold(pieces: Array, seconds: float, unit: float = 1.0, between: float = BETWEEN_RUNS) -> tuple[float, float]:
    """95 % interval of the root mean square over so many further seconds, from the pieces that are known, in units.

    Their mean squares scatter about a mean that is not known better than they tell, and what follows may be another
    run: Student's t in their logarithm. The known pieces' run is off the usual as that other one is, by `between` each.
    """
    length = round(FOLD / 2 / SHORT)
    count = len(pieces) // length
    if count < 2:
        return 0.0, np.inf
    longer = pieces[: count * length].reshape(count, length).mean(axis=1)
    spread = float(np.std(np.log(np.maximum(longer, 1e-300)), ddof=1))
    ahead = max(seconds / (length * SHORT), 1.0)
    reach = float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2))
    reach *= np.sqrt(spread**2 * (1 / count + 1 / ahead) + 2 * (2 * between) ** 2)
    middle = float(np.mean(longer))
    return unit * float(np.sqrt(middle * np.exp(-reach))), unit * float(np.sqrt(middle * np.exp(reach)))
