"""Forward selection: single effects first, then pairs about the best of them, then a third.

Twice: first with white noise of the stated size, which finds an explanation; then with the noise that is left once that
explanation is in the model. Noise estimated before would contain the effect and hide it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array
from .estimation.axes import Candidate
from .estimation.calibration import CAL
from .estimation.hypothesis import Hypothesis, Start, by_cost
from .estimation.noise import Whitener
from .estimation.refit import refit, settled, with_slopes
from .estimation.search import Search
from .estimation.shortlist import Promise, from_where_best, promises


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
    tried : single effects, pairs and triples, best first.
    promised : of every single candidate beside the base.
    at_once : whether everything was looked for at once: how magnitudes differ between parts was paid for there.
    """

    search: Search
    base: Hypothesis
    tried: tuple[Hypothesis, ...]
    promised: tuple[Promise, ...]
    at_once: bool = False

    def of(self, size: int) -> list[Hypothesis]:
        """Hypotheses of so many effects, best first."""
        return [item for item in self.tried if len(item.candidates) == size]


def select(
    search: Search,
    candidates: Sequence[Candidate],
    whitener: Callable[[Search, Hypothesis | None], Whitener],
    cost: Callable[[str], float],
    firmly: Firmly | None = None,
) -> Selection:
    """Refit what may explain the recording.

    Parameters
    ----------
    search : with white noise of the stated size.
    candidates : what may be the cause.
    whitener : how residuals are whitened about a hypothesis; None: before any is known.
    cost : log-likelihood that a further effect must gain, by its name.
    firmly : observers that keep a simulation from spinning while no explanation is known yet; None where none spins.
    """
    worth = max((cost(candidate.effect) for candidate in candidates), default=0.0)
    if firmly is not None:
        search.nominal[firmly.index] = firmly.rate
    search.recoloured(whitener(search, None))
    best, started = _rough(search, candidates)
    if firmly is not None:
        search.nominal[firmly.index] = 0.0
        if not _stands(search, best):
            search.nominal[firmly.index] = firmly.rate
    search.recoloured(whitener(search, refitted(search, best)))
    base = _base(search, best)
    promised = promises(search, base, started if firmly is None else candidates)
    hopeful = [item for k, item in enumerate(promised) if k < CAL.fewest or item.gain > CAL.hope * promised[0].gain]
    singles = _with_each(search, base, hopeful[: CAL.singles])
    known = refitted(search, best)
    for from_belief in (known,) if len(best.candidates) == 1 else _without_each(search, known):
        singles = _better(singles, from_belief)
    for from_belief in _from_beliefs(search, base, candidates, singles, worth):
        singles = _better(singles, from_belief)
    tried = {frozenset(single.names): single for single in singles}
    if len(best.candidates) == 2:
        tried[frozenset(best.names)] = known
    if tried:
        _combine(search, base, singles, tried, best, from_where_best(promised, candidates, singles), cost)
    hypothesises = sorted(tried.values(), key=by_cost)
    base, hypothesises = _polished(search, base, hypothesises, hypothesises[: CAL.polished + CAL.rivals], worth)
    if _far(search, base):
        with search.elsewhere():
            search.about(base)
            for from_belief in _let_go(search, base, candidates):
                hypothesises = _better(hypothesises, from_belief)
    replacing = _in_each_place(search, hypothesises, candidates, worth)
    costs = {frozenset(item.names): item.cost for item in hypothesises}
    replacing = [item for item in replacing if item.cost < costs.get(frozenset(item.names), np.inf) - CAL.enough]
    if replacing and replacing[0].cost < hypothesises[0].cost + worth:
        base, hypothesises = _polished(search, base, hypothesises, replacing, worth, 1)
    elif replacing:
        names = {frozenset(item.names) for item in replacing}
        hypothesises = sorted(
            (*replacing, *(item for item in hypothesises if frozenset(item.names) not in names)), key=by_cost
        )
    base, hypothesises = _from_each_other(search, base, _gaps(search, hypothesises), worth)
    hypothesises = _from_believed_lags(search, hypothesises)
    better = sum(item.cost < base.cost for item in hypothesises)  # of these more is told than what they cost
    hypothesises = [*with_slopes(search, hypothesises[:better]), *hypothesises[better:]]
    by_effect = {item.candidate.effect: item for item in reversed(promised)}  # of forms the most promising
    return Selection(search, base, tuple(hypothesises), tuple(sorted(by_effect.values(), key=lambda item: -item.gain)))


def _polished(
    search: Search,
    base: Hypothesis,
    hypothesises: list[Hypothesis],
    rivals: Sequence[Hypothesis],
    worth: float,
    rounds: int = CAL.polished,
) -> tuple[Hypothesis, list[Hypothesis]]:
    """The base, and hypotheses, best first, of which the best had nuisances linearised about where these are beside it.

    Nuisances that have taken up a gap are far from where they are once it has a name. Rivals are refitted there too,
    and the base: what is compared must have had the same chance. Then the next best, until none gains by it.
    """
    if not (search.moving or search.shifts) or not hypothesises:
        return base, hypothesises
    better = {frozenset(item.names): item for item in sorted((*hypothesises, *rivals, base), key=by_cost, reverse=True)}
    nothing = frozenset[str]()
    rivalling, done = {frozenset(rival.names) for rival in rivals}, set[frozenset[str]]()
    with search.elsewhere():
        for turn in range(rounds):
            itself = next((names for names in _near(better, rivalling, CAL.near * worth) if names not in done), nothing)
            best = better[itself]
            if better[nothing].cost - best.cost <= CAL.worthy * worth:
                break
            beside = _near(better, rivalling, (CAL.close if done else CAL.near) * worth)
            done.add(itself)
            search.about(best)
            starts = [search.start_of(better[names]) for names in (nothing, *dict.fromkeys((*beside, itself)))]
            again = refit(search, [*starts, Start((), np.empty(0), best.theta, best.linear)])
            bases = [item for item in again if not item.names]
            new = [
                settled(search, item, 1) if frozenset(item.names) == itself else item for item in again if item.names
            ]
            new += sorted(bases, key=by_cost)[:1]  # it may cost more once settled, as rivals may, which are not
            new += [settled(search, item) for item in new[-1:] if turn == 0 and not item.names]
            gained = max((better[frozenset(item.names)].cost - item.cost for item in new), default=0.0)
            for item in sorted(new, key=by_cost, reverse=True):
                if item.cost < better[names := frozenset(item.names)].cost:
                    better[names] = item
            if gained < CAL.enough:
                break
    base = better.pop(nothing)
    return base, sorted(better.values(), key=by_cost)


def _from_each_other(
    search: Search, base: Hypothesis, hypothesises: list[Hypothesis], worth: float
) -> tuple[Hypothesis, list[Hypothesis]]:
    """The base and the best hypothesis, each refitted from where the other one has nuisances, until neither gains.

    Curves of tyres have several optima: what an effect seems to gain may be the way from one to another.
    """
    if not (search.moving or search.shifts):
        return base, hypothesises
    for _ in range(CAL.polished):
        if not hypothesises or base.cost - hypothesises[0].cost <= CAL.worthy * worth:
            break
        best = hypothesises[0]
        with search.elsewhere():
            search.about(best)
            starts = [search.start_of(base), Start((), np.empty(0), best.theta, best.linear)]
            bases = [settled(search, item) for item in sorted(refit(search, starts), key=by_cost)[:1]]
            search.about(base)
            beside = Start(best.candidates, best.m, base.theta, search.released(base.linear, best.axes), slopes=best.J)
            again = [settled(search, gap) for gap in _gaps(search, refit(search, [beside]))]
        gained = max(0.0, *(old.cost - item.cost for old, new in ((base, bases), (best, again)) for item in new))
        base = min([base, *bases], key=by_cost)
        hypothesises = sorted((min([best, *again], key=by_cost), *hypothesises[1:]), key=by_cost)
        if gained < CAL.enough:
            break
    return base, hypothesises


def _near(
    result: Mapping[frozenset[str], Hypothesis], among: Iterable[frozenset[str]], cost: float
) -> list[frozenset[str]]:
    """Those of them that cost no more than the best of all by so much, best first."""
    least = min(item.cost for item in result.values())
    return sorted((names for names in among if result[names].cost - least < cost), key=lambda names: result[names].cost)


def _in_each_place(
    search: Search, hypothesises: Sequence[Hypothesis], candidates: Sequence[Candidate], worth: float
) -> list[Hypothesis]:
    """What may stand in the place of each effect of the best pair, if that gains what two effects must.

    Partners were promised beside an effect, and refitted, while nuisances had taken up what had no name yet. Where
    these are beside the pair, others may do better.
    """
    pair = min((item for item in hypothesises if len(item.candidates) == 2), key=by_cost, default=None)
    alone = min((item.cost for item in hypothesises if len(item.candidates) == 1), default=np.inf)
    if pair is None or alone - pair.cost <= worth or not (search.moving or search.shifts):
        return []
    replacing = list[Hypothesis]()
    with search.elsewhere():
        search.about(pair)
        for parent in _without_each(search, pair):
            promised = promises(search, parent, candidates)[: CAL.replacing]
            replacing += _with_each(search, parent, [item for item in promised if item.gain > CAL.partner_least])
    return list(_best_of_each(replacing).values())


def _stands(search: Search, best: Hypothesis) -> bool:
    """Whether simulations do without firm observers: the best explanation, and none at all."""
    loosely = refit(search, [search.start_of(best)])
    nothing = Start((), np.empty(0), best.theta, best.linear)
    return bool(loosely) and loosely[0].cost <= CAL.rather * best.cost and bool(refit(search, [nothing]))


def _base(search: Search, best: Hypothesis) -> Hypothesis:
    """Nothing but nuisances, as well as they can do."""
    search.about(best)
    nothing = Start((), np.empty(0), best.theta, best.linear)
    result = refit(search, [search.start_of(search.at_means()), nothing])
    if not result:
        raise BadInput("Simulations leave the range of numbers: is this the right vehicle, in the right units?")
    base = min(result, key=by_cost)
    return settled(search, base)


def _from_beliefs(
    search: Search, base: Hypothesis, candidates: Sequence[Candidate], singles: Sequence[Hypothesis], worth: float
) -> list[Hypothesis]:
    """Single effects from where nuisances are believed to be, if some went far from there to do without an effect.

    Those that went far are let go, where they may be effects themselves. What has taken a cause's place may hold it:
    from there a refit finds a little of the cause, and no way back. Nuisances are linearised again beside those that
    may yet be the best.
    """
    if not _far(search, base):
        return []
    themselves = _let_go(search, base, candidates)
    with search.elsewhere():
        search.about(None)
        believed = search.at_means()
        (e,) = search.residuals([search.vector(believed)])
        believed = replace(believed, e=e, J=np.zeros((*e.shape, 0)))
        if not np.all(np.isfinite(e)):
            return themselves
        promised = promises(search, believed, candidates)[: CAL.replacing]
        hypothesises = _with_each(search, believed, promised)
        least = min((item.cost for item in (*singles, *themselves, *hypothesises)), default=np.inf)
        enough = least + max(CAL.close * worth, CAL.nearly * (base.cost - least))
        hypothesises = _gaps(search, [settled(search, item) if item.cost < enough else item for item in hypothesises])
    return [*themselves, *hypothesises]


def _far(search: Search, base: Hypothesis) -> set[int]:
    """Parameters that are tolerances and further off than these reach."""
    axes = (*search.moving, *search.shifts)
    return {axis.index for axis, off in zip(axes, search.far(base), strict=True) if off > CAL.tolerated_sd}


def _let_go(search: Search, base: Hypothesis, candidates: Sequence[Candidate]) -> list[Hypothesis]:
    """Effects that the base has as tolerances, further off than these reach, from where it has them; best first."""
    far = _far(search, base)
    starts = [
        Start(
            (candidate,), np.array([search.where(base, main), *(axis.null for axis in others)]), base.theta, base.linear
        )
        for candidate in candidates
        for main, *others in [candidate.axes]
        if main.index in far
    ]
    return _gaps(search, refit(search, starts))


def _combine(
    search: Search,
    base: Hypothesis,
    singles: list[Hypothesis],
    tried: dict[frozenset[str], Hypothesis],
    best: Hypothesis,
    likely: Sequence[Candidate],
    cost: Callable[[str], float],
) -> None:
    """Add pairs about the best singles to what was tried, what is left of the best pair without each, and triples."""
    least = min(item.cost for item in tried.values())
    first = [single for single in singles if single.names[0] in best.names]
    hopeful = [single for single in singles[: CAL.pairs] if base.cost - single.cost > CAL.hope * (base.cost - least)]
    for parent in [*first, *(item for item in hopeful if item not in first)]:
        behind = CAL.nearly * (parent.cost - least)
        promised = promises(search, parent, likely)[: CAL.partners]
        needed = {item.candidate.effect: cost(item.candidate.effect) for item in promised}
        needed = {name: max(item, behind - item) for name, item in needed.items()}
        enough = [item for item in promised if item.gain > needed[item.candidate.effect]]
        explained = not enough and parent is singles[0] and len(best.candidates) < 2  # by one effect
        if parent is singles[0]:  # what comes next is named, however little speaks for it
            enough = [item for item in promised if item.gain > min(needed[item.candidate.effect], CAL.partner_least)]
        new = [item for item in enough if frozenset((*parent.names, item.candidate.effect)) not in tried]
        tried |= {frozenset(item.names): item for item in _with_each(search, parent, new)}
        if explained:
            return
        least = min(item.cost for item in tried.values())
    pairs = sorted((item for item in tried.values() if len(item.candidates) == 2), key=by_cost)
    if not pairs:
        return
    for item in _without_each(search, pairs[0]):
        name = frozenset(item.names)
        if name not in tried or item.cost < tried[name].cost:
            tried[name] = item
    alone = min(item.cost for item in tried.values() if len(item.candidates) == 1)
    if alone - pairs[0].cost > min(cost(name) for name in pairs[0].names):
        promised = promises(search, pairs[0], likely)[: CAL.triples]
        enough = [item for item in promised if item.gain > cost(item.candidate.effect)]
        tried |= {frozenset(item.names): item for item in _with_each(search, pairs[0], enough)}


def _rough(search: Search, candidates: Sequence[Candidate]) -> tuple[Hypothesis, list[Candidate]]:
    """The best explanation by one or two effects, with noise as it is stated; candidates, from where they are best."""
    search.about(None)
    base = refitted(search, search.at_means())
    base = settled(search, base, 1)
    promised = promises(search, base, candidates)
    known = from_where_best(promised, candidates)
    best = min([base, *_with_each(search, base, promised[: CAL.rough_singles])], key=by_cost)
    if best.candidates:
        more = [promise for promise in promises(search, best, known)[:2] if promise.gain > CAL.much * best.cost]
        best = min([best, *_with_each(search, best, more)], key=by_cost)
    return best, known


def _without_each(search: Search, whole: Hypothesis) -> list[Hypothesis]:
    """The hypothesis without one of its effects, for each, from where it stood."""
    starts = [search.start_of(whole.only(set(whole.names) - {name})) for name in whole.names]
    return _gaps(search, refit(search, starts))


def _gaps(search: Search, hypothesises: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those of which every effect is larger than its tolerance, best first."""
    return sorted((item for item in hypothesises if not search.tolerated(item)), key=by_cost)


def _better(singles: list[Hypothesis], known: Hypothesis) -> list[Hypothesis]:
    """Singles with one that was known before, in place of the same one if it is better."""
    others = [single for single in singles if single.names != known.names or single.cost <= known.cost]
    new = others if any(other.names == known.names for other in others) else [*others, known]
    return sorted(new, key=by_cost)


def refitted(search: Search, again: Hypothesis) -> Hypothesis:
    """A hypothesis, from where it stood."""
    result = refit(search, [search.start_of(again)])
    return result[0] if result else again


def _with_each(search: Search, parent: Hypothesis, promised: Sequence[Promise]) -> list[Hypothesis]:
    """The parent with one more effect, for each of those that promise something, in its best form; best first."""
    starts = []
    for item in promised:
        candidate, m = item.candidate, np.append(parent.m, item.start)
        null = np.append(parent.m, [search.where(parent, candidate.axes[0]), *item.start[1:]])
        way_back = (parent, null) if candidate.gradual else None
        count = len(parent.theta)
        theta, linear = item.nuisances[:count], item.nuisances[count:]
        starts.append(Start((*parent.candidates, candidate), m, theta, linear, way_back, parent.J))
    return list(_best_of_each(_gaps(search, refit(search, starts))).values())


def _best_of_each(hypothesises: Iterable[Hypothesis]) -> dict[frozenset[str], Hypothesis]:
    """The best hypothesis of the same effects, for each; best first."""
    best: dict[frozenset[str], Hypothesis] = {}
    for item in sorted(hypothesises, key=by_cost):
        best.setdefault(frozenset(item.names), item)
    return best


def _from_believed_lags(search: Search, hypothesises: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses, best first; those with delays or lags again from where the lags that are stated are believed to be.

    These have taken up what is late before it had a name, each as much as it may. Beside a delay too short by as
    much they stay there: a delay moves by rows, and no derivative leads on.
    """
    stated = [k for k, axis in enumerate(search.shifts) if axis.unit == "s"]
    better = list(hypothesises)
    if not stated:
        return better
    with search.elsewhere():
        for k, item in enumerate(better[: CAL.late]):
            late = [j for j, axis in enumerate(item.axes) if axis.abrupt and axis.unit == "s"]
            if not late:
                continue
            freed = replace(item, linear=_unmoved(search, item.linear))
            search.about(freed)
            taken = float(sum(abs(item.linear[j] - search.shifts[j].null) for j in stated))
            starts = [Start(item.candidates, item.m, item.theta, freed.linear)]
            for j in late:
                m = item.m.copy()
                m[j] = min(m[j] + taken, item.axes[j].high)
                starts.append(Start(item.candidates, m, item.theta, freed.linear))
            again = refit(search, starts)
            better[k] = min([item, *again], key=by_cost)
    return sorted(better, key=by_cost)


def _unmoved(search: Search, linear: Array) -> Array:
    """Linear nuisances with abrupt tolerances where they are believed to be; starts of runs stay."""
    count, moving = 2 * len(search.shifts), len(search.moving)
    return np.concatenate([search.means[moving : moving + count], linear[count:]])
