"""From everything at once to hypotheses: the set of causes, without each of them, and with others in their places.

The search of all coordinates together (`estimation.together`) says how rough the equations are and which causes are
there. Each of them is then taken away, and everything else is refitted: it stays if it gains what a cause must, by as
much more as its magnitude differs between parts of the drive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.errors import BadInput
from .estimation.axes import Axis
from .estimation.calibration import CAL
from .estimation.hypothesis import Hypothesis, Promise, Start, by_cost
from .estimation.problem import FORM
from .estimation.refit import refit, settled, with_slopes
from .estimation.search import Search
from .estimation.together import Stage, Together

Prices = Callable[[Search, Hypothesis], list[float]]
"""What each effect of a hypothesis must gain."""


@dataclass(frozen=True)
class Firmly:
    """An observer that keeps simulations from spinning.

    Attributes
    ----------
    index : of its rate in the parameter vector.
    rate : 1/s.
    """

    index: int
    rate: float


@dataclass(frozen=True)
class Selection:
    """Hypotheses refitted on the same noise.

    Attributes
    ----------
    search : what refitted them.
    base : nothing but nuisances.
    tried : sets of effects, best first.
    promised : of every effect that is not there, what it would gain beside the base, and how small it could be.
    rough : times as rough as usual, that equations are.
    """

    search: Search
    base: Hypothesis
    tried: tuple[Hypothesis, ...]
    promised: tuple[Promise, ...]
    rough: float = 1.0

    def of(self, size: int) -> list[Hypothesis]:
        """Hypotheses of so many effects, best first."""
        return [own for own in self.tried if len(own.candidates) == size]


def select(
    together: Together, believed: Sequence[Axis], prices: Prices, trust: float, firmly: Firmly | None = None
) -> Selection:
    """Refit what may explain the recording.

    Parameters
    ----------
    together : the search of everything at once.
    believed : nuisances, zones of indifference among them.
    prices : what effects must gain.
    trust : as how many readings one counts.
    firmly : observers that keep a simulation from spinning while no explanation is known yet; None where none spins.
    """
    problem = together.problem
    if firmly is not None:
        problem.nominal[firmly.index] = firmly.rate
    stage = together.explained()
    axes = [replace(a, sd=a.sd * stage.rough, scale=a.scale * stage.rough) if a.name.startswith(FORM) else a
            for a in believed]  # fmt: skip
    search = Search(problem.bench, axes, stage.whitener, trust, stage.rough)
    if firmly is not None:
        search.nominal[firmly.index] = firmly.rate
    search.about(None)
    best = _refitted(search, _placed(search, together, stage))
    best = _recoloured(search, together, best)
    best, tried = _pruned(search, best, prices)
    best = _recoloured(search, together, best)
    best, tried = _pruned(search, best, prices)
    for own in _exchanged(search, together, stage, best):
        tried[frozenset(own.names)] = min([own, tried.get(frozenset(own.names), own)], key=by_cost)
    base = tried.pop(frozenset(), None) or _base(search, best)
    found = sorted(({frozenset(best.names): best} | tried).values() if best.names else tried.values(), key=by_cost)
    found = with_slopes(search, found)
    return Selection(search, base, tuple(found), promised(together, stage), stage.rough)


def _placed(search: Search, together: Together, stage: Stage) -> Hypothesis:
    """A stage's explanation as a hypothesis that is not simulated yet."""
    problem, state = together.problem, stage.state
    p = problem.vector(state)
    values = {axis.name: float(p[axis.index]) for axis in search.moving}
    for k in np.flatnonzero(stage.there):
        values.pop(problem.causes[k].main.name, None)
    own = search.at_values(values)
    candidates, m = [], list[float]()
    for k in np.flatnonzero(stage.there):
        cause = problem.causes[k]
        candidates.append(_as_refitted(problem.causes[k].forms[state.form[k]].candidate, search))
        at = float(state.m[k]) if state.on[k] or problem.smooth[k] else float(cause.main.null)
        seconds = [
            axis.value(x)
            for axis, x in zip(cause.forms[state.form[k]].candidate.axes[1:], state.seconds[k], strict=True)
        ]
        m += [at, *seconds]
    count = sum(len(each.axes) for each in candidates)
    assert count == len(m)
    return replace(own, candidates=tuple(candidates), m=np.array(m), J=np.zeros((*own.e.shape, count)))


def _as_refitted(candidate, search):  # type: ignore[no-untyped-def]
    """A candidate with second parameters in their own units."""
    axes = []
    for axis in candidate.axes:
        if axis.relative:
            low, high, null = (axis.value(own) for own in (axis.low, axis.high, axis.null))
            axis = replace(axis, relative=False, low=low, high=high, null=null, mean=null, scale=axis.scale * abs(null))
        axes.append(axis)
    return replace(candidate, axes=tuple(axes))


def _refitted(search: Search, own: Hypothesis) -> Hypothesis:
    """A hypothesis refitted about where it is."""
    search.about(own)
    found = refit(search, [replace(search.start_of(own), slopes=None)])
    if not found:
        found = refit(search, [search.start_of(search.at_means())])
    if not found:
        raise BadInput("Simulations leave the range of numbers: is this the right vehicle, in the right units?")
    return settled(search, found[0], 1)


def _recoloured(search: Search, together: Together, best: Hypothesis) -> Hypothesis:
    """The best explanation, refitted in the model error that it leaves."""
    whitening = together.whitening
    search.recoloured(whitening.left(whitening.about(search.vector(best)), best.e))
    search.about(best)
    (again,) = refit(search, [search.start_of(best)]) or (best,)
    return settled(search, again, 1)


def _pruned(search: Search, best: Hypothesis, prices: Prices) -> tuple[Hypothesis, dict[frozenset[str], Hypothesis]]:
    """The best explanation without what does not gain its price, and it without each of its effects."""
    while True:
        asked = prices(search, best)
        without = _without_each(search, best, asked)
        if not without:
            return best, {}
        left = [own.cost - best.cost - price for own, price in zip(without, asked, strict=True)]
        order = np.argsort(left)
        weak = [int(k) for k in order if left[k] < 0]
        if not weak:
            return best, {frozenset(own.names): own for own in without}
        gone = weak[: -(-len(weak) // 2)]  # where many are, some of them at once
        best = without[gone[0]].only({own for k, own in enumerate(best.names) if k not in gone})
        search.about(best)
        (again,) = refit(search, [search.start_of(best)]) or (best,)
        best = again


def _without_each(search: Search, whole: Hypothesis, prices: Sequence[float]) -> list[Hypothesis]:
    """A hypothesis without each of its effects, in their order, everything else refitted.

    Where that makes a difference to a name, from where tolerances are believed to be, too: what an effect seems to gain
    may be the way from one optimum to another.
    """
    found = []
    for name, price in zip(whole.names, prices, strict=True):
        start = search.start_of(whole.only(set(whole.names) - {name}))
        again = refit(search, [start])
        own = min(again, key=by_cost, default=replace(whole.only(set(whole.names) - {name}), cost=np.inf))
        if price < own.cost - whole.cost < CAL.doubted * price:
            own = min([own, *refit(search, [replace(start, theta=search.means[: len(start.theta)])])], key=by_cost)
        found.append(own)
    return found


def _exchanged(search: Search, together: Together, stage: Stage, best: Hypothesis) -> list[Hypothesis]:
    """The best explanation with others in the place of each effect that may explain as much."""
    problem, found = together.problem, list[Hypothesis]()
    places = {cause.name: k for k, cause in enumerate(problem.causes)}
    there = np.zeros(len(places), dtype=bool)
    there[[places[name] for name in best.names]] = True
    score = stage.sets.score(there)
    for name in best.names:
        tried = []
        for other, k in places.items():
            if there[k]:
                continue
            swap = there.copy()
            swap[places[name]], swap[k] = False, True
            tried.append((stage.sets.score(swap) - score, other, swap))
        tried.sort(key=lambda each: -each[0])
        for off, other, swap in tried[: CAL.exchanged]:
            if off < -CAL.exchange_look:
                break
            k = places[other]
            size = stage.sets.sizes(swap)[0][k]
            cause, state = problem.causes[k], stage.state
            form = cause.forms[state.form[k]]
            candidate = _as_refitted(form.candidate, search)
            seconds = [axis.value(x) for axis, x in zip(form.candidate.axes[1:], state.seconds[k], strict=True)]
            rest = best.only(set(best.names) - {name})
            m = np.append(rest.m, [float(np.clip(size, cause.main.low, cause.main.high)), *seconds])
            found += refit(search, [Start((*rest.candidates, candidate), m, best.theta, best.linear)])
    return found


def _base(search: Search, best: Hypothesis) -> Hypothesis:
    """Nothing but nuisances, as well as they can do."""
    nothing = Start((), np.empty(0), best.theta, best.linear)
    found = refit(search, [search.start_of(search.at_means()), nothing])
    if not found:
        raise BadInput("Simulations leave the range of numbers: is this the right vehicle, in the right units?")
    return settled(search, min(found, key=by_cost), 1)


def refitted(search: Search, own: Hypothesis) -> Hypothesis:
    """A hypothesis refitted where it stands; itself where that fails."""
    found = refit(search, [replace(search.start_of(own), slopes=None)])
    return found[0] if found else own


def promised(together: Together, stage: Stage) -> tuple[Promise, ...]:
    """Of every effect what it would gain by itself beside nuisances, to first order, most first."""
    problem, sets = together.problem, stage.sets
    found = []
    nothing = np.zeros(len(problem.causes), dtype=bool)
    here = sets.score(nothing)
    mains = np.flatnonzero(sets.main)
    for k, cause in enumerate(problem.causes):
        alone = nothing.copy()
        alone[k] = True
        gain = sets.score(alone) - here + sets.odds[k]
        sd = sets.sizes(alone)[1][k]
        candidate = cause.forms[stage.state.form[k]].candidate
        told = float(sets.S[mains[k], mains[k]] / max(sets.raw[mains[k]], 1e-300))
        found.append(Promise(candidate, max(float(gain), 0.0) if np.isfinite(gain) else 0.0, float(sd), told))
    return tuple(sorted(found, key=lambda own: -own.gain))
