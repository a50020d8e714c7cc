"""Which effects of the best explanation are called causes, why others are not, and whether something has no name."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np
from scipy.special import ndtr, ndtri

from ..base.numbers import number, whole_percent
from ..base.shorthands import Array
from ..datasets.checks.finding import listed
from .budget import closes, weak
from .estimation.calibration import CAL
from .estimation.constancy import Spread
from .estimation.hypothesis import Hypothesis, Start, by_cost
from .estimation.refit import refit
from .evidence import costs, probability
from .examining import TINY, Examined
from .gap import Budget
from .selection import cost_without
from .unknown import is_unnamed_gap, unknown_probability


def unnamed_probability(examined: Examined) -> float:
    """The probability of an effect outside the named ones; it rules out no named effect.

    It follows from the model error beside the named effects over its prior, from noise over its stated size, and from
    tolerances that deviate more than stated.
    """
    if examined.unnamed is None:
        return _without_forces(examined)
    unnamed = examined.unnamed
    loud = max(unnamed.noise.values(), default=1.0) if examined.noise_stated else 1.0
    odds = [
        CAL.unnamed_slope * log(max(unnamed.over_usual, TINY) / CAL.unnamed_share),
        CAL.unnamed_noise_slope * log(loud / CAL.unnamed_noise),
    ]
    if unnamed.strain > 0:
        odds.append(CAL.mimic_slope * log(unnamed.strain / CAL.unnamed_strain))
    return float(1 - np.prod([1 / (1 + exp(min(x, 30.0))) for x in odds]))


def _without_forces(examined: Examined) -> float:
    """The same for models without unknown forces: from the errors of free runs, and how these follow the drive."""
    scattered = any(present > CAL.present for _, present in examined.scatter.values())
    stated = examined.inexact and not examined.bench.learnt  # errors that training left follow the drive anyway
    nameless = is_unnamed_gap(examined.signs, examined.evidence.temper, stated, examined.noise_stated)
    if not examined.best.candidates and not scattered and not nameless:
        return CAL.nothing_unknown
    p = unknown_probability(examined.signs, examined.noise_stated)
    return p if examined.best.candidates or scattered else max(p, CAL.nameless)


def refused(examined: Examined, names: Collection[str], shared: Budget | None) -> dict[str, str]:
    """Effects of the best explanation that are not called causes, and why, by name.

    Parameters
    ----------
    names : effects that are judged.
    shared : their budget; None where it says nothing: shares of next to no gap, which tolerances may close by chance.
    """
    best, reasons, varying, limit = examined.best, dict[str, str](), examined.varying, may_vary(examined)
    for name in best.names:
        if name not in names:
            continue
        share = weak(shared, name) if shared is not None else None
        sure = of_class(examined, name)
        spread = varying.get(name)
        if not examined.stands:
            reasons[name] = "with it, free runs still spin where the vehicle did not"
        elif spread is not None and spread.relative > limit:
            reasons[name] = (
                f"it may only imitate another cause: its estimate differs by {100 * min(spread.relative, 2.0):.0f} % "
                f"{spread.place}, and that of a true cause does not"
            )
        elif _beside_unknown(examined, best, name) > CAL.present:
            reasons[name] = (
                "it may only imitate another cause: it raises the log-likelihood by "
                f"{number(gain_of(examined, best, name), 2)}, but the error left in the channels on which it acts "
                f"still varies with the drive (log-likelihood {number(examined.driving_gains[name], 2)})"
            )
        elif examined.unnamed is not None and _strains(examined, best, name) > CAL.present:
            reasons[name] = (
                "it may only imitate another cause: it needs parameters beyond their stated tolerances (chi-square "
                f"{examined.unnamed.tolerances:.0f}; {examined.unnamed.expected:.0f} is usual) and explains little "
                "more than these parameters do"
            )
        elif sure <= CAL.present:
            alike = alike_of(examined, name, CAL.alike)
            beside = f"; {listed(alike)} would explain the recording equally well" if alike else ""
            reasons[name] = f"its probability is {sure:.2f}, not more than one half{beside}"
        elif name in best.at_bounds:
            reasons[name] = "it is at its bound: a symptom of another cause, not an estimate"
        elif shared is not None and share is not None:
            judged = "on the held-out recordings" if shared.held_out else "in free run"
            reasons[name] = (
                f"small: {judged} it removes {whole_percent(share.share)} % "
                f"[{whole_percent(share.low)}, {whole_percent(share.high)}] of the excess error"
            )
        else:  # several doubts, each of them below one half
            p = (1.0 - CAL.nothing_unknown) * sure * genuine(examined, best, name, spread) * closes(shared, name)
            if p <= CAL.present:
                reasons[name] = f"its probability is {p:.2f}, not more than one half"
    return reasons


def closes_too_little(shared: Budget, exact: bool) -> str:
    """Why no effect is a cause, where all of them together leave nearly all of the gap; "" otherwise.

    Model error looks like several effects at once, each of which closes a little beside the others. Where equations are
    exact, recordings on which the effects were chosen show that, too: causes close a gap there.
    """
    closed = 1.0 - shared.unnamed.share
    least = CAL.shows if shared.held_out else CAL.least_share if exact else -np.inf
    if not (shared.shows and closed < least):
        return ""
    judged = "on the held-out recordings" if shared.held_out else "in free run"
    return f"small: {judged} all named effects together remove {whole_percent(closed)} % of the excess error"


def insignificant(examined: Examined, sizes: KnownSizes, level: float) -> tuple[dict[str, str], dict[str, float]]:
    """Effects of the best explanation whose sizes may be none, and why; and for the others, how likely chance is.

    One that is not there is among the others with a probability of at most `level` (Holm, Scandinavian Journal of
    Statistics 6, 1979): each must be as far from none as the largest of all offered effects rarely is, less those that
    are surer. A mimic of model-form errors has gained as much as causes do, but its size is undetermined once these
    errors are counted. Insignificant effects leave, the others move to their values without them, and must be
    significant there, too: one that is so only once another has left stands for that one.

    Limits, lags and plays may have no slope at none, and effects with second parameters act otherwise near none: for
    these, the root of twice the likelihood ratio is the distance from none in standard deviations, too (Wilks, Annals
    of Mathematical Statistics 9, 1938), divided by the widening where residuals are no noise (Kent, Biometrika 69,
    1982).

    Parameters
    ----------
    sizes : how well the best explanation's sizes are known.
    level : probability that an effect is significant that is not there.

    Returns
    -------
    reasons : effect -> why it is no cause.
    chances : of each other effect, the least level at which it would be significant.
    """
    best, reasons = examined.best, dict[str, str]()
    offered = len(examined.prepared.effects)
    mains = [at.start for _, at in best.parts]
    V, off, names = sizes.covariance[np.ix_(mains, mains)], best.m[mains], list(best.names)
    off = off - np.array([candidate.axes[0].null for candidate in best.candidates])
    by_gain = {
        item.effect: np.sqrt(2.0 * gain_of(examined, best, item.effect)) / sizes.widening[at]
        for item, at in zip(best.candidates, mains, strict=True)
        if item.free > 1 or item.axes[0].shift or not item.gradual
    }
    while names:
        slopes = np.abs(off) / np.sqrt(np.maximum(np.diag(V), TINY**2))
        z = np.array([max(by_gain.get(name, 0.0), slope) for name, slope in zip(names, slopes, strict=True)])
        least = _least_levels(z, offered)
        weak = {name: each for name, each, by in zip(names, z.tolist(), least, strict=True) if by > level}
        if not weak:
            return reasons, dict(zip(names, least.tolist(), strict=True))
        surely = -float(ndtri(0.5 * level / max(offered - len(names) + len(weak), 1)))
        for name, each in weak.items():
            reasons[name] = (
                f"it may be chance: its magnitude is {number(each, 2)} standard deviations from no effect, and of "
                f"{offered} absent effects one reaches {number(surely, 2)} too often by chance"
            )
            k = names.index(name)
            rest = np.arange(len(names)) != k
            by = V[rest, k] / V[k, k]
            off, V = off[rest] - by * off[k], V[np.ix_(rest, rest)] - np.outer(by, V[k, rest])
            names.pop(k)
    return reasons, {}


def _least_levels(z: Array, offered: int) -> Array:
    """(effects,) least level at which effects so many sds from none are significant, by Holm's procedure."""
    order = np.argsort(-z)
    levels = 2.0 * ndtr(-z[order]) * np.maximum(offered - np.arange(len(z)), 1)
    result = np.empty(len(z))
    result[order] = np.maximum.accumulate(levels)
    return np.minimum(result, 1.0)


def size_sd(examined: Examined, hypothesis: Hypothesis, name: str) -> float:
    """Standard deviation of an effect's coordinate in a hypothesis."""
    _, at = hypothesis.main(name)
    return float(np.sqrt(max(0.0, known_sizes(examined, hypothesis).covariance[at, at])))


@dataclass(frozen=True)
class KnownSizes:
    """How well a hypothesis' sizes are known.

    Attributes
    ----------
    covariance : (m, m) of its coordinates; where equations are inexact, with model-form errors.
    widening : (m,) factors by which coordinates scatter more than if residuals were noise.
    """

    covariance: Array
    widening: Array


def known_sizes(examined: Examined, hypothesis: Hypothesis) -> KnownSizes:
    """How well a hypothesis' sizes are known.

    Errors of inexact equations last, while innovations take them for new every correlation time. What they do to sizes
    is seen from how much sizes differ between blocks and between parts of a drive, and as far as they are alike in all
    parts, from what the best explanation leaves of free runs: standard deviations grow with the root mean square of
    these errors over noise (Birge, Physical Review 40, 1932). They do not widen what tolerances leave open.
    """
    search = examined.selection.search
    by_readings, by_tolerances = search.scatter(hypothesis)
    form = np.zeros(len(hypothesis.m))
    if examined.inexact:
        left = examined.closed.after if examined.unnamed is not None else 1.0
        by_readings = by_readings * CAL.wider**2 * max(left, 1.0)
        form = CAL.form_of_size * (hypothesis.m - np.array([axis.null for axis in hypothesis.axes]))
    covariance, noise = by_readings + by_tolerances, np.diag(search.covariance(hypothesis))
    widening = np.sqrt(np.diag(covariance) / np.maximum(noise, TINY**2))
    return KnownSizes(covariance + np.diag(form**2), widening)


def misnamed_probability(examined: Examined) -> float:
    """The probability that an effect of the best explanation is present and is not the cause that it is named after."""
    varying, tried = examined.varying, examined.selection.tried
    others = [
        probability(examined.evidence, tried, name) * (1.0 - genuine(examined, examined.best, name, varying.get(name)))
        for name in examined.best.names
    ]
    return float(1.0 - np.prod([1.0 - other for other in others]))


def genuine(examined: Examined, hypothesis: Hypothesis, name: str, spread: Spread | None) -> float:
    """The probability that an effect is the cause of what it explains.

    Such an effect has one size everywhere, does not strain tolerances, and leaves nothing unknown where it acts.
    """
    stands = 1.0 if examined.stands else 1.0 - CAL.present
    other = max(_strains(examined, hypothesis, name), _beside_unknown(examined, hypothesis, name))
    return stands * _constant(spread, may_vary(examined)) * (1.0 - other)


def may_vary(examined: Examined) -> float:
    """By how much an effect's size may differ between parts of a drive, relative.

    More where equations are inexact, for their errors move sizes, too. Where they are exact only something unnamed
    does: less, the likelier that is.
    """
    if examined.inexact:
        return CAL.varies_inexact
    if examined.unnamed is None:
        return CAL.varies
    return CAL.varies + unnamed_probability(examined) * (CAL.varies_beside_unknown - CAL.varies)


def _strains(examined: Examined, hypothesis: Hypothesis, name: str) -> float:
    """The probability that an effect stands for an unnamed one, judged by tolerances that the latter strains."""
    if examined.unnamed is None:
        return 0.0
    strain = examined.unnamed.strain * examined.strained_shares.get(name, 1.0)
    return _mimics(gain_of(examined, hypothesis, name), CAL.mimic * strain)


def _beside_unknown(examined: Examined, hypothesis: Hypothesis, name: str) -> float:
    """The probability that an effect stands for an unnamed one, judged by the error that remains where it acts.

    Only where equations are exact: inexact ones leave as much beside true causes.
    """
    if examined.unnamed is None or examined.inexact:
        return 0.0
    return _mimics(gain_of(examined, hypothesis, name), CAL.mimic * examined.driving_gains.get(name, 0.0))


def _mimics(gain: float, least: float) -> float:
    """The probability that an effect with this gain is a mimic: one half where it gains just what it must (`least`)."""
    if least <= 0.0:
        return 0.0
    x = CAL.mimic_slope * log(least / max(gain, TINY))
    return float(1 / (1 + exp(-max(min(x, 30.0), -30.0))))


def gain_of(examined: Examined, hypothesis: Hypothesis, name: str) -> float:
    """Log-likelihood that an effect gains beside the others of a hypothesis; at most what is known without it."""
    return max(cost_without(examined.selection, hypothesis, name) - hypothesis.cost, 0.0)


def of_class(examined: Examined, name: str) -> float:
    """The probability that an effect is present, or one that these recordings cannot distinguish from it."""
    return probability(examined.evidence, examined.selection.tried, name, *alike_of(examined, name, CAL.alike))


def alike_of(examined: Examined, name: str, within: float) -> tuple[str, ...]:
    """Effects that explain as much in this one's place, to within `within` of log-likelihood."""
    tried, scores = examined.selection.tried, examined.evidence.scores
    holding = [k for k, item in enumerate(tried) if name in item.names]
    k = max(holding, key=lambda j: scores[j])
    others = set(tried[k].names) - {name}
    alike = []
    for j, item in enumerate(tried):
        new = set(item.names) - others
        if j != k and len(item.names) == len(tried[k].names) and others < set(item.names) | {""} and len(new) == 1:
            (other,) = new
            if other != name and abs(scores[j] - scores[k]) < within and scores[k] > 0:
                alike.append(other)
    return tuple(dict.fromkeys(alike))


def _constant(spread: Spread | None, limit: float) -> float:
    """The probability that a magnitude with this spread between parts of a recording is a cause's."""
    if spread is None:
        return 1.0
    x = (spread.relative - limit) / CAL.varies_width
    return float(1 / (1 + exp(min(x, 30.0))))


def restricted_to(examined: Examined, names: Collection[str]) -> Hypothesis:
    """The best explanation with only these of its effects, everything else refitted."""
    selection, best = examined.selection, examined.best
    if not set(names) & set(best.names):
        return selection.base
    if set(best.names) <= set(names):
        return best
    # of those tried, explanations without one effect have costs alone: their coordinates are those beside it
    rest = best.only(names)
    return _with_only(examined, [rest.names]).get(frozenset(rest.names), rest)


def _with_only(
    examined: Examined, sets: Sequence[Collection[str]], *near: Hypothesis
) -> dict[frozenset[str], Hypothesis]:
    """The best explanation with only some of its effects, refitted, for several sets of these; none that overflow.

    Where a car nearly spins, nuisances beside all effects may be far from those beside some. Refits therefore begin
    there, where nuisances are without any effect, at the prior means, and at the `near` hypotheses, if there are any.
    """
    search, base = examined.selection.search, examined.selection.base
    means = search.at_means()
    starts = list[Start]()
    for names in sets:
        there = examined.best.only(names)
        starts += [Start(there.candidates, there.m, each.theta, each.linear) for each in (there, base, means)]
        starts += [search.start_of(each.only(names)) for each in near]
    result = dict[frozenset[str], Hypothesis]()
    for item in sorted(refit(search, starts), key=by_cost):
        result.setdefault(frozenset(item.names), item)
    return result


def superfluous(examined: Examined, best: Hypothesis) -> tuple[Hypothesis, dict[str, str]]:
    """Causes that are still needed once effects have left the best explanation, and why the others are not.

    A limit may only take back what a gain beside it does, which is no cause: each cause must gain its cost beside the
    others that remain, with everything refitted. The least needed one leaves first.

    Parameters
    ----------
    best : the best explanation with some of its effects, refitted.
    """
    search, reasons = examined.selection.search, dict[str, str]()
    needed = costs(examined.unnamed is not None, [item.candidate for item in examined.selection.expected_gains])
    while best.names and set(best.names) != set(examined.best.names):
        rest = _with_only(examined, [set(best.names) - {name} for name in best.names], best)
        gains = {
            name: (without.cost - best.cost) / search.trust
            for name in best.names
            if (without := rest.get(frozenset(best.names) - {name})) is not None
        }
        least = min(gains, key=lambda name: gains[name] - needed(name), default=None)
        if least is None or gains[least] >= needed(least):
            break
        if gains[least] < 0.0 and (better := _from_fewer(examined, best, rest[frozenset(best.names) - {least}])):
            best = better
            continue
        left = listed([name for name in examined.best.names if name not in best.names])
        little = f"it raises the log-likelihood by {number(gains[least], 2)}, and {number(needed(least), 2)} is needed"
        reasons[least] = f"without {left}, {little if gains[least] > 0.0 else 'it explains nothing'}"
        best = rest[frozenset(best.names) - {least}]
    return best, reasons


def _from_fewer(examined: Examined, best: Hypothesis, fewer: Hypothesis) -> Hypothesis | None:
    """Some of the best explanation's effects, refitted from where fewer of them cost less; None if not better.

    A refit with more effects that ends at a higher cost has not found its optimum. The others begin at their magnitudes
    in the best explanation, or at none.
    """
    before = examined.best.only(set(best.names))
    at_none, known = before.m.copy(), {item.effect: fewer.m[at] for item, at in fewer.parts}
    for item, at in before.parts:
        at_none[at] = known.get(item.effect, before.m[at])
        if item.effect not in known:
            at_none[at.start] = item.axes[0].null
    starts = [Start(before.candidates, m, fewer.theta, fewer.linear) for m in (before.m, at_none)]
    result = min(refit(examined.selection.search, starts), key=by_cost, default=best)
    return result if result.cost < best.cost - CAL.enough else None
