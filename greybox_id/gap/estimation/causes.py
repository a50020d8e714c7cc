"""Causes that a joint search considers, each with the forms and sizes at which it is probed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import log, pi

import numpy as np

from ...engine.simulation import Diagnosed
from ...models.effect import Effect
from .axes import DIRECTIONS, SECONDS, Axis, Candidate, candidates
from .calibration import CAL
from .preparing import usual_size, zone_of


@dataclass(frozen=True)
class Form:
    """One form of an effect: a magnitude, and second parameters that are held or have a prior.

    Attributes
    ----------
    candidate : the effect in this form; its axes are in the coordinates that the search moves.
    seconds : second parameters that are free.
    starts : (magnitude, second parameters ...) coordinates at which it is probed while it is not simulated.
    """

    candidate: Candidate
    seconds: tuple[Axis, ...]
    starts: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class PossibleCause:
    """An effect that may be present.

    Attributes
    ----------
    name : of the effect.
    main : axis of its magnitude.
    forms : at least one.
    usual : usual size of its magnitude, sd of the slab.
    zone : size that is negligible, sd of the spike; zero where equations are exact.
    gradual : whether its derivative at the null describes larger magnitudes.
    """

    name: str
    main: Axis
    forms: tuple[Form, ...]
    usual: float
    zone: float
    gradual: bool


def causes(
    model: Diagnosed,
    effects: Mapping[str, Effect],
    shifting: frozenset[str],
    stated: Sequence[Axis],
    sample_time: float,
    inexact: bool,
) -> tuple[PossibleCause, ...]:
    """All effects of a model as causes that may be present.

    Parameters
    ----------
    shifting : names of parameters on which delays or latencies depend.
    stated : tolerances, among them effects that a file says to be present a little.
    inexact : whether equations are inexact: small effects are no gap then.
    """
    tolerated = {item.index: item for item in stated}
    result = dict[str, list[Candidate]]()
    for candidate in candidates(model, effects, shifting):
        result.setdefault(candidate.effect, []).append(candidate)
    return tuple(_cause(model, effects[name], forms, tolerated, sample_time, inexact) for name, forms in result.items())


def _cause(
    model: Diagnosed,
    effect: Effect,
    forms: Sequence[Candidate],
    tolerated: Mapping[int, Axis],
    sample_time: float,
    inexact: bool,
) -> PossibleCause:
    main = forms[0].axes[0]
    usual = usual_size(model, effect)
    if main.inverse or not np.isfinite(usual):
        usual = main.scale
    tolerance = tolerated.get(main.index)
    zone = zone_of(model, effect, sample_time) if inexact and (effect.gradual or main.unit in ("s", "m")) else 0.0
    if tolerance is not None:
        zone = max(zone, tolerance.sd)
        main = replace(main, mean=tolerance.mean)
    return PossibleCause(effect.name, main, tuple(_form(each, usual) for each in forms), usual, zone, forms[0].gradual)


def _form(candidate: Candidate, usual: float) -> Form:
    main, *others = candidate.axes
    placed = [_with_prior(axis) if axis.low < axis.high else (axis, (axis.low,)) for axis in others]
    axes = tuple(axis for axis, _ in placed)
    sizes = (CAL.gradual_start,) if candidate.gradual else CAL.abrupt_sizes
    firsts = [at for at in (main.null + f * usual for f in sizes) if main.low <= at <= main.high]
    starts = tuple(product(firsts, *(at for _, at in placed))) if axes or not candidate.gradual else ()
    seconds = tuple(axis for axis in axes if axis.low < axis.high)
    return Form(replace(candidate, axes=(main, *axes)), seconds, starts)


def _with_prior(axis: Axis) -> tuple[Axis, tuple[float, ...]]:
    """A second parameter with a prior as wide as the values at which it is probed, and these values."""
    if axis.unit == "rad":
        return replace(axis, mean=0.0, sd=pi, scale=0.3), DIRECTIONS
    factors = SECONDS.get(axis.unit, (1.0,))
    with_prior = replace(axis, mean=axis.null, sd=abs(axis.null) or 1.0).relatively()
    if not with_prior.relative:
        return replace(with_prior, sd=with_prior.scale), (with_prior.null,)
    wide = max(0.5 * log(max(factors) / min(factors)), CAL.second_sd)
    return replace(with_prior, sd=wide, scale=0.1), tuple(
        float(np.clip(with_prior.mean + log(f), with_prior.low, with_prior.high)) for f in factors
    )
