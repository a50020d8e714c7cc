"""Which candidates are worth a refit: what each could gain to first order, or from where its search begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from ...base.shorthands import Array
from .axes import Candidate
from .calibration import CAL
from .hypothesis import Hypothesis
from .search import Search

BETWEEN = CAL.between * CAL.starts[1] / CAL.starts[0]


@dataclass(frozen=True)
class Promise:
    """What a candidate promises beside a hypothesis.

    Attributes
    ----------
    candidate : which.
    gain : in log-likelihood, to first order.
    start : coordinates from which to refit it.
    nuisances : where nuisances go with it, to first order, moving ones first.
    sd : of its magnitude's coordinate on this recording, to first order.
    told : share of the information on it that is left once nuisances are refitted.
    """

    candidate: Candidate
    gain: float
    start: tuple[float, ...]
    nuisances: Array
    sd: float = inf
    told: float = 1.0


def promises(search: Search, beside: Hypothesis, candidates: Sequence[Candidate]) -> list[Promise]:
    """What candidates promise beside a hypothesis, each form of them by itself; most promising first."""
    forms = frozenset[str]().union(beside.names, *(candidate.never_beside for candidate in beside.candidates))
    new = [
        candidate
        for candidate in candidates
        if candidate.effect not in forms and candidate.never_beside.isdisjoint(beside.names)
    ]
    if not new:
        return []
    p, result = search.vector(beside), dict[tuple[str, tuple[float, ...]], Promise]()
    plain = [candidate for candidate in new if not candidate.starts]
    columns = [candidate.axes[0].index for candidate in plain]
    J = search.bench.linearise(p, columns)[1] if columns else np.zeros((*beside.e.shape, 0))
    tried = [(candidate, start) for candidate in new for start in candidate.starts]
    e = search.residuals([search.placed(p, candidate.axes, start) for candidate, start in tried])
    moved = np.moveaxis(e + (search.first_order(beside) - beside.e), 0, 2)
    sane = np.all(np.isfinite(moved), axis=(0, 1)) & np.any(moved != 0, axis=(0, 1))
    both = np.concatenate([J, np.where(sane, moved, 0.0)], axis=2)
    here = np.concatenate([beside.theta, beside.linear])
    first = search.project(beside.e, both, beside.theta, beside.linear)
    numbers = list(zip(first.gain, first.step, first.curve, first.raw, first.nuisances.T, strict=True))
    for candidate, (gain, step, curve, raw, with_it) in zip(plain, numbers, strict=False):
        axis = candidate.axes[0]
        null = search.where(beside, axis)
        at = float(np.clip(null + step, axis.low, axis.high))
        sd, known = float(curve**-0.5), float(curve / max(raw, 1e-300))
        gone = search.reached(here, first.rest + (at - null) * with_it)
        gain = float(gain) * of_gain(at - null, float(step))
        result[candidate.effect, ()] = Promise(candidate, gain, (at,), gone, sd, known)
    curves = {
        (item.effect, start): float(curve)
        for (item, start), curve in zip(tried, first.curve[len(plain) :], strict=True)
    }
    for (candidate, start), ok, (gain, share, curve, raw, with_it) in zip(
        tried, sane, numbers[len(plain) :], strict=True
    ):
        if not ok:
            continue
        power = _power(candidate, start, curves)
        begin, promised, reached = _promised(candidate, start, float(gain), float(share), power)
        value = Promise(candidate, promised, begin, search.reached(here, first.rest + reached * with_it))
        key = candidate.effect, candidate.held
        if value.gain > 0 and (key not in result or value.gain > result[key].gain):
            sd = abs(start[0] - candidate.axes[0].null) * float(curve**-0.5)
            result[key] = replace(value, sd=sd, told=float(curve / max(raw, 1e-300)))
    return sorted(result.values(), key=lambda promise: -promise.gain)


def from_where_best(
    promised: Sequence[Promise], candidates: Sequence[Candidate], refitted: Sequence[Hypothesis] = ()
) -> list[Candidate]:
    """Candidates with the most promising of their starts, and where they were best alone.

    Where none promised anything, with a few starts.

    Parameters
    ----------
    promised : of the candidates.
    candidates : with all their starts.
    refitted : single effects; a delay's start is half or twice the delay, and another effect may do as well as that.
    """
    best = {(item.candidate.effect, item.candidate.held): (item.start,) for item in promised}
    for single in refitted:
        key = single.candidates[0].effect, single.candidates[0].held
        best[key] = (*best.get(key, ()), tuple(float(m) for m in single.m))
    return [
        replace(
            candidate,
            starts=best.get(
                (candidate.effect, candidate.held), candidate.starts[:: max(1, len(candidate.starts) // CAL.few_starts)]
            ),
        )
        if candidate.starts
        else candidate
        for candidate in candidates
    ]


def _promised(
    candidate: Candidate, start: tuple[float, ...], gain: float, share: float, power: float
) -> tuple[tuple[float, ...], float, float]:
    """Where a refit had best begin by what a simulated start tells, what that promises, and what share it does.

    Parameters
    ----------
    candidate, start : what was simulated.
    gain : of the best share of what it did.
    share : which that is.
    power : of the magnitude that what it does grows with.
    """
    main = candidate.axes[0]
    step = start[0] - main.null
    if main.shift:  # its start stays where it is: readings jump with rows
        return start, gain * of_gain(min(share, 1 / share), 1.0) if share > 0 else 0.0, 1.0
    if candidate.gradual:
        at = float(np.clip(main.null + share * step, main.low, main.high))
        return (at, *start[1:]), gain * of_gain(at - main.null, share * step), share
    if share <= 0 or step == 0:
        return start, 0.0, 1.0
    target = np.log(share) / power
    if abs(target) > np.log(BETWEEN):  # the next start tells; beyond the last something else is at work
        return start, 0.0, 1.0
    factor = float(np.exp(target))
    factor = 1.0 if 1 / CAL.start_near < factor < CAL.start_near else factor
    at = float(np.clip(main.null + factor * step, main.low, main.high))
    reached = abs((at - main.null) / step) ** power
    believed = 1 - CAL.doubt * abs(np.log(factor)) / np.log(BETWEEN)
    return (at, *start[1:]), float(gain * believed * of_gain(reached, share)), reached


def _power(
    candidate: Candidate, start: tuple[float, ...], curves: Mapping[tuple[str, tuple[float, ...]], float]
) -> float:
    """The power of its magnitude that what a candidate does grows with, by this start and the one nearest below it."""
    null = candidate.axes[0].null
    size = abs(start[0] - null)
    below = [item for item in candidate.starts if item[1:] == start[1:] and 0 < abs(item[0] - null) < size]
    if candidate.gradual or not below:
        return 1.0
    nearest = max(below, key=lambda item: abs(item[0] - null))
    here, there = curves[candidate.effect, start], curves[candidate.effect, nearest]
    if not (here > 0 and there > 0):
        return 1.0
    power = float(0.5 * np.log(here / there) / np.log(size / abs(nearest[0] - null)))
    return min(power, CAL.powers[1]) if power >= CAL.powers[0] else 1.0  # what acts at once grows with no power of it


def of_gain(step: float, target: float) -> float:
    """Share of a gain that is left of a step cut short by a bound: beyond it nothing can be promised."""
    return 1 - (1 - step / target) ** 2 if target != 0 else 1.0
