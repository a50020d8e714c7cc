"""From likelihoods to probabilities: which effects are present, and whether any is.

Every refitted hypothesis has a weight: the likelihood it gains, less a cost for each effect. An effect whose magnitude
differs between parts of a drive costs more, by as much as that widens the variance of its magnitude. Where models have
no unknown forces and tolerances are stated, equations are inexact, and model-form errors gain likelihood by chance: in
proportion to the number of readings, which is why a reading counts for less in refits already, and to the error that
the best hypothesis leaves. Weights are tempered by that. An effect's probability is the weight of the hypotheses that
contain it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from scipy.special import chdtrc, chdtri, softmax

from ..base.shorthands import Array, Mask
from .estimation.axes import Candidate
from .estimation.calibration import CAL
from .estimation.constancy import discounted
from .estimation.hypothesis import Hypothesis
from .estimation.noise import AutoregressiveNoise
from .selection import Selection, cost_without

NEVER = 1e6
"""Cost of an effect that only moves readings past rows."""
Costs = Callable[[str], float]
"""Prior log-odds against an effect, by its name."""


NONE: Mapping[str, float] = MappingProxyType({})
Unsteady = Callable[[Hypothesis], Sequence[float]]
"""Of each effect of a hypothesis, how its magnitude differs between parts, see `constancy.unsteadiness`."""


def costs(forces: bool, candidates: Sequence[Candidate] = ()) -> Costs:
    """Prior log-odds against effects, for models with or without unknown forces.

    By noise and tolerances, twice the gain of an effect is distributed as chi-square of one degree of freedom: the cost
    is a gain that the best of all candidates rarely reaches. Where a tolerance beside an effect acts abruptly and
    enters to first order alone, as those of delays and lags do, the effect may gain more just by being simulated.
    """
    if not forces:
        return lambda effect: CAL.cost_without_forces
    by_chance = 0.5 * float(chdtri(1, CAL.rare / max(len(candidates), 1)))
    known = {candidate.effect: by_chance if candidate.gradual else CAL.cost for candidate in candidates}
    return lambda effect: known.get(effect, CAL.cost)


@dataclass(frozen=True)
class Evidence:
    """Weights of hypotheses.

    Attributes
    ----------
    temper : factor on the log-likelihoods of readings.
    weights : of `selection.tried`, and the base last; they add up to one.
    scores : log weights of `selection.tried` over the base's.
    outdone : effect -> factor on its cost, for effects that would be part of the best explanation without it.
    even : weights with all these factors at one, which rank effects that are not called causes.
    """

    temper: float
    weights: tuple[float, ...]
    scores: tuple[float, ...]
    outdone: Mapping[str, float] = field(default_factory=dict)
    even: tuple[float, ...] = ()


def evidence(
    selection: Selection, inexact: bool, cost: Costs, left: float = 0.0, unsteady: Unsteady | None = None
) -> Evidence:
    """Weigh hypotheses.

    Parameters
    ----------
    inexact : whether tolerances are stated.
    left : mean square of the best hypothesis' errors over that of noise, less one.
    unsteady : how magnitudes of hypotheses' effects differ between parts; None: not at all.
    """
    search = selection.search
    temper = tempering(search.whitener.readings, inexact, left)
    tried = selection.tried
    gained = np.array([temper / search.trust * (selection.base.cost - item.cost) for item in tried])
    least = [price(item, cost) for item in tried]
    margins = (gained - least).tolist()
    factors = _unsteady_factors(selection, margins, cost, unsteady) if unsteady is not None else {}
    prices = [price(item, cost, factors) for item in tried]
    scores, even = ((gained - _prices_of_aliases(tried, each)).tolist() for each in (prices, least))
    most = max([*scores, 0.0])
    beyond = {name for item, margin in zip(tried, margins, strict=True) if margin > most for name in item.names}
    outdone = {name: by for name, by in factors.items() if by > 1.0 and name in beyond}
    weights, even_weights = (tuple(softmax([*each, 0.0])) for each in (scores, even))
    return Evidence(temper, weights, tuple(scores), outdone, even_weights)


def heaviest(selection: Selection, evidence: Evidence) -> Hypothesis:
    """The hypothesis of largest weight, where all with effects together outweigh the base: aliases share a weight."""
    if not selection.tried or evidence.weights[-1] >= 0.5:
        return selection.base
    return selection.tried[int(np.argmax(evidence.scores))]


def tempering(readings: int, inexact: bool, left: float = 0.0) -> float:
    """Factor on gains in log-likelihood."""
    each = CAL.form_gain_per_reading + CAL.form_gain_share * max(left, 0.0) / 2
    return CAL.negligible_form_gain / (CAL.negligible_form_gain + (each * readings if inexact else 0.0))


def _unsteady_factors(
    selection: Selection, margins: Sequence[float], cost: Costs, unsteady: Unsteady
) -> dict[str, float]:
    """Effect -> factor on its cost, from its unsteadiness in the hypothesis of least cost that contains it.

    It is one where that hypothesis does not gain its least price, and the same in all hypotheses: otherwise a partner
    beside which a large effect differs a little less would seem to gain the difference. That hypothesis is the best
    explanation, if it contains the effect: others may only be refitted as far as tells that they are aliases, and an
    effect of theirs then varies with the rest. The factor decides whether an effect is present, not which: between once
    and twice the gain that is needed it falls back to one, so that effects that surely explain the same are
    distinguished by their gains.
    """
    tried, best = selection.tried, dict[str, int]()
    for k, item in enumerate(tried):
        for name in item.names:
            best.setdefault(name, k)
    known = {
        k: dict(zip(tried[k].names, unsteady(tried[k]), strict=True)) for k in set(best.values()) if margins[k] > 0
    }
    result = dict[str, float]()
    for name, k in best.items():
        if k in known:
            gained = (cost_without(selection, tried[k], name) - tried[k].cost) / selection.search.trust
            by = gained / float(discounted(np.array(gained), known[k][name])) if gained > 0 else 1.0
            result[name] = 1.0 + (by - 1.0) * float(np.clip(2.0 - gained / (by * cost(name)), 0.0, 1.0))
    return result


def price(hypothesis: Hypothesis, cost: Costs, factors: Mapping[str, float] = NONE) -> float:
    """Cost of a hypothesis: for each effect and second parameter, and for effects that only move readings past rows.

    `factors` are those on the costs of effects, one where none is given.
    """
    total = 0.0
    for item, at in hypothesis.parts:
        total += factors.get(item.effect, 1.0) * cost(item.effect) + CAL.second_parameter * (item.free - 1)
        total += CAL.begins if item.part is not None else 0.0
        axis = item.axes[0]
        off = abs(hypothesis.m[at.start] - axis.null)
        if (axis.shift or not item.gradual) and off < CAL.next_to_nothing * axis.scale:
            total += NEVER
    return total


def _prices_of_aliases(tried: Sequence[Hypothesis], prices: Sequence[float]) -> list[float]:
    """Prices of hypotheses: each is the highest among those that explain the same with as many effects.

    Where two names are one cause, the readings cannot distinguish them: a lower cost must not do so.
    """

    def alike(one: Hypothesis, other: Hypothesis) -> bool:
        return len(other.candidates) == len(one.candidates) and abs(other.cost - one.cost) < CAL.twins

    each = list(zip(tried, prices, strict=True))
    return [
        max(price for other, price in each if other is item or (price < NEVER and alike(item, other))) for item in tried
    ]


def probability(evidence: Evidence, tried: Sequence[Hypothesis], *effects: str) -> float:
    """The probability that any of these effects is present: the weight of the hypotheses that contain one."""
    each = zip(evidence.weights, tried, strict=False)
    return float(min(sum(weight for weight, item in each if not set(effects).isdisjoint(item.names)), 1.0))


def p_value(gain: float, axes: int, candidates: int) -> float:
    """How often the best of `candidates` candidates gains as much from noise alone (Bonferroni)."""
    return float(min(1.0, candidates * chdtrc(max(axes, 1), 2 * max(gain, 0.0))))


def by_chance(score: float) -> float:
    """How often a vehicle without a gap scores as much by form errors that an effect mimics: as rarely as costs say."""
    return float(min(1.0, CAL.rare * np.exp(-max(score, np.log(CAL.rare)))))


def by_plain_errors(selection: Selection, sd: Array, good: Mask) -> Selection:
    """The selection with the costs of hypotheses by plain errors, where these are higher.

    Training minimises plain errors, and leaves correlated ones. Whitening emphasises their fast part, which training
    did not: an effect then seems to explain what other weights would explain as well, even on a recording like those of
    the training, while plain errors grow with it. The gain of an effect is the smaller of the two.

    Parameters
    ----------
    selection : of a map with memory, hypotheses refitted on whitened residuals.
    sd : (channels,) of the errors that training left.
    good : (N, channels) readings that count.
    """
    noise = selection.search.whitener
    assert isinstance(noise, AutoregressiveNoise)  # maps with memory know no forces
    slow = np.array([s / max(abs(1.0 - float(np.sum(a))), 1e-3) for s, a in zip(noise.sd, noise.ar, strict=True)])
    rows = np.maximum((slow / noise.stationary_sd) ** 2, 1.0)  # with as much information as one independent reading
    weight = 0.5 / (sd**2 * rows)
    base = selection.base

    def cost(hypothesis: Hypothesis) -> float:
        gain = float(np.sum(np.where(good, base.e**2 - hypothesis.e**2, 0.0) @ weight))
        return max(hypothesis.cost, base.cost - selection.search.trust * gain)

    tried = sorted((replace(item, cost=cost(item)) for item in selection.tried), key=lambda item: item.cost)
    return replace(selection, tried=tuple(tried))
