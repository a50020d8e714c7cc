"""What of a vehicle differs from episode to episode, so that a driver learns more than one vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd

from greybox_id.base.errors import BadInput, near_or_all
from greybox_id.base.shorthands import Array
from greybox_id.base.statistics import NORMAL
from greybox_id.fitting.fit import Fit
from greybox_id.gap.gap import Gap
from greybox_id.models.effects import EFFECTS
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.parameter import Parameter, free_places
from greybox_id.models.registry import with_effects

HAND = {"grip_scale": (0.67, 1.24), "mass_change": (0.86, 1.12), "steering_delay": (0.0, 0.03)}
"""Ranges as published for a 1:10 car: friction 0.7 to 1.3 of nominally 1.05, 3.2 to 4.2 kg of 3.74, delays of up to
three periods of 10 ms."""
NULLS = {"grip_scale": 1.0, "mass_change": 1.0, "steering_delay": 0.0}
WEIGHT = "weight"
"""Column of a posterior that says how much a draw counts."""
ASIDE = ("chain", "log_posterior", "distance", "draw")
"""Columns of a posterior that are no parameters."""
DRAWN = 256
"""Draws that are made of what is known within its uncertainty."""
WIDEST = 3.0
"""Standard deviations that a draw may be off: beyond, nulls and limits of effects are crossed."""

Randomisation: TypeAlias = "str | Path | pd.DataFrame | Fit | Gap"


@dataclass(frozen=True)
class Draws:
    """What is drawn at the beginning of an episode.

    Attributes
    ----------
    names : of the parameters that are drawn.
    draw : (generator) -> name -> value.
    effects : effects that the model needs for it, at their nulls.
    delay, latency : s, the longest delay of a command and latency of a reading that are drawn.
    """

    names: tuple[str, ...]
    draw: Callable[[np.random.Generator], Mapping[str, float]]
    effects: Mapping[str, float]
    delay: float = 0.0
    latency: float = 0.0

    def suited(self, model: MotionModel) -> MotionModel:
        """The model with the effects that are drawn. Raises `BadInput` for a parameter it does not have."""
        result = with_effects(model, self.effects)
        unknown = [name for name in self.names if name not in result or result[name].shape != ()]
        if unknown:
            known = near_or_all(
                unknown[0], [parameter.name for parameter in result.parameters if parameter.shape == ()]
            )
            raise BadInput(f"Model {result.name} has no parameter {unknown[0]!r} that could be drawn.{known}")
        return result


def nothing_drawn() -> Draws:
    """Every episode is driven with the same vehicle."""
    return Draws((), lambda generator: {}, {})


def by_hand() -> Draws:
    """Friction, mass and delay of the steering, evenly from the ranges `HAND`."""

    def draw(generator: np.random.Generator) -> dict[str, float]:
        ends = zip(generator.random(len(HAND)), HAND.items(), strict=True)
        return {name: low + share * (high - low) for share, (name, (low, high)) in ends}

    return Draws(tuple(HAND), draw, NULLS, HAND["steering_delay"][1])


def of_posterior(frame: pd.DataFrame, named: str) -> Draws:
    """Rows of a table of draws, one column a parameter, as often as the column `weight` says.

    Raises
    ------
    BadInput : it has no rows, no columns of parameters, or a number that is missing.
    """
    names = tuple(str(name) for name in frame.columns if name not in (WEIGHT, *ASIDE))
    try:
        table = frame[list(names)].to_numpy(dtype=float)
        weights = frame[WEIGHT].to_numpy(dtype=float) if WEIGHT in frame else np.ones(len(frame))
    except (TypeError, ValueError) as error:
        raise BadInput(f"{named}: columns of a posterior hold numbers.") from error
    if not table.size or not np.all(np.isfinite(table)) or not np.all(weights >= 0) or not np.sum(weights) > 0:
        raise BadInput(f"{named}: draws of parameters are needed, finite numbers with weights that are not all zero.")
    reached = np.cumsum(weights) / np.sum(weights)

    def draw(generator: np.random.Generator) -> dict[str, float]:
        row = table[min(int(np.searchsorted(reached, generator.random(), side="right")), len(table) - 1)]
        return dict(zip(names, row.tolist(), strict=True))

    def longest(of: Callable[[str], bool]) -> float:
        return max((float(np.max(table[:, k])) for k, name in enumerate(names) if of(name)), default=0.0)

    late = longest(lambda name: name.endswith("_delay")), longest(lambda name: name.startswith("sensor_latency_"))
    return Draws(names, draw, {}, *late)


def of_fit(fit: Fit) -> Draws:
    """Parameters that were fitted, as uncertain together as the fit's covariance says.

    Raises
    ------
    BadInput : it keeps no covariance, or nothing of it was fitted with one.
    """
    known, size = free_places(fit.model.parameters), fit.model.size
    held = np.full((size, size), np.nan) if fit.covariance is None else fit.covariance
    free = {k: fit.model[name] for name, k in known.items() if np.isfinite(held[k, k])}
    if not free:
        raise BadInput("randomise: this fit keeps no covariance of its parameters, from which they could be drawn.")
    variances, directions = np.linalg.eigh(held[np.ix_(list(free), list(free))])
    off = _normal(np.random.default_rng(0), (DRAWN, len(free))) * np.sqrt(np.maximum(variances, 0.0)) @ directions.T
    columns = {
        parameter.name: _bounded(parameter, parameter.array + off[:, k]) for k, parameter in enumerate(free.values())
    }
    return of_posterior(pd.DataFrame(columns), "randomise")


def of_gap(gap: Gap, *, unseen: bool = True) -> Draws:
    """What a diagnosis says: applied effects, as likely and as uncertain as they are, and others that may be there.

    Parameters
    ----------
    gap : with the closed model, whose effects these are.
    unseen : whether effects are drawn too whose usual size the recordings would not have shown (`Gap.limits`): evenly,
        as large as would not show, and no larger than is usual.
    """
    generator, columns, added = np.random.default_rng(0), dict[str, Array](), dict[str, float]()
    for cause in gap.ranking:
        if cause.effect not in gap.applied or not isinstance(gap.closed, MotionModel):
            continue
        parameter, low, high = gap.closed[cause.effect], *cause.interval
        sd = (high - low) / (2 * NORMAL)
        off = _normal(generator, DRAWN) * (sd if np.isfinite(sd) else 0.0)
        null = _null(parameter)
        there = generator.random(DRAWN) < (cause.probability if np.isfinite(null) else 1.0)  # else: no limit to draw
        columns[cause.effect] = np.where(there, _bounded(parameter, parameter.array + off), null)
    for name, limit in gap.limits.items() if unseen else ():
        if limit.share <= 1.0 or name not in EFFECTS or not np.isfinite(null := _null(EFFECTS[name].parameter)):
            continue  # what is only felt beyond a size, as rates and forces are limited, is not told by derivatives
        most = min(limit.size, abs(limit.typical - null))
        columns[name] = _bounded(EFFECTS[name].parameter, null + most * generator.uniform(-1.0, 1.0, DRAWN))
        added[name] = null
    draws = of_posterior(pd.DataFrame(columns), "randomise") if columns else nothing_drawn()
    return replace(draws, effects=added)


def _normal(generator: np.random.Generator, shape: int | tuple[int, int]) -> Array:
    return np.clip(generator.standard_normal(shape), -WIDEST, WIDEST)


def _null(parameter: Parameter) -> float:
    assert parameter.null is not None
    return parameter.null


def _bounded(parameter: Parameter, values: Array) -> Array:
    low, high = (np.nan if bound is None else bound for bound in parameter.bounds)
    return np.asarray(np.fmax(np.fmin(values, high), low))


def draws(randomisation: Randomisation) -> Draws:
    """What is to be drawn: "none", "hand", a fit, a gap, or a table of draws, a frame or the Parquet file of one.

    Raises
    ------
    BadInput : there is no such randomisation or file, or it holds no draws.
    """
    if isinstance(randomisation, Gap):
        return of_gap(randomisation)
    if isinstance(randomisation, Fit):
        return of_fit(randomisation)
    if isinstance(randomisation, pd.DataFrame):
        return of_posterior(randomisation, "randomise")
    if randomisation in ("none", "hand"):
        return by_hand() if randomisation == "hand" else nothing_drawn()
    if not str(randomisation).endswith(".parquet"):
        known = near_or_all(str(randomisation), ("none", "hand"))
        raise BadInput(f"There is no randomisation {randomisation!r}.{known} A posterior is a .parquet file.")
    try:
        return of_posterior(pd.read_parquet(randomisation), str(randomisation))
    except (OSError, ValueError) as error:
        raise BadInput(f"{randomisation} cannot be read as a table of draws ({error}).") from error
