"""Condensed Gauss-Newton with bounds, a line search, and damping where the line search fails.

Every step solves the small dense normal equations that remain after eliminating the nodes; the nodes then follow by
simulation, so that every point is matched and the objective alone decides whether a step is accepted. This is safe
because models with memory are stable on their own predictions. (Moving the nodes to first order only, with a filter on
the gaps, was tried on a network of 544 weights: it wandered where this method descends.)

A step is first shortened, and damped only if that fails: on networks, damping alone (Levenberg-Marquardt) creeps along
curved valleys that a shortened Gauss-Newton step crosses in a tenth of the steps.

`least_within` minimises a quadratic function within bounds, which gives one step of every search in this module.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Literal

import numpy as np
import scipy.linalg as la
from scipy.linalg import lapack

from ...base.shorthands import Array, Index, Mask
from ..least_squares import LeastSquares, Matched, NormalEquations
from .secant import MissingCurvature

LEAST_RIDGE = 1e-12
"""Share of an unknown's curvature that is always added to it, so that rounding cannot leave H singular."""
INWARD = 1e-12
"""A bound is released if the gradient at it points inward by more than this share of the steepest gradient."""


def least_within(H: Array, g: Array, low: Array, high: Array, free: Mask, damping: float = 0.0) -> Array:
    """Minimiser of g d + d H d / 2 within low <= d <= high, zero where not free.

    A primal active-set method (Nocedal & Wright, Numerical Optimization, 2nd ed., Sec. 16.5): from a zero step, walk to
    the minimiser over the inactive unknowns, stop at the first bound in the way and activate it; release a bound whose
    gradient points inward. It descends in every iteration, which clipping a step would not.

    Parameters
    ----------
    H : (n, n) positive semidefinite.
    g, low, high : (n,).
    free : (n,) which components of d may be nonzero.
    damping : share of an unknown's curvature that is added to it.
    """
    scale = H.diagonal().copy()
    scale[scale <= 0] = 1.0
    added = (damping + LEAST_RIDGE) * scale
    unit = 1.0 / np.sqrt(scale)  # scale unknowns by their curvature: their SI units span orders of magnitude
    step = np.where(free, np.minimum(np.maximum(0.0, low), high), 0.0)
    slope, free = g + (H @ step + added * step if step.any() else step), free & (low < high)
    at_low, at_high = free & (low >= step) & (slope > 0), free & (high <= step) & (slope < 0)
    for _ in range(3 * len(g) + 10):
        movable = np.flatnonzero(free & ~at_low & ~at_high)
        moving = unit[movable]
        move = moving * _unit_step(H, moving, added[movable], -moving * slope[movable], movable)
        bound = np.where(move < 0, low[movable], high[movable])
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            share = np.where(move != 0, (bound - step[movable]) / move, np.inf)
        nearest = float(share.min(initial=1.0))
        step[movable] += min(max(nearest, 0.0), 1.0) * move
        if nearest < 1.0:
            blocking = share <= nearest
            step[movable[blocking]] = bound[blocking]
            at_low[movable[blocking & (move < 0)]] = True
            at_high[movable[blocking & (move > 0)]] = True
            slope = g + H @ step + added * step
            continue
        if not (at_low | at_high).any():
            break
        slope = g + H @ step + added * step
        scaled_slope = slope * unit
        inward = np.where(at_low, -scaled_slope, np.where(at_high, scaled_slope, 0.0))
        released = int(np.argmax(inward))
        if inward[released] <= INWARD * max(float(np.max(np.abs(g * unit))), 1e-300):
            break
        at_low[released] = at_high[released] = False
    return step


def _unit_step(H: Array, unit: Array, added: Array, b: Array, movable: Index) -> Array:
    """Solution of the equations of the movable unknowns, scaled by `unit`, with `added` curvature."""
    if not len(movable):
        return b
    if 2 * len(movable) <= len(H):
        inner, by, ridge = H[movable[:, None], movable], unit, added * unit**2
    else:  # zeros for the others take less time than a selection
        by, ridge, of_all = np.zeros(len(H)), np.ones(len(H)), np.zeros(len(H))
        inner, by[movable], ridge[movable], of_all[movable], b = H.copy(), unit, added * unit**2, b, of_all
    inner *= by
    inner *= by[:, None]
    inner.ravel("K")[:: len(by) + 1] += ridge  # its diagonal
    result = solved(inner, b, overwrite=True)
    return result if len(result) == len(movable) else result[movable]


def solved(H: Array, b: Array, overwrite: bool = False) -> Array:
    """H^-1 b for a positive definite H, by Cholesky; by least squares if rounding left H singular.

    `overwrite`: H may be overwritten.
    """
    diagonal = H.diagonal().copy()
    # H is symmetric, so H.T is H in LAPACK's column order without a copy
    _, result, failed = lapack.dposv(H.T, b, overwrite_a=overwrite)
    if not failed:
        return np.asarray(result)
    above = np.triu(H, 1)  # the other triangle was overwritten by the factor
    return np.asarray(la.lstsq(above + above.T + np.diag(diagonal), b)[0])


LEAST_DAMPING, FIRST_DAMPING, MOST_DAMPING = 1e-5, 1e-7, 1e8
"""Damping as a share of an unknown's curvature: smallest for a line search, first for Levenberg-Marquardt, and the one
at which a search gives up."""
PROBE, MOST_BEND = 0.1, 0.5
"""Share of a step at which its curvature is probed; largest norm of a correction, as a share of the step's."""
ROUNDING = 1e-14
"""Relative distance at which a step to a bound has reached it."""
EXTRAPOLATED = 0.01
"""Share of the tolerance that a predicted decrease must reach if convergence is extrapolated and not evaluated: in 27
solves whose next decrease had been extrapolated, the actual one was up to 12 times as large."""
SAME_STEP = 0.99
"""A step whose predicted decrease exceeds this share of a refused step's counts as the same step: the damping has not
changed it yet."""
PATIENCE = 4
NEGLIGIBLE = 1e-3
"""Networks have flat, curved valleys in which the objective creeps. A fit that gains less than this share of its
objective in PATIENCE steps has stopped learning anything visible in its residuals."""

Search = Literal["line_search", "levenberg_marquardt"]


class Status(Enum):
    """How a solver ended, in words."""

    CONVERGED = "converged"
    STOPPED = "stopped by the caller before convergence"
    EARLY = "stopped early, where the validation recording is fitted best"
    INTERRUPTED = "interrupted; the best point so far is kept"
    STEP_LIMIT = "step limit reached before convergence"
    SLOW = (
        "progress became negligible before convergence; further steps would change the fit by far less than its error"
    )
    STALLED = "no step improved the fit further, though the gradient is not zero"
    TOO_FAST = "the motion became too fast for the sample time"
    NOT_FINITE = "the model is not finite at the starting point"


@dataclass(frozen=True)
class Solution:
    """Final point of a solver.

    Attributes
    ----------
    x : (unknowns,) parameters.
    nodes : the problem's simulation at x.
    status : why the solver ended.
    steps : accepted steps.
    objective : half the sum of squared residuals, priors included.
    decrement : predicted further decrease of the objective, relative to the objective; 0 at an optimum.
    history : objective after each step, the starting value first.
    """

    x: Array
    nodes: Matched
    status: Status
    steps: int
    objective: float
    decrement: float
    history: tuple[float, ...]


OnStep = Callable[[int, float, Array], bool]
"""Called after each step with its number, the objective and the unknowns; False stops."""


def gauss_newton(
    problem: LeastSquares,
    x: Array,
    *,
    max_steps: int = 100,
    tolerance: float = 1e-8,
    negligible: float = NEGLIGIBLE,
    search: Search = "line_search",
    on_step: OnStep | None = None,
) -> Solution:
    """Minimise a lifted least-squares problem.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) starting parameters.
    max_steps : largest number of accepted steps.
    tolerance : stop when the predicted decrease of a full Gauss-Newton step is below this share of the objective.
    negligible : stop when PATIENCE steps together gain less than this share of the objective; 0 never stops.
    search : how a failing step is mended: "line_search" shortens it first, which suits hundreds of weights,
        "levenberg_marquardt" damps it, which suits a few physical parameters in a bent valley of condition 1e9.
    on_step : progress callback that can also stop the solver.

    Returns
    -------
    Solution. Ctrl-C ends with `Status.INTERRUPTED` and the best point so far.
    """
    point = _Point(np.clip(x, *problem.bounds), [], np.inf)
    history: list[float] = []
    status, steps, decrement, state = Status.STEP_LIMIT, 0, np.inf, _Search(search)
    try:
        point = _at(problem, point.x)
        if not np.isfinite(point.objective):
            return Solution(point.x, point.nodes, Status.NOT_FINITE, 0, np.inf, np.inf, ())
        history.append(point.objective)
        while True:
            equations = problem.normal_equations(point.x, point.nodes)
            if not (np.all(np.isfinite(equations.H)) and np.all(np.isfinite(equations.g))):
                status = Status.STALLED if steps else Status.NOT_FINITE
                break
            if search == "levenberg_marquardt":
                state.missing_curvature.learn(point.x, equations)
            trial_step, size = state.first(problem, point.x, equations), max(point.objective, 1e-300)
            decrement = _least_decrease(problem, point.x, equations, trial_step) / size
            if decrement <= tolerance:
                decrement = max(decrement, predicted_reduction(problem, point.x, equations) / size)
            if decrement <= tolerance:
                status = Status.CONVERGED
                break
            if len(history) > PATIENCE and history[-1 - PATIENCE] - history[-1] < negligible * history[-1]:
                status = Status.SLOW
                break
            if steps == max_steps:
                break
            better = _descent(problem, point, equations, state, trial_step)
            if better is None:
                decrement = max(decrement, predicted_reduction(problem, point.x, equations) / size)
                status = Status.CONVERGED if decrement <= max(tolerance, 1e-6) else Status.STALLED
                break
            point, steps = better, steps + 1
            history.append(point.objective)
            if on_step is not None and not on_step(steps, point.objective, point.x):
                status = Status.STOPPED
                break
            if state.extrapolates_below(EXTRAPOLATED * tolerance * point.objective):
                status, decrement = Status.CONVERGED, EXTRAPOLATED * tolerance
                break
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    return Solution(point.x, point.nodes, status, steps, point.objective, float(decrement), tuple(history))


@dataclass(frozen=True)
class _Point:
    x: Array
    nodes: Matched
    objective: float


def _at(problem: LeastSquares, x: Array) -> _Point:
    nodes = problem.simulated_nodes(x)
    return _Point(x, nodes, problem.objective(x, nodes))


class _Search:
    """State that a step search keeps between steps: step length, damping, and the curvature missing from J'J."""

    def __init__(self, kind: Search) -> None:
        self.kind = kind
        self.share = 1.0
        self.damping = LEAST_DAMPING if kind == "line_search" else FIRST_DAMPING
        self.missing_curvature = MissingCurvature()
        self._kept, self._left = 0.0, np.inf
        self._undamped_gain: Callable[[], float] = float

    def learn(self, predicted: float, actual: float, undamped_gain: Callable[[], float]) -> None:
        """Learn from an accepted step, and extrapolate the next predicted decrease.

        Near an optimum, predicted decreases shrink by a constant factor, if the last step's prediction came true.

        Parameters
        ----------
        predicted, actual : predicted and actual decrease of the objective.
        undamped_gain : returns the further decrease predicted for the same step without damping.
        """
        self._left = predicted**2 / self._kept if predicted < self._kept else np.inf
        self._kept = predicted if abs(actual - predicted) < 0.25 * predicted else 0.0
        self._undamped_gain = undamped_gain

    def extrapolates_below(self, least: float) -> bool:
        """Whether the next predicted decrease, even without damping, extrapolates to at most `least`."""
        return self._left <= least and self._left + self._undamped_gain() <= least

    def first(self, problem: LeastSquares, x: Array, equations: NormalEquations) -> Array | None:
        """The first trial step of a line search; None for Levenberg-Marquardt."""
        return _step(problem, x, equations, self.damping) if self.kind == "line_search" else None


def _descent(
    problem: LeastSquares, point: _Point, equations: NormalEquations, state: _Search, trial_step: Array | None
) -> _Point | None:
    """The next point; None if no step lowers the objective."""
    if trial_step is not None:
        return _shortened(problem, point, equations, state, trial_step)
    return _damped(problem, point, equations, state)


def _shortened(
    problem: LeastSquares, point: _Point, equations: NormalEquations, state: _Search, step: Array
) -> _Point | None:
    """Shorten a step until the objective falls by a share of the predicted decrease; damp it if that fails."""
    while state.damping < MOST_DAMPING:
        predicted = -float(equations.g @ step)
        share = min(1.0, 2.5 * state.share)
        while share > 1e-3:
            trial = _at(problem, _within(problem, point.x + share * step))
            if trial.objective < point.objective - 1e-2 * share * predicted:
                state.share, state.damping = share, max(state.damping / 10.0, LEAST_DAMPING)
                return trial
            share *= 0.4
        state.share, state.damping = 1.0, state.damping * 100.0
        step = _step(problem, point.x, equations, state.damping)
    return None


def _damped(problem: LeastSquares, point: _Point, equations: NormalEquations, state: _Search) -> _Point | None:
    """Damp a step until the objective falls by a fair share of the decrease that the quadratic model predicts.

    The quadratic model is Gauss-Newton's, or the one with the missing curvature if that predicted the last step better.

    Positive unknowns step in their logarithms: valleys of constant products, such as B C D, all that a recording
    identifies of a tyre at small slip, are then straight.
    """
    by, missing_curvature = np.where(_positive(problem, point.x), point.x, 1.0), state.missing_curvature
    scaled = NormalEquations(equations.H * np.outer(by, by), equations.g * by)
    corrected = missing_curvature.added(scaled, by, problem.free)
    refused = np.inf
    while state.damping < MOST_DAMPING:
        with_missing = missing_curvature.trusted and corrected is not None
        model = corrected if with_missing and corrected is not None else scaled
        step = _step(problem, point.x, model, state.damping, logarithmic=True)
        predicted = max(_decrease(model, step), 1e-300)
        if predicted > SAME_STEP * refused:
            state.damping *= 10.0
            continue
        trial = (
            _at(problem, _moved(problem, point.x, step))
            if with_missing
            else _tried(problem, point, step, predicted, scaled, equations, state.damping)
        )
        actual = point.objective - trial.objective
        if actual > 1e-3 * predicted:
            if actual > 0.75 * predicted:
                state.damping *= 0.1
            elif actual < 0.25 * predicted:
                state.damping *= 4.0
            state.learn(predicted, actual, partial(_undamped_gain, problem, point.x, model, predicted))
            if corrected is not None:
                taken = _taken(problem, point.x, trial.x)
                missing_curvature.compare(actual, _decrease(corrected, taken), _decrease(scaled, taken))
            return trial
        del trial  # the simulation of hours of data is large
        if with_missing:  # try once more without the missing curvature
            missing_curvature.trusted = False
        else:
            state.damping, refused = 10.0 * state.damping, predicted
    return None


def _tried(
    problem: LeastSquares,
    point: _Point,
    step: Array,
    predicted: float,
    scaled: NormalEquations,
    equations: NormalEquations,
    damping: float,
) -> _Point:
    """The point after a step; with the second-order correction if the step gains less than predicted and it helps."""
    trial = _at(problem, _moved(problem, point.x, step))
    if (point.objective - trial.objective) / predicted < 0.75:  # the valley bends: follow it
        bend = _bend(problem, point, scaled, step, equations, damping)
        if np.any(bend):
            bent = _at(problem, _moved(problem, point.x, step + bend))
            return bent if bent.objective < trial.objective else trial
    return trial


def _moved(problem: LeastSquares, x: Array, step: Array) -> Array:
    """The point after a step that is taken in logarithms of the positive unknowns."""
    with np.errstate(over="ignore", invalid="ignore"):  # zero times infinity, for unknowns that are not positive
        return _within(problem, np.where(_positive(problem, x), x * np.exp(step), x + step))


def _taken(problem: LeastSquares, x: Array, there: Array) -> Array:
    """The step from x to `there`, in logarithms of the positive unknowns."""
    step, positive, moved = np.zeros_like(x), _positive(problem, x), there != x
    np.subtract(there, x, out=step, where=moved & ~positive)
    step[moved & positive] = np.log(there[moved & positive] / x[moved & positive])
    return step


def _within(problem: LeastSquares, x: Array) -> Array:
    """x clipped to the bounds; unknowns within rounding of a bound are set to it."""
    for bound in problem.bounds:
        with np.errstate(invalid="ignore"):  # infinite ones
            x = np.where(np.isfinite(bound) & (np.abs(x - bound) <= ROUNDING * np.abs(bound)), bound, x)
    return np.clip(x, *problem.bounds)


def _bend(
    problem: LeastSquares,
    point: _Point,
    scaled: NormalEquations,
    step: Array,
    equations: NormalEquations,
    damping: float,
) -> Array:
    """The second-order correction of a step, half the geodesic acceleration; zero if larger than MOST_BEND allows.

    The residuals' curvature along the step comes from one simulation after a share PROBE of the step. Source: Transtrum
    & Sethna, Improvements to the Levenberg-Marquardt algorithm, arXiv:1201.5885 (2012).
    """
    if equations.frozen_gradient is None:
        return np.zeros_like(step)
    ahead = _moved(problem, point.x, PROBE * step)
    by = np.where(_positive(problem, point.x), point.x, 1.0)
    with np.errstate(all="ignore"):
        gradient_ahead = by * equations.frozen_gradient(ahead, problem.simulated_nodes(ahead))
        curvature = 2 / PROBE * ((gradient_ahead - scaled.g) / PROBE - scaled.H @ step)
    moving = problem.free & (step != 0)
    if not np.all(np.isfinite(curvature[moving])) or not np.any(moving):
        return np.zeros_like(step)
    scale = np.diag(scaled.H)[moving]
    unit = 1.0 / np.sqrt(np.where(scale > 0, scale, 1.0))
    inner = scaled.H[np.ix_(moving, moving)] * np.outer(unit, unit)
    inner[np.diag_indices_from(inner)] += damping + 1e-12
    bend = np.zeros_like(step)
    bend[moving] = -0.5 * unit * solved(inner, unit * curvature[moving])
    size = float(np.linalg.norm(bend[moving] / unit)) / max(float(np.linalg.norm(step[moving] / unit)), 1e-300)
    return bend if size <= MOST_BEND else np.zeros_like(step)


def _positive(problem: LeastSquares, x: Array) -> Mask:
    """Free unknowns with a positive lower bound and a finite value (infinity is an effect's null: no limit at all)."""
    return np.asarray(problem.free & (problem.bounds[0] > 0) & np.isfinite(x))


def _step(
    problem: LeastSquares, x: Array, equations: NormalEquations, damping: float, logarithmic: bool = False
) -> Array:
    """The damped Gauss-Newton step within bounds: the exact minimiser of the quadratic model in the box."""
    finite = np.where(np.isfinite(x), x, 0.0)  # an effect may be at an infinite null: no limit at all
    low, high = problem.bounds[0] - finite, problem.bounds[1] - finite
    if logarithmic:
        positive = _positive(problem, x)
        low[positive] = np.log(problem.bounds[0][positive] / x[positive])
        high[positive] = np.log(problem.bounds[1][positive] / x[positive])
    return least_within(equations.H, equations.g, low, high, problem.free, damping)


def predicted_reduction(problem: LeastSquares, x: Array, equations: NormalEquations) -> float:
    """Decrease of the objective within bounds that the normal equations predict."""
    return _decrease(equations, _step(problem, x, equations, 0.0))


def _decrease(equations: NormalEquations, step: Array) -> float:
    return float(-(equations.g @ step + 0.5 * step @ equations.H @ step))


def _undamped_gain(problem: LeastSquares, x: Array, model: NormalEquations, predicted: float) -> float:
    """Further decrease predicted for a step in logarithms without damping."""
    return _decrease(model, _step(problem, x, model, 0.0, logarithmic=True)) - predicted


def _least_decrease(problem: LeastSquares, x: Array, equations: NormalEquations, trial_step: Array | None) -> float:
    """Lower bound of a full step's predicted decrease: the best single unknown's, or that of the damped trial step."""
    single = _single_decrease(problem, x, equations)
    return single if trial_step is None else max(single, _decrease(equations, trial_step))


def _single_decrease(problem: LeastSquares, x: Array, equations: NormalEquations) -> float:
    """Largest decrease that the quadratic model predicts for moving one unknown alone, within its bounds.

    A full step's is no smaller, but for rounding: if the entries of H span more than double precision, the full step
    can come out as zero, and a point with an enormous gradient would pass for an optimum.
    """
    curvature = equations.H.diagonal()
    moving = problem.free & (curvature > 0) & np.isfinite(x)
    if not moving.any():
        return 0.0
    g, h = equations.g[moving], curvature[moving]
    with np.errstate(all="ignore"):
        low, high = ((bound - x)[moving] for bound in problem.bounds)
        step = np.minimum(np.maximum(-g / h, low), high)
        return float(np.fmax.reduce(-(g * step + 0.5 * h * step**2), initial=0.0))
