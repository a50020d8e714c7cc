"""From the joint search to hypotheses: the best set of causes, without each of them, and with others in its place.

The joint search (`estimation.together`) estimates the scale of model error and which causes are present. Each of these
is then dropped and everything else refitted: it stays if it gains what a cause must, after a discount for how much its
magnitude differs between parts of the drive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array, Mask
from .estimation.axes import Axis, Candidate
from .estimation.calibration import CAL
from .estimation.constancy import discounted
from .estimation.hypothesis import Hypothesis, Start, by_cost
from .estimation.problem import FORM, JointProblem
from .estimation.refit import refit, settled, with_slopes
from .estimation.search import Search
from .estimation.together import JointSearch, JointStage, JointWhitening
from .estimation.walks import walked

Unsteadiness = Callable[[Search, Hypothesis], list[float]]
"""Of each effect of a hypothesis, how its magnitude varies over parts of the drive, see `constancy.unsteadiness`."""


@dataclass(frozen=True)
class ExpectedGain:
    """What a single candidate is expected to gain beside nuisances, to first order.

    Attributes
    ----------
    candidate : which.
    gain : in log-likelihood.
    start : coordinates from which to refit it.
    sd : of its magnitude's coordinate on this recording.
    remaining_information : share of the information about it that remains once nuisances are refitted.
    """

    candidate: Candidate
    gain: float
    start: tuple[float, ...]
    sd: float = inf
    remaining_information: float = 1.0


@dataclass(frozen=True)
class Selection:
    """Hypotheses refitted with the same noise model.

    Attributes
    ----------
    search : what refitted them.
    base : nuisances alone, without effects.
    tried : the best explanation, the same without each of its effects and with others in its place, and single effects;
        best first.
    expected_gains : of every single candidate beside the base.
    apart : log-likelihood by which two walks differ that disagree about causes, see `estimation.walks`.
    beside : names of the effects beside which the search has linearised nuisances.
    """

    search: Search
    base: Hypothesis
    tried: tuple[Hypothesis, ...]
    expected_gains: tuple[ExpectedGain, ...]
    apart: float = 0.0
    beside: tuple[str, ...] = ()

    def of(self, size: int) -> list[Hypothesis]:
        """Hypotheses of `size` effects, best first."""
        return [item for item in self.tried if len(item.candidates) == size]


def select(
    together: JointSearch,
    nuisances: Sequence[Axis],
    costs: Callable[[str], float],
    unsteadiness: Unsteadiness,
    trust: float,
    stands: Callable[[Array], bool],
) -> Selection:
    """Refit the hypotheses that may explain the recording.

    Parameters
    ----------
    together : the joint search.
    nuisances : tolerances, zones of indifference among them.
    costs : log-likelihood that effects must gain, by name.
    unsteadiness : of each effect of a hypothesis, see `constancy`.
    trust : how many independent readings one counts as.
    stands : whether free runs with a parameter vector do not spin; where they do, no effect is considered.
    """
    stage, prices, apart = _walked(together, costs, stands)
    nothing = np.zeros(len(prices))
    explained = _Explained(*together.pruned(stage, prices, nothing, nothing), nothing)
    search = _search_at(together.problem, explained.stage, nuisances, trust)
    explained, best = _weighed_by_parts(search, together, explained, prices, unsteadiness)
    place = search.place()
    base = _base(search, best)
    if not best.names:  # no effect is left that a small model error would favour
        base = best = _in_shown_error(search, together.whitening, base)
    else:  # sizes and sds of its effects follow from what nuisances do beside them, not without them
        search.back(place)
    if best.names and base.cost - best.cost < 0.5 * float(np.max(explained.gains)):  # the refit failed, far from linear
        explained = replace(explained, gains=np.minimum(explained.gains, max(base.cost - best.cost, 0.0)))
    alike = _exchanged(search, together, explained.stage, best, explained.gains) if best.names else []
    names = [cause.name for cause in together.problem.causes]
    if alike and min(alike, key=by_cost).cost < best.cost - CAL.enough:  # both may explain more than either
        included = explained.stage.included | np.isin(names, min(alike, key=by_cost).names)
        both = together.refitted(explained.stage, included, CAL.exchange_steps)
        stage, gains = together.pruned(both, prices, explained.unsteady, explained.gains)
        explained = replace(explained, stage=stage, gains=gains)
        again = _refitted(search, _placed(search, together, stage))
        if again.cost < best.cost:
            best, alike = again, [best, *alike, *_exchanged(search, together, stage, again, gains)]
    without = _without_each(search, best, names, explained.gains)
    if (top := min((best, *alike), key=by_cost)) is not best:
        without += _without_each(search, top, names, explained.gains)
    base = min((base, *(replace(base, cost=item.cost) for item in without if not item.names)), key=by_cost)
    tried, offered = [best, *without, *alike], expected_gains(together, explained.stage)
    if len({name for item in tried for name in item.names}) < CAL.listed:
        tried += _alone(search, base, offered[: CAL.listed], costs)
    each = dict[frozenset[str], Hypothesis]()
    for item in tried:  # the best explanation stands before those that cost the same
        if item.names:
            each.setdefault(frozenset(item.names), item)
    result = sorted(each.values(), key=by_cost)
    if result:
        result = [*with_slopes(search, result[:1]), *result[1:]]
    return Selection(search, base, tuple(result), offered, apart, best.names)


@dataclass(frozen=True)
class _Explained:
    """What the joint search explains.

    Attributes
    ----------
    stage : its state.
    gains : (causes,) log-likelihood that each of its causes gains beside the others.
    unsteady : (causes,) how magnitudes differ between parts of the drive, as far as gains were discounted for it.
    """

    stage: JointStage
    gains: Array
    unsteady: Array


def _walked(
    together: JointSearch, costs: Callable[[str], float], stands: Callable[[Array], bool]
) -> tuple[JointStage, Array, float]:
    """The stage with most evidence, what each cause must gain, (causes,), and by how much two walks differ."""
    problem = together.problem
    prices = np.array([
        costs(cause.name) + CAL.second_parameter * len(cause.forms[0].seconds) for cause in problem.causes
    ])  # fmt: skip
    stage, disputed = walked(together)
    stage, apart = together.explained(stage), float(np.max(disputed, initial=0.0))
    if stands(problem.vector(stage.state)):
        return together.exchanged(stage), prices + disputed, apart
    stage = together.refitted(stage, np.zeros_like(stage.included), CAL.exchange_steps)
    return stage, np.full_like(prices, inf), apart


def _search_at(problem: JointProblem, stage: JointStage, nuisances: Sequence[Axis], trust: float) -> Search:
    """What refits hypotheses in the model error of a stage, model-form errors in proportion to it."""
    axes = [replace(a, sd=a.sd * stage.error_scale, scale=a.scale * stage.error_scale) if a.name.startswith(FORM) else a
            for a in nuisances]  # fmt: skip
    search = Search(problem.bench, axes, stage.whitener, trust, stage.error_scale)
    search.nominal[:] = problem.nominal
    search.about(None)
    return search


def _weighed_by_parts(
    search: Search, together: JointSearch, explained: _Explained, prices: Array, unsteadiness: Unsteadiness
) -> tuple[_Explained, Hypothesis]:
    """What is explained by causes that gain enough although their magnitudes differ between parts, and its hypothesis.

    Causes at their bounds are symptoms of others, which are looked for without them.
    """
    best, unsteady = _refitted(search, _placed(search, together, explained.stage)), explained.unsteady.copy()
    names = [cause.name for cause in together.problem.causes]
    for _ in range(CAL.spreads_weighed):
        by = dict(zip(best.names, unsteadiness(search, best), strict=True)) | dict.fromkeys(best.at_bounds, inf)
        seen = np.array([max(by.get(name, 0.0), known) for name, known in zip(names, unsteady, strict=True)])
        off = np.where(explained.stage.included, discounted(explained.gains, seen) - prices, np.inf)
        weak = np.argsort(off)[: np.count_nonzero(off < 0)]
        if not len(weak):
            break
        worse = weak[: -(-len(weak) // 2)]  # these may be why others differ between parts
        unsteady[worse] = seen[worse]
        later, gained = together.pruned(explained.stage, prices, unsteady, explained.gains)
        again = _refitted(search, _placed(search, together, later))
        if np.any(later.included) and not again.names:  # simulations with these overflow
            break
        explained, best = replace(explained, stage=later, gains=gained), again
    return replace(explained, unsteady=unsteady), best


def _alone(
    search: Search, base: Hypothesis, offered: Sequence[ExpectedGain], costs: Callable[[str], float]
) -> list[Hypothesis]:
    """Single effects, refitted for the list only: the joint search has decided that none gains enough."""
    starts = [Start((_as_refitted(item.candidate),), np.array(item.start), base.theta, base.linear) for item in offered]
    result = refit(search, starts)
    return [replace(item, cost=max(item.cost, base.cost - costs(item.names[0]))) for item in result]


def cost_without(selection: Selection, hypothesis: Hypothesis, name: str) -> float:
    """The cost of a hypothesis without one of its effects, at most that of any other without it and with fewer.

    Aliases are tried without each of their effects only as far as the best explanation is, and refits are incomplete.
    """
    others = set(hypothesis.names) - {name}
    return min(item.cost for item in (selection.base, *selection.tried) if others.issuperset(item.names))


def _placed(search: Search, together: JointSearch, stage: JointStage) -> Hypothesis:
    """The explanation of a stage as a hypothesis that is not simulated yet."""
    problem, state = together.problem, stage.state
    p = problem.vector(state)
    values = {axis.name: float(p[axis.index]) for axis in search.moving}
    for k in np.flatnonzero(stage.included):
        values.pop(problem.causes[k].main.name, None)
    placed = search.at_values(values)
    candidates, m = [], list[float]()
    for k in np.flatnonzero(stage.included):
        cause = problem.causes[k]
        candidates.append(_as_refitted(problem.causes[k].forms[state.form[k]].candidate))
        at = float(state.m[k]) if state.on[k] or problem.smooth[k] else float(cause.main.null)
        seconds = [
            axis.value(x)
            for axis, x in zip(cause.forms[state.form[k]].candidate.axes[1:], state.seconds[k], strict=True)
        ]
        m += [at, *seconds]
    count = sum(len(each.axes) for each in candidates)
    assert count == len(m)
    return replace(placed, candidates=tuple(candidates), m=np.array(m), J=np.zeros((*placed.e.shape, count)))


def _as_refitted(candidate: Candidate) -> Candidate:
    """A candidate with second parameters as they are, not as logarithms."""
    axes = []
    for axis in candidate.axes:
        if axis.relative:
            low, high, null = (axis.value(item) for item in (axis.low, axis.high, axis.null))
            axis = replace(axis, relative=False, low=low, high=high, null=null, mean=null, scale=axis.scale * abs(null))
        axes.append(axis)
    return replace(candidate, axes=tuple(axes))


def refitted(search: Search, again: Hypothesis) -> Hypothesis:
    """A hypothesis refitted from its present coordinates."""
    result = refit(search, [search.start_of(again)])
    return result[0] if result else again


def _refitted(search: Search, hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis refitted, with nuisances linearised about it, and begun there and at their prior means."""
    search.about(hypothesis)
    means = search.at_means()
    starts = [Start(hypothesis.candidates, hypothesis.m, each.theta, each.linear) for each in (hypothesis, means)]
    return settled(search, min(_within_numbers(search, starts), key=by_cost), 1)


def _within_numbers(search: Search, starts: Sequence[Start]) -> list[Hypothesis]:
    """Refits from these starts that do not overflow; if all do, the refit from the prior means."""
    result = refit(search, starts)
    if not result:  # lags and limits keep the values at which the search is linearised: these may be the reason
        search.about(None)
        result = refit(search, [search.start_of(search.at_means())])
    if not result:
        raise BadInput("Simulations overflow: is this the right vehicle, in the right units?")
    return result


def _without_each(search: Search, best: Hypothesis, names: Sequence[str], gains: Array) -> list[Hypothesis]:
    """An explanation without each of its effects, at the cost that the joint search found for it.

    Without the one that stands in the place of another, it has been tried; each of the others gains what it gained
    beside that other one.

    Under a map with memory, plain errors are weighed, too: there it is simulated without the effect.
    """
    places, result = {name: k for k, name in enumerate(names)}, list[Hypothesis]()
    for name in (each for each in best.names if gains[places[each]] > 0):
        rest = best.only(set(best.names) - {name})
        again = refit(search, [search.start_of(rest)]) if search.bench.learnt else []
        result.append(replace(again[0] if again else rest, cost=best.cost + float(gains[places[name]])))
    return result


def _exchanged(
    search: Search, together: JointSearch, stage: JointStage, best: Hypothesis, gains: Array
) -> list[Hypothesis]:
    """The best explanation with other causes in the place of each effect, as far as they may explain as much.

    What it costs at least to have another cause in the place of one is what the latter gains beside the other, to first
    order; of an abrupt one, about which first order says little, as much more as simulations say that it gains.
    """
    problem, sets, state = together.problem, stage.sets, stage.state
    here, starts, offs, renamed = sets.cost(stage.included), list[Start](), list[float](), list[Hypothesis]()
    for k in np.flatnonzero(stage.included):
        tried = list[tuple[float, int, Mask]]()
        without = stage.included.copy()
        without[k] = False
        more = max(float(gains[k]) / max(sets.cost(without) - here, CAL.enough), 1.0)
        for new in np.flatnonzero(~stage.included):
            swap, both = without.copy(), stage.included.copy()
            swap[new] = both[new] = True
            tried.append((more * (sets.cost(swap) - min(here, sets.cost(both))), int(new), swap))
        tried.sort(key=lambda each: each[0])
        rest = best.only(set(best.names) - {problem.causes[k].name})
        for off, other, swap in tried[: CAL.exchanged]:
            if off > CAL.exchange_look and problem.causes[k].gradual:  # first order says little about abrupt ones
                break
            form = problem.causes[other].forms[state.form[other]]
            candidate = _as_refitted(form.candidate)
            seconds = [axis.value(x) for axis, x in zip(form.candidate.axes[1:], state.seconds[other], strict=True)]
            if (min(k, other), max(k, other)) in together.late_alike:  # the same under another name
                places = (candidate if each.effect == problem.causes[k].name else each for each in best.candidates)
                renamed.append(replace(best, candidates=tuple(places)))
                continue
            size = float(np.clip(sets.sizes(swap)[0][other], problem.low[other], problem.high[other]))
            offs.append(max(off, 0.0))
            starts.append(
                Start((*rest.candidates, candidate), np.append(rest.m, [size, *seconds]), best.theta, best.linear)
            )
    refits = {item.names: item for item in refit(search, starts)}
    result = [(refits[names], off) for start, off in zip(starts, offs, strict=True)
              if (names := tuple(each.effect for each in start.candidates)) in refits]  # fmt: skip
    result = [(item, off) for item, off in result if item.names[-1] not in item.at_bounds]
    return [*renamed, *(min(item, replace(item, cost=best.cost + off), key=by_cost) for item, off in result)]


def _base(search: Search, best: Hypothesis) -> Hypothesis:
    """Nuisances alone, at their best."""
    nothing = Start((), np.empty(0), best.theta, best.linear)
    result = _within_numbers(search, [search.start_of(search.at_means()), nothing])
    return settled(search, min(result, key=by_cost))


def _in_shown_error(search: Search, whitening: JointWhitening, base: Hypothesis) -> Hypothesis:
    """The base in the model error that its own residuals show; unchanged where refits in that overflow.

    The derivatives of a simulation that spins do not determine a model error.
    """
    place, whitener = search.place(), search.whitener
    search.set_whitener(whitening.left(whitening.about(search.vector(base)), base.e, least=False))
    result = refit(search, [search.start_of(search.at_means()), search.start_of(base)])
    if result:
        return settled(search, min(result, key=by_cost))
    search.whitener = whitener
    search.back(place)
    return base


def expected_gains(together: JointSearch, stage: JointStage) -> tuple[ExpectedGain, ...]:
    """Expected gain of every effect by itself beside nuisances, to first order, largest first."""
    problem, sets = together.problem, stage.sets
    result = []
    nothing = np.zeros(len(problem.causes), dtype=bool)
    here = sets.score(nothing)
    mains = np.flatnonzero(sets.main)
    for k, cause in enumerate(problem.causes):
        alone = nothing.copy()
        alone[k] = True
        gain = sets.score(alone) - here + sets.odds[k]
        size, sd = (each[k] for each in sets.sizes(alone))
        candidate = cause.forms[stage.state.form[k]].candidate
        known = float(sets.S[mains[k], mains[k]] / max(sets.raw[mains[k]], 1e-300))
        seconds = (axis.value(x) for axis, x in zip(candidate.axes[1:], stage.state.seconds[k], strict=True))
        start = (float(np.clip(size, cause.main.low, cause.main.high)), *seconds)
        result.append(
            ExpectedGain(candidate, max(float(gain), 0.0) if np.isfinite(gain) else 0.0, start, float(sd), known)
        )
    return tuple(sorted(result, key=lambda item: -item.gain))
