"""Estimates that scale with a stated value, which the recording does not determine.

Lateral motion is that of a vehicle twice as heavy with twice the inertia and the forces: it determines I_z / m. Where m
is stated, I_z is as wrong as m is, and no interval that is taken from residuals shows it. In logarithms, a stated value
and estimates move together there, and nothing that is predicted changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...engine.motion.shooting import MotionProblem
from ...engine.motion.simulator import Simulator
from ...models.model import Model
from ...models.parameter import placed
from ..fit import Fit

STEP = 1e-3
"""Relative, by which a number is moved to see what follows."""
EXACTLY = 1e-6
"""Share of what follows of a stated value that estimates may leave where they take it back: what `STEP` leaves of
exact scaling, squared."""
ALIKE = 0.01
"""How far the exponent of what is in proportion to a stated value may be from one."""
MOST_ROWS, AHEAD = 6000, 1.0
"""Rows that are looked at, and s that are predicted: what scales does so everywhere."""


def scaling(fit: Fit, simulator: Simulator, recordings: Sequence[Recording]) -> dict[str, list[str]]:
    """Stated parameter -> estimates and combinations in proportion to it, where no recording determines it.

    Stated is what is fixed; a tolerance is in the intervals.

    Parameters
    ----------
    fit : of equations of motion.
    simulator : of its model.
    recordings : that it was fitted to.
    """
    model, longest = fit.model, max(recordings, key=len)
    short = longest if len(longest) <= MOST_ROWS else longest.rows(0, MOST_ROWS)
    try:
        problem = MotionProblem(simulator, [short], noise=np.ones(len(model.outputs)), horizon=AHEAD, starts="measured")
    except BadInput:  # the vehicle stands in all of these rows
        return {}
    scalars = [p for p in model.parameters if p.shape == () and float(p.array) != 0.0 and np.isfinite(p.array)]
    free = [p.name for p in scalars if not p.fixed]
    stated = [p.name for p in scalars if p.fixed and p.name not in model.effects]
    if not free:
        return {}
    follows = {name: _follows(problem, model, name) for name in {*stated, *free}}
    table = np.column_stack([follows[name] for name in free])
    result: dict[str, list[str]] = {}
    for name in stated:
        moved = follows[name]
        taken_back = -np.linalg.lstsq(table, moved, rcond=1e-9)[0]
        if float(np.sum((moved + table @ taken_back) ** 2)) > EXACTLY * float(np.sum(moved**2)):
            continue
        exponents = dict(zip(free, taken_back.tolist(), strict=True))
        known = exponents | _of_combinations(model, exponents | {name: 1.0})
        scaled = [other for other, exponent in known.items() if abs(exponent - 1.0) < ALIKE]
        result |= {name: scaled} if scaled else {}
    return result


def _follows(problem: MotionProblem, model: Model, name: str) -> Array:
    """(readings,) change of what is predicted, for a relative change of a parameter."""
    both = []
    place = {item.name: place for item, place in placed(model.parameters)}[name]
    for factor in (1.0 + STEP, 1.0 / (1.0 + STEP)):
        values = model.values.copy()
        values[place] *= factor
        both.append(problem.predicted_readings(problem.unknowns(values)[None])[0])
    change = np.ravel(both[0] - both[1]) / (2.0 * STEP)
    return np.where(np.isfinite(change), change, 0.0)


def _of_combinations(model: Model, exponents: Mapping[str, float]) -> dict[str, float]:
    """Exponents of combinations where parameters have these."""
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
