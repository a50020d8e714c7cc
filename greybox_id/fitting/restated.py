"""The problem that a fit solved, stated again, on recordings taken as the fit took them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from ..base.errors import BadInput, near_or_all
from ..base.shorthands import Array
from ..datasets.checks.rest import standing
from ..datasets.recording import Recording
from ..engine.least_squares import LeastSquares
from ..engine.solvers.gauss_newton import Solution, Status, gauss_newton
from ..models.kinds import by_kind
from ..models.model import Model
from .fit import Fit

TOLERANCE = 1e-10
Hold = Literal["zero", "linear"]
IN_MOTION = "in motion or unbraked"
"""Rows that are left of a vehicle that stands under its brake."""


def with_hold(recording: Recording, hold: Hold) -> Recording:
    """The recording with commands held, or run on, between rows."""
    return replace(recording, hold=hold)


def as_fitted(fit: Fit, recording: Recording) -> Recording:
    """A recording of which no map says what holds between its rows, as those that the fit has seen were taken."""
    known = fit.how.get("hold")
    taken = known.get("taken") if isinstance(known, Mapping) else None
    if recording.hold_stated or taken not in ("zero", "linear"):
        return recording
    return with_hold(recording, "linear" if taken == "linear" else "zero")


def as_seen(fit: Fit, recording: Recording) -> Recording:
    """A recording that the fit was trained on, as it was taken: rows that were left out are left out again."""
    recording = as_fitted(fit, recording)
    moving = ~standing(recording) if fit.how.get("stood") else np.ones(len(recording), dtype=bool)
    return recording if moving.all() or not moving.any() else recording.keep(moving, IN_MOTION)


@by_kind
def stated_again(model: Model, fit: Fit, recordings: Sequence[Recording]) -> tuple[LeastSquares, Array]:
    """The least-squares problem that a fit of this kind solved, and its unknowns at the fit's estimates."""
    raise BadInput(
        f"{model.name} is {model.called}; its fits solve no least-squares problem that could be set up again."
    )


def restated(fit: Fit, recordings: Sequence[Recording]) -> tuple[LeastSquares, Solution]:
    """The least-squares problem of a fit, and its optimum.

    Starts of predictions are not kept in a fit; they follow again from its parameters.

    Parameters
    ----------
    fit : the fit.
    recordings : those it was trained on, in its order.

    Raises
    ------
    BadInput : its kind of model solves no such problem, or it finds no optimum on these recordings.
    """
    problem, x = stated_again(fit.model, fit, [as_seen(fit, recording) for recording in recordings])
    solution = gauss_newton(problem, x, tolerance=TOLERANCE, search="levenberg_marquardt")
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    if solution.status is Status.NOT_FINITE:
        raise BadInput(f"{fit.model.name} is not finite on {recordings[0].name} at the fit's estimates. Fit again.")
    return problem, solution


def profiled(fit: Fit, names: Sequence[str], everything: bool = False) -> list[str]:
    """The parameters whose profiles are asked for: free numbers that are the same in all runs.

    Raises
    ------
    BadInput : none is named, or one that has no profile.
    """
    model = fit.model
    if fit.mode == "early stopping":
        raise BadInput(
            f"Held-out data stopped the training of {model.name} early: it is at no optimum, and has no profile. "
            "Train it from several seeds to see how far its numbers scatter."
        )
    free = [p.name for p in model.parameters if p.shape == () and not p.fixed and p.scope == "model"]
    if not free:
        raise BadInput(
            f"The fit of {model.name} has no free number that is the same in all runs: arrays of weights mean little "
            "one by one, and have no profiles. Fit equations of motion (greybox models)."
        )
    if everything:
        return free
    if not names:
        raise BadInput(f"Which parameter? Name it with ‹parameter›, or ‹all› of them: {', '.join(free)}.")
    for name in names:
        if name not in model:
            raise BadInput(f"‹parameter› {name}: {model.name} has no parameter {name}.{near_or_all(name, free)}")
        if name not in free:
            why = "is held in this fit" if model[name].fixed else "has a value for each run"
            raise BadInput(f"‹parameter› {name}: {name} {why}; only {', '.join(free)} have profiles.")
    return list(dict.fromkeys(names))


def place(problem: LeastSquares, model: Model, name: str) -> int:
    """Where a parameter that is the same in all runs stands among the unknowns."""
    before = itertools.takewhile(lambda parameter: parameter.name != name, model.parameters)
    return int(problem.layout.index[0][sum(parameter.size for parameter in before)])
