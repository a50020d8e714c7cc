"""Design for precise parameters: by the determinant of their covariance, averaged over what is uncertain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...base.shorthands import Say
from ...fitting.fit import Fit
from ...models.model import Model, must_be
from ...models.motion_model import MotionModel
from .course import PlannedMotion
from .information import Information, criterion, draws, known_by, predicted_sd, target_names
from .plan import Design
from .search import PlanSearch
from .task import DesignTask

DRAWS, AVERAGED = 40, 3
"""Draws of the posterior that must keep to limits; those over which the criterion's median is taken."""
CRITERIA = ("d", "a", "e", "c")
LITTLE = 0.05
"""Relative reduction of a standard deviation that counts as little: twenty such drives would not halve it."""


def must_move(model: Model, do: str = "Fit") -> MotionModel:
    """The model, if manoeuvres can be designed with it. Raises `BadInput` where it has no equations of motion."""
    none = f"A manoeuvre is designed with equations of motion; {model.name} has none. {do} single_track."
    return must_be(MotionModel, model, none)


def precise(fit: Fit, names: Sequence[str], kind: str, design_task: DesignTask, say: Say) -> Design:
    """The manoeuvre that makes parameters of a fit precise.

    Parameters
    ----------
    fit : of equations of motion.
    names : of the parameters that count; none: all free ones.
    kind : one of `CRITERIA`, see `information.criterion`.
    design_task : arena, limits and the like.

    Raises
    ------
    BadInput : the model cannot predict manoeuvres, a name is none of its free parameters, or no manoeuvre fits into the
        arena and the limits.
    """
    model, known = must_move(fit.model), known_by(fit)
    target = target_names(fit, known, names)
    samples = draws(fit, known, DRAWS, design_task.seed)

    def worth(plans: Sequence[PlannedMotion], rough: bool) -> list[float]:
        values = [
            [criterion(known.precision + design_task.repeat * one, known, target, kind)
             for one in information.of(plans, p, rough=rough)]
            for p in samples[: 1 if rough else AVERAGED]
        ]  # fmt: skip
        return [float(value) for value in np.median(values, axis=0)]

    search = PlanSearch(design_task, model, [samples], worth)
    information = Information(fit, known, target)
    found_plan = search.best(say)
    after = known.precision + design_task.repeat * information.of([found_plan.plan], samples[0])[0]
    before, then = (criterion(each, known, target, kind) for each in (known.precision, after))
    every = predicted_sd(known, after)
    predicted = {name: every[name] for name in target}
    return search.design(
        "precision", found_plan, criterion={"name": kind, "parameters": list(target), "before": before, "after": then},
        drive=information.drive, predicted_sd=predicted, impossible=_hardly(model, predicted), said=_exact(model),
    )  # fmt: skip


def _exact(model: MotionModel) -> tuple[str, ...]:
    """A sentence that the fit takes its tyre curves as exact, where it does."""
    if model.settings.get("tyre", "linear") == "linear" or "form" in model.settings:
        return ()
    return ("The fit treats its tyre curves as exact; with the setting form=uncertain, sd includes their error.",)


def _hardly(model: MotionModel, known: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """A sentence on parameters of which the manoeuvre informs little."""
    parts = []
    for name, (before, after) in known.items():
        if not np.isfinite(after):
            parts.append(f"no information on {name}, which stays unknown")
        elif np.isfinite(before) and after > (1.0 - LITTLE) * before:
            parts.append(
                f"little information on {name}: its standard deviation falls by {100 * (1 - after / before):.1f} %"
            )
    if not parts:
        return ()
    return (f"Of {model.name}, the best manoeuvre that was found in this arena adds {'; '.join(parts)}.",)
