"""Stated values: estimates proportional to one that the recording does not determine, and those that it contradicts.

The lateral motion of a vehicle with twice the mass, inertia and forces is the same: it determines I_z / m. If m is
stated, I_z has the same relative error as m, and no interval from residuals shows it. In logarithms, a stated value and
estimates then change together without any change of the predictions.

Other stated values are determined together with the estimates: the first step towards the optimum with one more free
parameter is the change that the recording suggests; blocks of the rows left out in turn (jackknife) and the tolerances
that it depends on give its standard deviation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.motion.shooting import MotionProblem
from ...engine.motion.simulator import Simulator
from ...models.model import Model
from ...models.parameter import Parameter, placed
from ..fit import Fit

STEP = 1e-3
"""Relative change of a parameter for finite differences."""
EXACTLY = 1e-6
"""Share of a stated value's squared effect that estimates may leave when they compensate it: the error of exact scaling
at `STEP`, squared."""
ALIKE = 0.01
"""Tolerance of the exponent for proportionality to a stated value, which is one."""
MOST_ROWS, AHEAD = 6000, 1.0
"""Largest number of rows, and horizon, s: scaling shows everywhere."""


FACTS = {"m": ("m",), "wheelbase": ("l_f", "l_r"), "steering_ratio": ("steering_ratio",)}
"""Facts stated about a vehicle, and the parameters that contain them."""
BLOCKS = 16
CONTRADICTED = 5.0
"""Standard deviations from which a fact is contradicted ..."""
OFF = {"m": 0.05, "wheelbase": 0.1, "steering_ratio": 0.1}
"""... and relative change: model errors moved true masses of virtual vehicles by up to 1.7 % at such significance (m of
a single track), and true wheelbases by up to 6.9 %."""


def of_stated(fit: Fit, simulator: Simulator, recordings: Sequence[Recording]) -> dict[str, Any]:
    """Which stated values estimates are proportional to, and which the recordings contradict.

    Stated values are fixed ones; those with tolerances are covered by the intervals.

    Parameters
    ----------
    fit : a fit of equations of motion.
    simulator : of its model.
    recordings : its training recordings.

    Returns
    -------
    "scaling": parameter -> estimates and combinations proportional to it, if no recording determines it;
    "contradicted": fact -> relative change that the longest recording suggests, given the tolerances, and its standard
    deviation.
    """
    model, longest = fit.model, max(recordings, key=len)
    short = longest if len(longest) <= MOST_ROWS else longest.rows(0, MOST_ROWS)
    try:
        problem = MotionProblem(simulator, [short], noise=np.ones(len(model.outputs)), horizon=AHEAD, starts="measured")
    except BadInput:  # the vehicle stands in all these rows
        return {"scaling": {}, "contradicted": {}}
    scalars = [p for p in model.parameters if p.shape == () and float(p.array) != 0.0 and np.isfinite(p.array)]
    free = [p for p in scalars if not p.fixed]
    stated = [p.name for p in scalars if p.fixed and (p.name not in model.effects or p.name in FACTS)]
    if not free:
        return {"scaling": {}, "contradicted": {}}
    follows = {name: _effect(problem, model, name) for name in {*stated, *(p.name for p in free)}}
    without_effects = [name for name in stated if name not in model.effects]
    scaled = _scaling(model, {name: follows[name] for name in without_effects}, {p.name: follows[p.name] for p in free})
    facts = {fact: [follows[n] for n in names] for fact, names in FACTS.items() if {*names} <= {*stated}}
    suggested = _suggested(problem, fit, free, follows, {fact: np.sum(moved, axis=0) for fact, moved in facts.items()})
    contradicted = {name: w for name, w in suggested.items() if abs(w[0]) > max(OFF[name], CONTRADICTED * w[1])}
    return {"scaling": scaled, "contradicted": contradicted}


def _scaling(model: Model, stated: Mapping[str, Array], free: Mapping[str, Array]) -> dict[str, list[str]]:
    """Stated parameter -> estimates and combinations proportional to it."""
    table = np.column_stack([*free.values()])
    result: dict[str, list[str]] = {}
    for name, effect in stated.items():
        compensation = -np.linalg.lstsq(table, effect, rcond=1e-9)[0]
        if float(np.sum((effect + table @ compensation) ** 2)) > EXACTLY * float(np.sum(effect**2)):
            continue
        exponents = dict(zip(free, compensation.tolist(), strict=True))
        all_exponents = exponents | _of_combinations(model, exponents | {name: 1.0})
        scaled = [other for other, exponent in all_exponents.items() if abs(exponent - 1.0) < ALIKE]
        result |= {name: scaled} if scaled else {}
    return result


def _suggested(
    problem: MotionProblem,
    fit: Fit,
    free: Sequence[Parameter],
    follows: Mapping[str, Array],
    facts: Mapping[str, Array],
) -> dict[str, tuple[float, float]]:
    """Fact -> its relative change at the optimum with it free, and its standard deviation."""
    noise = np.array([fit.how["counted"][name] for name in fit.model.outputs])
    weight = problem.weight / noise
    error = (problem.target - problem.predicted_readings(problem.unknowns(fit.model.values)[None])[0]) * weight
    read = np.isfinite(error) & (weight > 0)
    error, weight = np.where(read, error, 0.0).ravel(), np.where(read, weight, 0.0).ravel()
    prior_curvature, prior_gradient = np.zeros((len(free) + 1, len(free) + 1)), np.zeros(len(free) + 1)
    for k, p in enumerate(free):
        if p.prior is not None and p.prior.mean is not None:
            value, sd = float(p.array), float(np.max(np.asarray(p.prior.sd)))
            prior_curvature[k, k] = (value / sd) ** 2
            prior_gradient[k] = value * (float(np.max(np.asarray(p.prior.mean))) - value) / sd**2
    blocks = np.array_split(np.arange(len(error)), BLOCKS)
    result = {}
    for fact, effect in facts.items():
        table = np.column_stack([*(follows[p.name] for p in free), effect]) * weight[:, None]
        H = np.array([table[rows].T @ table[rows] for rows in blocks])
        g = np.array([table[rows].T @ error[rows] for rows in blocks])
        total, gradient = H.sum(axis=0) + prior_curvature, g.sum(axis=0) + prior_gradient
        compensation = _solved(total[:-1, :-1], total[:-1, -1])
        if total[-1, -1] - total[-1, :-1] @ compensation < EXACTLY * total[-1, -1]:
            continue  # neither readings nor tolerances determine it
        steps = [_solved(total, gradient)[-1], *(_solved(total - H[k], gradient - g[k])[-1] for k in range(BLOCKS))]
        row_variance = (BLOCKS - 1) * float(np.var(steps[1:]))
        follows_of = _solved(total, np.eye(len(total))[-1])  # change of the fact with the mean of a tolerance
        result[fact] = (float(steps[0]), float(np.sqrt(row_variance + follows_of @ prior_curvature @ follows_of)))
    return result


def _solved(H: Array, g: Array) -> Array:
    scale = np.sqrt(np.diag(H))
    scale[scale == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(H / np.outer(scale, scale), g / scale, rcond=1e-10)[0] / scale)


def _effect(problem: MotionProblem, model: Model, name: str) -> Array:
    """(readings,) change of the predictions per relative change of a parameter."""
    both = []
    place = {item.name: place for item, place in placed(model.parameters)}[name]
    for factor in (1.0 + STEP, 1.0 / (1.0 + STEP)):
        values = model.values.copy()
        values[place] *= factor
        both.append(problem.predicted_readings(problem.unknowns(values)[None])[0])
    change = np.ravel(both[0] - both[1]) / (2.0 * STEP)
    return np.where(np.isfinite(change), change, 0.0)


def _of_combinations(model: Model, exponents: Mapping[str, float]) -> dict[str, float]:
    """Exponents of combinations, given those of parameters."""
    at = {p.name: float(p.array) for p in model.parameters if p.shape == ()}
    up, down = (
        SimpleNamespace(**{**at, **{name: at[name] * (1.0 + STEP) ** (sign * e) for name, e in exponents.items()}})
        for sign in (1, -1)
    )
    result = {}
    for one in model.combinations:
        value = [float(one.of(p)) for p in (up, down)]
        if min(value) > 0.0:
            result[one.name] = float(np.log(value[0] / value[1]) / (2.0 * np.log1p(STEP)))
    return result
