"""Choose the strengths of priors by blocked cross-validation on the training data alone.

Neighbouring samples of a recording are nearly copies of each other, so whole stretches are held out, and samples within
one window of a held-out stretch are dropped from training too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.errors import BadInput
from ..base.processes import side_by_side
from ..base.shorthands import Array
from ..datasets.recording import Recording, join
from ..engine.shooting import Problem
from ..engine.solvers.gauss_newton import Solution, Status, gauss_newton
from ..engine.trace import Trace
from ..models.memory_model import MemoryModel

FOLDS = 6
STRETCH = 6
"""Length of a held-out stretch in windows: some seconds."""
FACTORS = (0.5, 1.0, 2.0, 4.0)
"""Strengths tried, as factors on the priors as stated by the model."""

NOISE_SHARE = 0.15
"""Noise assumed while structures are compared, as a share of a signal's spread."""

WORST = 3.0
"""Errors are clipped at this many noise standard deviations: a manoeuvre recorded once, such as the only start from
rest, is extrapolated when held out, and would decide everything."""

WHOLE_TOLERANCE, WHOLE_STEPS = 1e-3, 25
TOLERANCE, FOLD_STEPS = 1e-4, 3
"""Tolerances and largest numbers of steps of the fit to all data and of a fold's fit; the tolerance is a predicted
decrease relative to the objective. Folds that end after a single step remember the held-out data, which favours weak
priors: with little training data, errors on other runs are up to a fifth larger. After three they do not: in 63 choices
(the networks of the MS-NN paper; real and synthetic runs) ten differ from those after ten steps, with errors on other
runs that are 0.3 % smaller on average."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Choice:
    """Strengths chosen by cross-validation.

    Attributes
    ----------
    strengths : name -> factor.
    error : cross-validated error at the choice, in noise standard deviations.
    tried : every combination tried with its error; to first order where that was no better.
    x : (unknowns,) final unknowns of the fit to all data at the choice; None if it was not reached.
    interrupted : whether the search was stopped before its end.
    """

    strengths: dict[str, float]
    error: float
    tried: tuple[tuple[dict[str, float], float], ...]
    x: Array | None = None
    interrupted: bool = False


@dataclass(frozen=True)
class Folds:
    """A fit to all data, and one without each fold.

    Attributes
    ----------
    x : (unknowns,) final unknowns of the fit to all data.
    ends : for each fold, its problem, the final unknowns of its fit, and the weights of its held-out rows.
    squares : (folds,) mean square error over the held-out stretches, in noise variances; errors clipped at `WORST`.
    """

    x: Array
    ends: tuple[tuple[Problem, Array, list[Array]], ...]
    squares: Array

    def nearby(self, strengths: Mapping[str, float]) -> Array:
        """(folds,) `squares` with other strengths, to first order: one step of each fold from its final unknowns."""
        squares = []
        for fold, x, held_out in self.ends:
            other = fold.counted(strengths=strengths)
            step = _finished(gauss_newton(other, x, tolerance=TOLERANCE, on_step=lambda *_: False))
            squares.append(_square(other, step.x, held_out))
        return np.array(squares)


def choose_strengths(
    trace: Trace, recordings: Sequence[Recording], noise: Array, start: Array, progress: Progress | None = None
) -> Choice:
    """Coordinate search over the strengths of a model's priors, open loop, each by blocked cross-validation.

    Priors are knowledge: a strength departs from 1 only if cross-validation improves by more than the standard error of
    the paired difference over folds; otherwise the noise of the folds would choose. Only strengths that are better to
    first order are fitted: a fold's optimum moves with a strength along its own Hessian, which is known at the optimum
    (Giordano et al., A Swiss army infinitesimal jackknife, AISTATS 2019).

    Parameters
    ----------
    noise : (outputs,) residual standard deviations.
    start : (unknowns,) start of the fit with strengths as stated; its final unknowns start the others.
    """
    names = sorted({p.prior.strength for p in trace.model.parameters if p.prior is not None and p.prior.strength})
    laid = Problem(trace, recordings, noise=noise)
    chosen, best_folds, interrupted = dict.fromkeys(names, 1.0), None, False
    tried: dict[tuple[float, ...], float] = {}

    def scored(strengths: Mapping[str, float], squares: Array) -> Array:
        tried[tuple(strengths.values())] = root_mean(squares)
        if progress is not None:
            named = ", ".join(f"{n} {s:g}" for n, s in strengths.items())
            progress(
                f"{trace.model.name}: cross-validation with prior strengths {named}: error {root_mean(squares):.4f} "
                "times the noise"
            )
        return squares

    def fitted(strengths: Mapping[str, float], begin: Array) -> Folds:
        folds = cross_validated(laid.counted(strengths=strengths), begin)
        scored(strengths, folds.squares)
        return folds

    try:
        best_folds = fitted(chosen, start)
        for name in names:
            options = [option for factor in FACTORS if (option := {**chosen, name: factor}) != chosen]
            first_order = [scored(option, best_folds.nearby(option)) for option in options]
            best = int(np.argmin([np.mean(squares) for squares in first_order]))
            if np.mean(first_order[best]) > (1 - TOLERANCE) * np.mean(best_folds.squares):
                continue
            candidate = fitted(options[best], best_folds.x)
            if _surely_better(candidate.squares, best_folds.squares):
                chosen, best_folds = options[best], candidate
    except KeyboardInterrupt:
        interrupted = True
        if progress is not None:
            progress(f"{trace.model.name}: cross-validation interrupted; the best strengths so far are used")
    return Choice(
        strengths=chosen,
        error=tried.get(tuple(chosen.values()), float("nan")),
        tried=tuple((dict(zip(names, key, strict=True)), error) for key, error in tried.items()),
        x=None if best_folds is None else best_folds.x,
        interrupted=interrupted,
    )


def _surely_better(new: Array, old: Array) -> bool:
    """Whether the mean over folds falls by more than the standard error of the paired difference."""
    gain = old - new
    return bool(np.mean(gain) > np.std(gain, ddof=1) / np.sqrt(len(gain)))


def root_mean(squares: Array) -> float:
    """Root mean square error over all folds."""
    return float(np.sqrt(np.mean(squares)))


def choose_structure(
    models: Sequence[MemoryModel], recordings: Sequence[Recording], progress: Progress | None = None, jobs: int = 1
) -> tuple[int, float]:
    """The structure that predicts held-out stretches best, open loop, priors as stated.

    For models with parts, the first part decides: its structure is the one that varies. Returns the index in `models`,
    and the CPU seconds of other processes.
    """
    measured = join(recordings, "training data")

    def work(number: int) -> float:
        model = models[number]
        part = model.parts[0] if model.parts else model
        spread = np.array([max(float(np.nanstd(measured[name])), 1e-9) for name in part.outputs])
        problem = Problem(Trace(part), recordings, noise=spread * NOISE_SHARE)
        return NOISE_SHARE * root_mean(cross_validated(problem, problem.start).squares)

    def report(number: int, error: float) -> bool:
        if progress is not None:
            words = f"cross-validated error {error:.4f} of the signals' spread"
            progress(f"structure {number + 1} of {len(models)}: {words}")
        return True

    done = side_by_side(work, len(models), jobs, report)
    if done.interrupted:
        raise KeyboardInterrupt
    return int(np.argmin(done.results)), done.cpu_seconds


def cross_validated(problem: Problem, start: Array) -> Folds:
    """Fit all data, and all but each fold.

    The fit to all data gives the folds' fits their start, which makes them short, and their normal equations at that
    start. They continue until a step's predicted decrease is below `TOLERANCE`, which lets a fold forget what its start
    learned from the held-out stretch.
    """
    whole = _finished(gauss_newton(problem, start, tolerance=WHOLE_TOLERANCE, max_steps=WHOLE_STEPS))
    folds = list(blocks(problem, FOLDS))
    if len(folds) < 2:
        longest = max(len(run) for run in problem.runs)
        raise BadInput(
            f"The training data are too short for cross-validation of {problem.trace.model.name}: their longest "
            f"unbroken run has {longest} samples, and a held-out stretch has {STRETCH * problem.trace.memory}. Record "
            "more, "
            "or choose structure and strength of regularisation yourself (‹settings›, ‹strength›)."
        )
    ends, squares = [], []
    for fold, (_, held_out) in zip(
        problem.folds(whole.x, whole.nodes, [kept for kept, _ in folds]), folds, strict=True
    ):
        end = _finished(gauss_newton(fold, whole.x, tolerance=TOLERANCE, max_steps=FOLD_STEPS)).x
        ends.append((fold, end, held_out))
        squares.append(_square(fold, end, held_out))
    return Folds(whole.x, tuple(ends), np.array(squares))


def _finished(solution: Solution) -> Solution:
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return solution


def blocks(problem: Problem, folds: int) -> Iterator[tuple[list[Array], list[Array]]]:
    """Weights of kept rows and of held-out rows, per fold; every row with a prediction is held out once.

    Runs are cut into stretches some windows long, dealt out to the folds in turn, so that every fold is tested on
    all of the recording's regimes: a fold that lost the only hard braking would be a test of extrapolation.
    """
    gap = problem.trace.memory
    length = STRETCH * gap
    originals = problem.runs[: problem.copies]
    stretches = [
        (number, start, min(start + length, len(run)))
        for number, run in enumerate(originals)
        for start in range(0, len(run), length)
    ]
    folds = min(folds, len(stretches))
    for fold in range(folds):
        kept = [np.ones(len(run)) for run in problem.runs]
        held_out = [np.zeros(len(run)) for run in problem.runs]
        for number, start, stop in stretches[fold::folds]:
            held_out[number][start:stop] = 1.0
            for image in range(number, len(problem.runs), problem.copies):  # the mirror image would leak it
                kept[image][max(0, start - gap) : stop + gap] = 0.0
        if any(np.any(rows[run.predicted]) for run, rows in zip(problem.runs, kept, strict=True)):
            yield kept, held_out


def _square(problem: Problem, x: Array, held_out: list[Array]) -> float:
    """Mean square error at x over the rows held out."""
    total, count = 0.0, 0.0
    for run, rows, simulated in zip(problem.runs, held_out, problem.simulated(x, []), strict=True):
        counted = rows[run.predicted]
        error = np.minimum(np.abs(simulated - run.measured[run.predicted]) / problem.noise, WORST)
        total += float(counted @ np.sum(error**2, axis=1))
        count += float(np.sum(counted))
    return total / (count * len(problem.noise))
