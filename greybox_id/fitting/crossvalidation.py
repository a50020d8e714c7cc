"""Strengths of priors chosen by blocked cross-validation on the training data alone.

Neighbouring samples of a recording are nearly copies of each other, so whole stretches are held out, and the
samples within a window of a held-out stretch are left out of training too.
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
"""Residuals count as this share of a signal's spread while structures are compared."""

WORST = 3.0
"""Errors beyond this many noise standard deviations count as this: what a recording shows once, such as its only
start from rest, is extrapolated when it is held out, and would decide everything."""

NEAR, WHOLE_STEPS = 1e-3, 25
TOLERANCE, FOLD_STEPS = 1e-4, 10
"""When the fit to everything and a fold's fit end: where a step promises less than this share of the objective, or
after so many steps. Folds that end at 1e-3 still know what was held out: on the RoboRacer's training runs weak
priors gain by it, and another strength is chosen."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Choice:
    """What cross-validation chose.

    Attributes
    ----------
    strengths : name -> factor.
    error : cross-validated error at the choice, in noise standard deviations.
    tried : every combination tried with its error.
    x : (unknowns,) where the fit to everything ended at the choice; None where it was not reached.
    interrupted : whether the search was stopped before its end.
    cpu_seconds : of other processes.
    """

    strengths: dict[str, float]
    error: float
    tried: tuple[tuple[dict[str, float], float], ...]
    x: Array | None = None
    interrupted: bool = False
    cpu_seconds: float = 0.0


def choose_strengths(
    trace: Trace, recordings: Sequence[Recording], noise: Array, start: Array, progress: Progress | None = None,
    jobs: int = 1,
) -> Choice:  # fmt: skip
    """Coordinate search over the strengths of a model's priors, open loop, each by blocked cross-validation.

    Priors are knowledge: a strength moves from as stated only where cross-validation is surely better for it, by more
    than the standard error of the difference over folds. Where the folds cannot tell, their noise would choose.

    Parameters
    ----------
    noise : (outputs,) residual standard deviations.
    start : (unknowns,) where the fit starts whose strengths are as stated; the others start where it ends.
    jobs : strengths that are tried at a time.
    """
    names = sorted({p.prior.strength for p in trace.model.parameters if p.prior is not None and p.prior.strength})
    laid = Problem(trace, recordings, noise=noise)
    chosen, interrupted, elsewhere = dict.fromkeys(names, 1.0), False, 0.0
    tried: dict[tuple[float, ...], Array] = {}
    ends: dict[tuple[float, ...], Array] = {}

    def try_all(options: Sequence[Mapping[str, float]]) -> None:
        nonlocal elsewhere
        new = [option for option in options if tuple(option.values()) not in tried]

        def work(number: int) -> tuple[Array, Array]:
            return cross_validated_squares(laid.counted(strengths=new[number]), as_stated)

        def told(number: int, result: tuple[Array, Array]) -> bool:
            if progress is not None:
                named = ", ".join(f"{n} {s:g}" for n, s in new[number].items())
                progress(f"{trace.model.name}: cross-validation, {named}: {root_mean(result[0]):.4f} of the noise")
            return True

        done = side_by_side(work, len(new), jobs, told)
        for number, (squares, x) in sorted(done.by_number.items()):
            key = tuple(new[number].values())
            tried[key], ends[key] = squares, x
        elsewhere += done.cpu_seconds
        if done.interrupted:
            raise KeyboardInterrupt

    def by_fold(strengths: Mapping[str, float]) -> Array:
        return tried[tuple(strengths.values())]

    try:
        as_stated = _of_everything(laid.counted(strengths=chosen), start).x
        for name in names:
            options = [{**chosen, name: factor} for factor in FACTORS]
            try_all(options)
            best = min(options, key=lambda option: np.mean(by_fold(option)))
            if _surely_better(by_fold(best), by_fold(chosen)):
                chosen = best
    except KeyboardInterrupt:
        interrupted = True
        if progress is not None:
            progress(f"{trace.model.name}: cross-validation interrupted; the best strengths so far are used")
    errors = {key: root_mean(squares) for key, squares in tried.items()}
    return Choice(
        strengths=chosen,
        error=errors.get(tuple(chosen.values()), float("nan")),
        tried=tuple((dict(zip(names, key, strict=True)), error) for key, error in errors.items()),
        x=ends.get(tuple(chosen.values())),
        interrupted=interrupted,
        cpu_seconds=elsewhere,
    )


def _surely_better(new: Array, old: Array) -> bool:
    """Whether the mean over folds falls by more than the standard error of the paired difference."""
    gain = old - new
    return bool(np.mean(gain) > np.std(gain, ddof=1) / np.sqrt(len(gain)))


def root_mean(squares: Array) -> float:
    """One error from mean squares of folds."""
    return float(np.sqrt(np.mean(squares)))


def choose_structure(
    models: Sequence[MemoryModel], recordings: Sequence[Recording], progress: Progress | None = None, jobs: int = 1
) -> tuple[int, float]:
    """Which of several structures of a model predicts held-out stretches best, open loop, priors as stated.

    Of models with parts the first part decides, the one whose structure is varied. Returns the place in `models`, and
    the CPU seconds of other processes.
    """
    measured = join(recordings, "training data")

    def work(number: int) -> float:
        model = models[number]
        part = model.parts[0] if model.parts else model
        spread = np.array([max(float(np.nanstd(measured[name])), 1e-9) for name in part.outputs])
        problem = Problem(Trace(part), recordings, noise=spread * NOISE_SHARE)
        return NOISE_SHARE * root_mean(cross_validated_squares(problem, problem.start)[0])

    def told(number: int, error: float) -> bool:
        if progress is not None:
            stated = f"cross-validated error {error:.4f} of the signals' spread"
            progress(f"structure {number + 1} of {len(models)}: {stated}")
        return True

    done = side_by_side(work, len(models), jobs, told)
    if done.interrupted:
        raise KeyboardInterrupt
    return int(np.argmin(done.results)), done.cpu_seconds


def _of_everything(problem: Problem, start: Array) -> Solution:
    solution = gauss_newton(problem, start, tolerance=NEAR, max_steps=WHOLE_STEPS)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return solution


def cross_validated_squares(problem: Problem, start: Array) -> tuple[Array, Array]:
    """Mean square error over the stretches held out, per fold, in noise variances; each error at most `WORST`.

    One fit to everything gives the starting point of the folds' fits, which are therefore short, and the normal
    equations there. They go on until a step promises less than `TOLERANCE`: a fold forgets what its start knew of
    the held-out stretch. Also returns where the fit to everything ended, (unknowns,).
    """
    whole = _of_everything(problem, start)
    squares = []
    dealt = list(blocks(problem, FOLDS))
    folds = problem.folds(whole.x, whole.nodes, [kept for kept, _ in dealt])
    for fold, (_, held_out) in zip(folds, dealt, strict=True):
        solution = gauss_newton(fold, whole.x, tolerance=TOLERANCE, max_steps=FOLD_STEPS)
        if solution.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        scored = sum(np.sum(rows[run.predicted]) for run, rows in zip(problem.runs, held_out, strict=True))
        squares.append(_square(problem, solution, held_out) / (scored * len(problem.noise)))
    if len(squares) < 2:
        longest = max(len(run) for run in problem.runs)
        raise BadInput(
            f"The training data are too short for cross-validation of {problem.trace.model.name}: their longest "
            f"unbroken run has {longest} samples, a stretch held out {STRETCH * problem.trace.memory}. Record more, "
            "or choose structure and strength of regularisation yourself (‹settings›, ‹strength›)."
        )
    return np.array(squares), whole.x


def blocks(problem: Problem, folds: int) -> Iterator[tuple[list[Array], list[Array]]]:
    """Rows kept and rows held out, per fold; every row with a prediction is held out once.

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
            for image in range(number, len(problem.runs), problem.copies):  # its mirror image would tell it
                kept[image][max(0, start - gap) : stop + gap] = 0.0
        if any(np.any(rows[run.predicted]) for run, rows in zip(problem.runs, kept, strict=True)):
            yield kept, held_out


def _square(problem: Problem, solution: Solution, held_out: list[Array]) -> float:
    total = 0.0
    for k, run in enumerate(problem.runs):
        rows = held_out[k][run.predicted]
        if np.any(rows):
            p = solution.x[problem.layout.index[k]]
            seen, _ = problem.sensing(run.predict(p), None, p)
            error = np.minimum(np.abs(seen - run.measured[run.predicted]) / problem.noise, WORST)
            total += float(rows @ np.sum(error**2, axis=1))
    return total
