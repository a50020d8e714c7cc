"""From likelihoods to probabilities: which effects are present, and is there anything at all.

Every refitted hypothesis gets a weight: the likelihood it gains, less what each further effect costs. An effect whose
magnitude differs between parts of a drive costs more, by as much as that widens the variance of the whole. Where
models know no unknown forces and tolerances are stated, equations are stated to be rough too, and misfits of their form
gain likelihood here and there in proportion to how much was read, for which readings count for less in refits already,
and to how much the best hypothesis leaves: that tempers weights. An effect's probability is the weight of the
hypotheses that hold it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from ..base.shorthands import Array
from .estimation.axes import Candidate
from .estimation.calibration import CAL
from .estimation.constancy import steadily
from .estimation.hypothesis import Hypothesis
from .estimation.noise import Colour
from .selection import Selection

NEVER = 1e6
"""What an effect costs that does nothing but move readings past rows."""
Costs = Callable[[str], float]
"""Log-odds against an effect before anything was read, by its name."""


NONE: Mapping[str, float] = MappingProxyType({})
Unsteady = Callable[[Hypothesis], Sequence[float]]
"""Of each effect of a hypothesis, how its magnitude differs between parts, see `constancy.unsteadiness`."""


def costs(forces: bool, candidates: Sequence[Candidate] = ()) -> Costs:
    """Those of models that know unknown forces, or of others.

    Twice what noise and tolerances gain by an effect is distributed as chi-square of one degree of freedom: the cost is
    what the best of all candidates rarely gains. Where a tolerance beside an effect acts abruptly and enters to first
    order alone, as those of delays and lags do, the effect may gain more by being simulated.
    """
    if not forces:
        return lambda effect: CAL.cost_without_forces
    by_chance = 0.5 * float(chdtri(1, CAL.rare / max(len(candidates), 1)))
    known = {candidate.effect: by_chance if candidate.gradual else CAL.cost for candidate in candidates}
    return lambda effect: known.get(effect, CAL.cost)


@dataclass(frozen=True)
class Evidence:
    """What hypotheses weigh.

    Attributes
    ----------
    temper : what log-likelihoods of readings are multiplied with.
    weights : of `selection.tried`, and the base last; they add up to one.
    scores : of `selection.tried`, over the base's.
    outdone : effect -> what multiplied its cost, of those that would be part of the best explanation without that.
    even : weights if no cost were multiplied: which name is nearest among those that are none.
    """

    temper: float
    weights: tuple[float, ...]
    scores: tuple[float, ...]
    outdone: Mapping[str, float] = field(default_factory=dict)
    even: tuple[float, ...] = ()


def evidence(
    selection: Selection, rough: bool, cost: Costs, left: float = 0.0, unsteady: Unsteady | None = None
) -> Evidence:
    """Weigh hypotheses.

    Parameters
    ----------
    selection : hypotheses refitted on the same noise.
    rough : whether tolerances are stated.
    cost : of effects.
    left : mean square over that of noise, less one, of what the best of them leaves.
    unsteady : how magnitudes of hypotheses' effects differ between parts; None: not at all.
    """
    search = selection.search
    temper = tempering(search.colour.readings, rough, left)
    gained = [temper / search.trust * (selection.base.cost - item.cost) for item in selection.tried]
    least = [price(item, cost) for item in selection.tried]
    worth = [gain - option for gain, option in zip(gained, least, strict=True)]
    grown = _stretches(selection, worth, cost, unsteady) if unsteady is not None else {}
    prices = _as_dear(selection.tried, [price(item, cost, grown) for item in selection.tried] if grown else least)
    scores = [item - price for item, price in zip(gained, prices, strict=True)]
    most = max([*scores, 0.0])
    beyond = [item for item, each in zip(selection.tried, worth, strict=True) if each > most]
    outdone = {name: by for name, by in grown.items() if by > 1.0 and any(name in item.names for item in beyond)}
    even = [item - option for item, option in zip(gained, _as_dear(selection.tried, least), strict=True)]
    return Evidence(temper, _weights(scores), tuple(scores), outdone, _weights(even))


def _weights(scores: Sequence[float]) -> tuple[float, ...]:
    """Of hypotheses with these scores, and of the base, which has none, last."""
    total = np.array([*scores, 0.0])
    weights = np.exp(total - np.max(total))
    return tuple(weights / np.sum(weights))


def heaviest(selection: Selection, evidence: Evidence) -> Hypothesis:
    """The hypothesis that weighs most, where those with effects outweigh the base together: aliases share a weight."""
    if not selection.tried or evidence.weights[-1] >= 0.5:
        return selection.base
    return selection.tried[int(np.argmax(evidence.scores))]


def tempering(readings: int, rough: bool, left: float = 0.0) -> float:
    """What gains in log-likelihood are multiplied with."""
    each = CAL.rough_reading + CAL.misfit_share * max(left, 0.0) / 2
    return CAL.untempered / (CAL.untempered + (each * readings if rough else 0.0))


def _stretches(selection: Selection, worth: Sequence[float], cost: Costs, unsteady: Unsteady) -> dict[str, float]:
    """Effect -> by what its cost grows: as the best hypothesis that holds it has it, if that is worth its least price.

    The same in all of them: else a partner beside which a large effect differs a little less would seem to gain that.
    It says whether an effect is there, not which: where one gains more than it must by far, up to twice as much, its
    cost falls back, for names that explain the same surely are told apart by what they gain.
    """
    tried, best = selection.tried, dict[str, int]()
    for k in sorted(range(len(tried)), key=lambda k: -worth[k]):
        for name in tried[k].names:
            best.setdefault(name, k)
    known = {k: dict(zip(tried[k].names, unsteady(tried[k]), strict=True)) for k in set(best.values()) if worth[k] > 0}
    result = dict[str, float]()
    for name, k in best.items():
        if k in known:
            others = set(tried[k].names) - {name}
            without = min([selection.base.cost, *(item.cost for item in tried if set(item.names) == others)])
            gained = (without - tried[k].cost) / selection.search.trust
            by = gained / float(steadily(np.array(gained), known[k][name])) if gained > 0 else 1.0
            result[name] = 1.0 + (by - 1.0) * float(np.clip(2.0 - gained / (by * cost(name)), 0.0, 1.0))
    return result


def price(hypothesis: Hypothesis, cost: Costs, stretches: Mapping[str, float] = NONE) -> float:
    """What a hypothesis costs for being complicated, or for an effect that does nothing but move readings past rows.

    Parameters
    ----------
    hypothesis, cost : of effects.
    stretches : effect -> what multiplies its cost; one where there is none.
    """
    total = 0.0
    for item, at in hypothesis.parts:
        total += stretches.get(item.effect, 1.0) * cost(item.effect) + CAL.second_parameter * (item.free - 1)
        total += CAL.begins if item.part is not None else 0.0
        axis = item.axes[0]
        if (axis.shift or not item.gradual) and abs(
            hypothesis.m[at.start] - axis.null
        ) < CAL.next_to_nothing * axis.scale:
            total += NEVER
    return total


def _as_dear(tried: Sequence[Hypothesis], prices: Sequence[float]) -> list[float]:
    """What each costs: as much as the dearest that explains the same, with as many effects.

    Where two names are one cause, nothing that was read says which: a lower cost must not decide it.
    """
    return [
        max(
            price
            for other, price in zip(tried, prices, strict=True)
            if other is item
            or (
                price < NEVER
                and len(other.candidates) == len(item.candidates)
                and abs(other.cost - item.cost) < CAL.twins
            )
        )
        for item in tried
    ]


def probability(evidence: Evidence, tried: Sequence[Hypothesis], *effects: str) -> float:
    """That an effect is present, or any of several: the weight of the hypotheses that hold it."""
    value = [
        weight for weight, each in zip(evidence.weights, tried, strict=False) if not set(effects).isdisjoint(each.names)
    ]
    return float(min(sum(value), 1.0))


def p_value(gain: float, axes: int, candidates: int) -> float:
    """How often the best of so many candidates gains so much from noise alone (Bonferroni)."""
    return float(min(1.0, candidates * chdtrc(max(axes, 1), 2 * max(gain, 0.0))))


def by_chance(score: float) -> float:
    """How often a vehicle without a gap scores so, by errors of form that an effect mimics: as rarely as costs say."""
    return float(min(1.0, CAL.rare * np.exp(-max(score, np.log(CAL.rare)))))


def plainly(selection: Selection, sd: Array, good: NDArray[np.bool_]) -> Selection:
    """The selection with hypotheses that cost as much as plain errors say, where that is more.

    Training minimises plain errors, and leaves coloured ones. Whitening looks at what is fast in them, at which
    training never looked: there an effect seems to explain what other weights would explain as well, even on a
    recording like those of the training, and plain errors grow with it. An effect gains what it gains in both.

    Parameters
    ----------
    selection : of a map with memory, hypotheses refitted on whitened residuals.
    sd : (channels,) of what training left.
    good : (N, channels) readings that count.
    """
    colour = selection.search.colour
    assert isinstance(colour, Colour)  # maps with memory know no forces
    weight = 0.5 / (sd**2 * _lasting(colour))
    base = selection.base

    def cost(hypothesis: Hypothesis) -> float:
        gain = float(np.sum(np.where(good, base.e**2 - hypothesis.e**2, 0.0) @ weight))
        return max(hypothesis.cost, base.cost - selection.search.trust * gain)

    tried = sorted((replace(item, cost=cost(item)) for item in selection.tried), key=lambda item: item.cost)
    return replace(selection, tried=tuple(tried))


def _lasting(colour: Colour) -> Array:
    """(channels,) how many rows tell as much as one would if residuals did not carry on from row to row."""
    slow = np.array([s / max(abs(1.0 - float(np.sum(a))), 1e-3) for s, a in zip(colour.sd, colour.ar, strict=True)])
    return np.asarray(np.maximum((slow / colour.stationary_sd) ** 2, 1.0))
