"""Strengths of priors chosen by blocked cross-validation on the training data alone.

Neighbouring samples of a recording are nearly copies of each other, so whole stretches are held out, and the
samples within a window of a held-out stretch are left out of training too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .engine.shooting import Problem
from .engine.trace import Trace
from .parameter import Array
from .recording import Recording
from .solvers.gauss_newton import Solution, gauss_newton

FOLDS = 6
FACTORS = (0.5, 1.0, 2.0, 4.0)
"""Strengths tried, as factors on the priors as stated by the model."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Choice:
    """What cross-validation chose.

    Attributes
    ----------
    strengths : name -> factor.
    error : cross-validated error at the choice, in noise standard deviations.
    tried : every combination tried with its error.
    """

    strengths: dict[str, float]
    error: float
    tried: tuple[tuple[dict[str, float], float], ...]


def choose_strengths(
    trace: Trace, recordings: Sequence[Recording], noise: Array, start: Array, progress: Progress | None = None
) -> Choice:
    """Coordinate search over the strengths of a model's priors, open loop, each by blocked cross-validation.

    Parameters
    ----------
    noise : (outputs,) residual standard deviations.
    start : (parameters,) where fits start.
    """
    names = sorted({p.prior.strength for p in trace.model.parameters if p.prior is not None and p.prior.strength})
    tried: dict[tuple[float, ...], float] = {}

    def error(strengths: Mapping[str, float]) -> float:
        key = tuple(strengths[name] for name in names)
        if key not in tried:
            problem = Problem(trace, recordings, noise=noise, strengths=strengths)
            tried[key] = cross_validated_error(problem, problem.unknowns(start))
            if progress is not None:
                named = ", ".join(f"{n} {s:g}" for n, s in strengths.items())
                progress(f"{trace.model.name}: cross-validation, {named}: {tried[key]:.4f} of the noise")
        return tried[key]

    best = dict.fromkeys(names, 1.0)
    for name in names:
        best = min(({**best, name: factor} for factor in FACTORS), key=error)
    return Choice(best, error(best), tuple((dict(zip(names, k, strict=True)), v) for k, v in tried.items()))


def cross_validated_error(problem: Problem, start: Array, folds: int = FOLDS, max_steps: int = 25) -> float:
    """Root mean square error over held-out stretches, in noise standard deviations.

    One fit to everything gives the starting point of the folds' fits, which are therefore short; their number of
    steps is limited so that a fold forgets what its start knew of the held-out stretch.
    """
    everything = problem.keep
    whole = gauss_newton(problem, start, tolerance=1e-4, max_steps=max_steps)
    square, count = 0.0, 0
    for kept, held_out in blocks(problem, folds):
        problem.keep = kept
        solution = gauss_newton(problem, whole.x, tolerance=1e-4, max_steps=10)
        square += _square(problem, solution, held_out)
        count += int(sum(np.sum(rows[run.predicted]) for run, rows in zip(problem.runs, held_out, strict=True)))
    problem.keep = everything
    return float(np.sqrt(square / (count * len(problem.noise))))


def blocks(problem: Problem, folds: int) -> Iterator[tuple[list[Array], list[Array]]]:
    """Contiguous stretches of about a `folds`-th of the data, none across a join: rows kept, rows held out."""
    gap = problem.trace.memory
    originals = problem.runs[: problem.copies]
    total = sum(len(run) for run in originals)
    for number, run in enumerate(originals):
        pieces = max(1, round(folds * len(run) / total))
        edges = np.linspace(0, len(run), pieces + 1).astype(int)
        for start, stop in zip(edges[:-1], edges[1:], strict=True):
            kept = [np.ones(len(other)) for other in problem.runs]
            held_out = [np.zeros(len(other)) for other in problem.runs]
            for image in range(number, len(problem.runs), problem.copies):  # its mirror image would tell it
                kept[image][max(0, start - gap) : stop + gap] = 0.0
            held_out[number][start:stop] = 1.0
            if any(np.any(rows[run.predicted]) for run, rows in zip(problem.runs, kept, strict=True)):
                yield kept, held_out


def _square(problem: Problem, solution: Solution, held_out: list[Array]) -> float:
    total = 0.0
    for k, run in enumerate(problem.runs):
        rows = held_out[k][run.predicted]
        if np.any(rows):
            p = solution.x[problem.layout.index[k]]
            seen, _ = problem.sensing(run.predict(p), None, p)
            total += float(rows @ np.sum(((seen - run.measured[run.predicted]) / problem.noise) ** 2, axis=1))
    return total
