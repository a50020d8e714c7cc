"""Which candidates are worth a refit: what each could gain to first order, or from where its search begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from ..parameter import Array
from .axes import Candidate
from .hypothesis import Hypothesis
from .search import Search

FEW = 3
"""Starts of a candidate that promises nothing alone: beside another one it may."""


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
    """What candidates promise beside a hypothesis, most promising first."""
    new = [candidate for candidate in candidates if candidate.effect not in beside.names]
    if not new:
        return []
    p, found = search.vector(beside), dict[str, Promise]()
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
        sd, told = float(curve**-0.5), float(curve / max(raw, 1e-300))
        gone = search.reached(here, first.rest + (at - null) * with_it)
        found[candidate.effect] = Promise(
            candidate, float(gain) * _of_gain(at - null, float(step)), (at,), gone, sd, told
        )
    for (candidate, start), ok, (gain, share, curve, raw, with_it) in zip(
        tried, sane, numbers[len(plain) :], strict=True
    ):
        gone = search.reached(here, first.rest + (share if candidate.gradual else 1.0) * with_it)
        own = _promised(candidate, start, float(gain), float(share), gone) if ok else None
        if own is not None and (candidate.effect not in found or own.gain > found[candidate.effect].gain):
            sd = abs(start[0] - candidate.axes[0].null) * float(curve**-0.5)
            found[candidate.effect] = replace(own, sd=sd, told=float(curve / max(raw, 1e-300)))
    return sorted(found.values(), key=lambda promise: -promise.gain)


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
    best: dict[str, tuple[tuple[float, ...], ...]] = {own.candidate.effect: (own.start,) for own in promised}
    for single in refitted:
        (effect,) = single.names
        best[effect] = (*best.get(effect, ()), tuple(float(m) for m in single.m))
    return [
        replace(own, starts=best.get(own.effect, own.starts[:: max(1, len(own.starts) // FEW)]) if own.starts else ())
        for own in candidates
    ]


def _promised(
    candidate: Candidate, start: tuple[float, ...], gain: float, share: float, nuisances: Array
) -> Promise | None:
    """What a simulated start promises; None where it leads away.

    Parameters
    ----------
    candidate, start : what was simulated.
    gain : of the best share of what it did.
    share : which that is.
    nuisances : where they go.
    """
    main = candidate.axes[0]
    if not candidate.gradual:  # what this very start gains, not what a share of it would
        own = gain * (1 - min((share - 1) ** 2, 1.0)) if share > 0 else 0.0
        return Promise(candidate, own, start, nuisances) if own > 0 else None
    wanted = share * (start[0] - main.null)
    at = float(np.clip(main.null + wanted, main.low, main.high))
    own = gain * _of_gain(at - main.null, wanted)
    return Promise(candidate, own, (at, *start[1:]), nuisances) if at != main.null else None


def _of_gain(step: float, wanted: float) -> float:
    """Share of a gain that is left of a step cut short by a bound: beyond it nothing can be promised."""
    return 1 - (1 - step / wanted) ** 2 if wanted != 0 else 1.0
