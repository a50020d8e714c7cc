"""The verb `diagnose`: from recordings and a model to a `Gap`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import exp, log

import numpy as np
from scipy.special import ndtr
from threadpoolctl import threadpool_limits

from ..base.errors import BadInput
from ..base.numbers import number, pretty_unit, whole_percent
from ..base.statistics import NORMAL
from ..datasets.checks import Severity, check
from ..datasets.checks.finding import listed
from ..datasets.recording import Recording
from ..engine.simulation import Diagnosed
from ..fitting.scores.horizons import by_horizon
from ..models.effect import Effect
from ..models.vehicle import Vehicle
from .advice import advice, limits, not_excited, unread
from .budget import budget, subsets
from .closed_model import closed_model, moved, place_of, with_effects
from .closing import left_open
from .estimation.axes import ActingRows, scalars
from .estimation.calibration import CAL
from .estimation.constancy import Spread
from .estimation.free_runs import at_their_best, freed_tolerances, misfit, of_subsets, plain, refitted_tolerances
from .estimation.hypothesis import Hypothesis
from .estimation.noise import white_noise
from .estimation.observer import PULLED
from .estimation.preparing import excerpt
from .estimation.search import Search
from .estimation.strip import strip
from .estimation.variance import fresh
from .estimation.wandering import Wander
from .evidence import by_chance, p_value, probability
from .examining import TINY, Examined, examine
from .gap import Budget, CauseClass, Gap, Ranked, Share
from .regimes import where
from .selection import refitted
from .unknown import unknown_probability, without_a_name

DIFFERS = "its estimate differs between parts of the drive, which suggests that the equations have the wrong form"
OF_READINGS = "it only adds noise to readings: there is nothing to add to a simulation"


def diagnose(
    model: Diagnosed,
    recordings: Sequence[Recording],
    effects: Mapping[str, Effect],
    *,
    vehicle: Vehicle | None = None,
    held_out: Sequence[Recording] = (),
    say: Callable[..., None] | None = None,
    seed: int = 0,
    horizons: bool = False,
) -> Gap:
    """Say where a simulation deviates from a vehicle, which effect causes it, and how far the gap shrinks with it.

    Parameters
    ----------
    model : the simulation, at its nominal values.
    recordings : of the vehicle.
    effects : what the model may lack, by name.
    vehicle : what is stated: tolerances, which are refitted and charged for, and sensor noise. A number stated without
        an sd is exact.
    held_out : recordings that choose nothing, on which the closure is verified.
    say : told of progress.
    horizons : whether errors over fixed horizons are wanted on the diagnosed recordings too; on those held out they are
        always there.
    seed : kept for the record; nothing here is drawn that a result depends on.

    Raises
    ------
    BadInput : a recording lacks what the model reads, or no effect acts on the model.
    """
    del seed
    tell = say or (lambda line, **_: None)
    with threadpool_limits(1):  # matrices are tall and thin: further threads only wait for each other
        result = examine(model, recordings, effects, vehicle, tell)
        gap = answer(result, held_out, tell)
        if not horizons or gap.closed is None:
            return gap
        errors = by_horizon(model, gap.closed, recordings, result.sd)
        return replace(gap, gap=replace(gap.gap, errors=errors))


def answer(it: Examined, held_out: Sequence[Recording], tell: Callable[..., None]) -> Gap:
    """What a diagnosis says of what it found."""
    selection = it.selection
    scattered = [name for name, (_, present) in it.scatter.items() if present > CAL.present]
    unknown = 1.0 - (1.0 - something_unnamed(it)) * (1.0 - by_no_name(it))
    detected = bool(it.best.candidates) or bool(scattered) or unknown > CAL.present
    best, reasons, shared, telling = it.best, dict[str, str](), None, None
    while best.candidates:
        shared = _budget(it, best, held_out, tell)
        telling = shared if shared is not None and shared.shows and shared.held_out else None
        refused = _refused(it, best, telling)
        closes = {
            name: by.share for name in refused if telling is not None and (by := _weak(telling, name)) is not None
        }
        if len(closes) > 1:  # the least of them leaves first: it may hide what the others close
            least = min(closes, key=lambda name: closes[name])
            refused = {name: why for name, why in refused.items() if name not in closes or name == least}
        reasons |= refused
        best = _only(it, set(best.names) - set(refused))
        if len(closes) < 2:
            break
    if telling is not None and telling.unnamed.low > CAL.present:  # more than half is surely no named effect's
        unknown = max(unknown, CAL.nameless)
    if held_out:
        tell(f"verifying on {listed([item.name for item in held_out])}, held out")
    closed, verified, worse = closed_model(it, best, detected, held_out)
    while worse:
        weakest = min(best.names, key=partial(_gain, it, it.best))
        reasons[weakest] = worse
        best = _only(it, set(best.names) - {weakest})
        closed, verified, worse = closed_model(it, best, detected, held_out)
    ranking, applied = _ranking(it, reasons, telling), tuple(best.names)
    if (
        shared is not None
        and not shared.shows
        and any(share.effect in applied and share.low <= 0 for share in shared.shares)
    ):
        shared = None  # shares of next to nothing, beside names that are surely there
    like = it.resembles() if unknown > CAL.present else ()
    excess = np.sum(np.where(it.good, (selection.base.e / it.sd) ** 2 - (best.e / it.sd) ** 2, 0.0), axis=1)
    if not applied:
        excess = np.sum(np.where(it.good, (selection.base.e / it.sd) ** 2 - 1, 0.0), axis=1)
    ratio = np.array([
        np.sqrt(np.mean((selection.base.e[one, c] / it.sd[c]) ** 2)) if np.any(one := it.good[:, c]) else np.nan
        for c in range(len(it.sd))
    ])  # fmt: skip
    place = where(it.bench, excess, ratio, it.seen, selection.promised, it.effects)
    weak, absorbed = not_excited(it)
    sets = [(item.effect, *item.indistinguishable_from) for item in ranking[:2] if item.indistinguishable_from]
    counted = np.where(it.good, 1.0, 0.0)
    return Gap(
        model=it.model.name,
        recordings=tuple(recording.name for recording in it.recordings),
        doubts=tuple(
            f"{recording.name}: {finding.sentence}"
            for recording in it.recordings
            for finding in check(recording)
            if finding.severity is Severity.DISTRUST
        ),
        gap_detected=detected,
        p_value=_p_value(it, unknown > CAL.present),
        unknown_probability=unknown,
        unknown=_shape(it, place.channel, like) if unknown > CAL.present else "",
        where=place if detected else replace(place, channel="", regime="any"),
        ranking=tuple(ranking),
        applied=applied,
        gap=it.closed if applied or not it.best.candidates else left_open(it.closed),
        held_out=verified,
        not_excited=weak,
        absorbed=absorbed,
        advice=advice(sets, list(weak), it.effects, unread(it)),
        closed=closed,
        strip=strip(
            it.bench,
            selection.base.e * counted,
            best.e * counted,
            it.sd,
            it.seen,
            excess,
            excerpt(it.recordings),
        ),
        noise_stated=it.told,
        limits=limits(it),
        budget=shared,
        unnamed=it.unnamed,
        resembles=like,
        moved=moved(it, best, closed),
        tried={item.candidate.effect: item.gain for item in selection.promised},
        held=_held(it),
        classes=_classes(it, ranking, applied),
    )


def _held(examined: Examined) -> str:
    """How simulations were kept from spinning, if free runs of the model do whatever it is given."""
    name = PULLED.format("yaw_rate")
    names = [parameter.name for parameter in examined.bench.model.parameters]
    if name not in names or not (rate := examined.selection.search.nominal[names.index(name)]) > 0:
        return ""
    return (
        "Free runs spin here, with and without effects. An observer therefore pulls yaw_rate to its reading within "
        f"{number(1 / rate, 2)} s; errors are those of predictions about that far ahead"
    )


def something_unnamed(examined: Examined) -> float:
    """The probability that something outside the named effects is at work; it silences no name.

    Told by the model error that is left beside them, over what is believed of it, by noise over what is stated, and by
    tolerances that are further off than they are stated to be.
    """
    if examined.unnamed is None:
        return _without_forces(examined)
    value, usual = examined.unnamed, examined.expected.median
    share = max(value.share_y / usual.share_y, value.share_x / usual.share_x)
    loud = max(value.noise.values(), default=1.0) if examined.told else 1.0
    odds = [
        CAL.unnamed_slope * log(share / CAL.unnamed_share),
        CAL.unnamed_noise_slope * log(loud / CAL.unnamed_noise),
    ]
    if value.strain > 0:
        odds.append(CAL.mimic_slope * log(value.strain / CAL.unnamed_strain))
    return float(1 - np.prod([1 / (1 + exp(min(x, 30.0))) for x in odds]))


def _without_forces(examined: Examined) -> float:
    """The same of models that know no forces: told by what is left of free runs, and how that follows driving."""
    scattered = any(present > CAL.present for _, present in examined.scatter.values())
    stated = examined.rough and not examined.bench.learnt  # what training left follows driving anyway
    nameless = without_a_name(examined.signs, examined.evidence.temper, stated, examined.told)
    if not examined.best.candidates and not scattered and not nameless:
        return CAL.nothing_unknown
    p = unknown_probability(examined.signs, examined.told)
    return p if examined.best.candidates or scattered else max(p, CAL.nameless)


def _budget(
    examined: Examined, best: Hypothesis, held_out: Sequence[Recording], tell: Callable[..., None]
) -> Budget | None:
    """Which share of the excess each effect of a hypothesis closes, on what was held out if there is any."""
    names = best.names
    if len(names) > CAL.few:
        return _budget_of_many(examined, best, held_out, tell)
    if held_out:
        tell(f"attributing the gap to {listed(names)} on {listed([item.name for item in held_out])}, held out")
        full = with_effects(examined, best)
        there = examined.selection.search.values(best)
        whole, bench = refitted_tolerances(full, held_out, examined.vehicle, examined.effects, examined.sd, there)
        misfits = {frozenset(names): whole}
        for subset in subsets(names)[:-1]:
            model = with_effects(examined, best, subset)
            try:
                misfits[subset], _ = refitted_tolerances(
                    model, held_out, examined.vehicle, examined.effects, examined.sd, whole.values, whole.trust
                )
            except BadInput:  # some effects without the others may leave the range of numbers
                if not subset:
                    raise
                misfits[subset] = misfits[frozenset()]
        good = plain(misfits[frozenset(names)].e, fresh(bench), bench)
        return budget(misfits, names, examined.sd, good, bench, tuple(item.name for item in held_out), True)
    search = examined.selection.search
    known = {frozenset(item.names): item for item in examined.selection.tried}
    more = [subset for subset in subsets(names) if subset not in examined.freed]
    parts = [known.get(item) or refitted(search, best.only(item)) for item in more]
    free = dict(zip(more, at_their_best(search, parts, examined.sd, examined.good), strict=True))
    misfits = {subset: misfit(search, {**free, **examined.freed}[subset]) for subset in subsets(names)}
    good = plain(misfits[frozenset(names)].e, examined.good, examined.bench)
    return budget(
        misfits,
        names,
        examined.sd,
        good,
        examined.bench,
        tuple(recording.name for recording in examined.recordings),
        False,
    )


def _budget_of_many(
    examined: Examined, best: Hypothesis, held_out: Sequence[Recording], tell: Callable[..., None]
) -> Budget | None:
    """The same of many effects: what each does adds up, to first order, in sets that are neither none nor all."""
    names = best.names
    search = examined.selection.search
    if held_out:
        tell(f"attributing the gap to {listed(names)} on {listed([item.name for item in held_out])}, held out")
        full = with_effects(examined, best)
        there = search.values(best)
        whole, search, result = freed_tolerances(full, held_out, examined.vehicle, examined.effects, examined.sd, there)
        search.about(result)
        nothing, _ = refitted_tolerances(
            with_effects(examined, best, set()),
            held_out,
            examined.vehicle,
            examined.effects,
            examined.sd,
            whole.values,
            whole.trust,
        )
        known = {frozenset(names): whole, frozenset[str](): nothing}
        misfits = of_subsets(search, result, _absent(examined, best, search), known)
        good = plain(whole.e, fresh(search.bench), search.bench)
        return budget(misfits, names, examined.sd, good, search.bench, tuple(one.name for one in held_out), True)
    known = {frozenset(item): misfit(search, examined.freed[item]) for item in (frozenset(names), frozenset[str]())}
    with search.elsewhere():
        if examined.unnamed is not None:
            search.recoloured(white_noise(examined.sd, examined.good, examined.bench.rows))
        result = examined.freed[frozenset(names)]
        search.about(result)
        misfits = of_subsets(search, result, _absent(examined, best, search), known)
    good = plain(known[frozenset(names)].e, examined.good, examined.bench)
    recordings = tuple(item.name for item in examined.recordings)
    return budget(misfits, names, examined.sd, good, examined.bench, recordings, False)


def _absent(examined: Examined, best: Hypothesis, search: Search) -> dict[str, dict[int, float]]:
    """Effect of the best hypothesis -> parameter that is elsewhere without it -> where."""
    same = search is examined.selection.search
    places = {parameter.name: index for index, parameter in scalars(search.bench.model)}
    mains = {each.effect: each.axes[0] for each in best.candidates}
    return {name: {axis.index if same else places[axis.name]: axis.value(axis.null)} for name, axis in mains.items()}


def _refused(one: Examined, some: Hypothesis, shared: Budget | None) -> dict[str, str]:
    """Effects of a hypothesis that are not called causes, and why, by name.

    Parameters
    ----------
    one : what was examined.
    some : the best hypothesis, or what is left of it.
    shared : what these close; None where that tells nothing: of next to no gap, which tolerances may close by chance.
    """
    best, reasons, varying = one.best, dict[str, str](), one.varying
    for candidate, at in best.parts:
        name, axis, m = candidate.effect, candidate.axes[0], best.m[at.start]
        if name not in some.names:
            continue
        share = _weak(shared, name) if shared is not None else None
        sure = _of_class(one, name)
        spread = varying.get(name)
        if not one.stands:
            reasons[name] = "with it, free runs still spin where the vehicle did not"
        elif spread is not None and spread.relative > CAL.varies:
            reasons[name] = (
                f"another effect may mimic it: its estimate differs by {100 * min(spread.relative, 2.0):.0f} % "
                f"{spread.place}, which the estimate of a true cause would not"
            )
        elif one.unnamed is not None and _mimics(one, best, name) > CAL.present:
            reasons[name] = (
                "another effect may mimic it: it needs parameters beyond their stated tolerances (chi-square "
                f"{one.unnamed.tolerances:.0f}; {one.unnamed.expected:.0f} is usual) and explains little more than "
                "they do"
            )
        elif sure <= CAL.present:
            alike = _alike(one, name, CAL.alike)
            beside = f"; {listed(alike)} would explain the recording as well" if alike else ""
            reasons[name] = f"its probability is {sure:.2f}, not more than one half{beside}"
        elif min(abs(m - axis.low), abs(m - axis.high)) < CAL.at_bound * axis.scale:
            reasons[name] = "it is at its bound: a symptom of another cause, not an estimate"
        elif shared is not None and share is not None:
            judged = "on the held-out recordings" if shared.held_out else "in free run"
            reasons[name] = (
                f"small: {judged} it closes {whole_percent(share.share)} % of the excess "
                f"[{whole_percent(share.low)}, {whole_percent(share.high)}]"
            )
        else:  # several doubts, each of them below one half
            entry = (1.0 - CAL.nothing_unknown) * sure * _itself(one, best, name, spread) * _closes(shared, name)
            if entry <= CAL.present:
                reasons[name] = f"its probability is {entry:.2f}, not more than one half"
    return reasons | _beside_mimics(one, some, reasons)


def _only(examined: Examined, names: Collection[str]) -> Hypothesis:
    """The best explanation with these of its effects alone, everything else refitted."""
    selection = examined.selection
    known = {frozenset(item.names): item for item in (*selection.tried, selection.base)}
    return known.get(frozenset(names)) or refitted(selection.search, examined.best.only(names))


def _beside_mimics(one: Examined, best: Hypothesis, reasons: Mapping[str, str]) -> dict[str, str]:
    """Why effects beside others whose sizes are refuted are no causes, by name, where equations are exact.

    These have an unknown cause to share among them: what more of it went to refuted names than to one may go to it too.
    """
    varies = [name for name, spread in one.varying.items() if spread.relative > CAL.varies and name in reasons]
    refuted = sum(_gain(one, best, name) for name in varies)
    if not refuted or one.rough:
        return {}
    beside = f"beside {listed(varies)}, whose {'size differs' if len(varies) == 1 else 'sizes differ'} between parts"
    return {
        name: f"another effect may mimic it: it explains less than the rest {beside}"
        for name in best.names
        if name not in reasons and _gain(one, best, name) < refuted
    }


def _gain(examined: Examined, hypothesis: Hypothesis, name: str) -> float:
    """Log-likelihood that an effect gains beside the others of a hypothesis."""
    base, others = examined.selection.base, set(hypothesis.names) - {name}
    without = [item.cost for item in examined.selection.tried if set(item.names) == others]
    return max(min([base.cost, *without]) - hypothesis.cost, 0.0)  # either may have been left on its way


def _mimics(examined: Examined, hypothesis: Hypothesis, name: str) -> float:
    """The probability that an effect stands for one without a name, which strains tolerances where it is none."""
    if examined.unnamed is None or examined.unnamed.strain == 0.0:
        return 0.0
    strain = examined.unnamed.strain * examined.of_strained.get(name, 1.0)
    x = CAL.mimic_slope * log(CAL.mimic * strain / max(_gain(examined, hypothesis, name), TINY))
    return float(1 / (1 + exp(-max(min(x, 30.0), -30.0))))


def by_no_name(examined: Examined) -> float:
    """The probability that an effect of the best explanation is there and is not what it is called."""
    varying, tried = examined.varying, examined.selection.tried
    others = [
        probability(examined.evidence, tried, name) * (1.0 - _itself(examined, examined.best, name, varying.get(name)))
        for name in examined.best.names
    ]
    return float(1.0 - np.prod([1.0 - other for other in others]))


def _itself(examined: Examined, hypothesis: Hypothesis, name: str, spread: Spread | None) -> float:
    """The probability that what an effect explains is its own: of one size everywhere, and no strain of tolerances."""
    stands = 1.0 if examined.stands else 1.0 - CAL.present
    return stands * _constant(spread) * (1.0 - _mimics(examined, hypothesis, name))


def _of_class(examined: Examined, name: str) -> float:
    """The probability that an effect is there, or one that these recordings cannot tell from it."""
    return probability(examined.evidence, examined.selection.tried, name, *_alike(examined, name, CAL.alike))


def _classes(examined: Examined, ranking: Sequence[Ranked], applied: Sequence[str]) -> tuple[CauseClass, ...]:
    """Of every effect of the best explanation, what acts as it does."""
    classes, known = [], 1.0 - CAL.nothing_unknown
    tried = examined.selection.tried
    for name in examined.best.names:
        if not any(item.effect == name for item in ranking):
            continue
        members = (name, *_alike(examined, name, CAL.alike))
        alone = {member: probability(examined.evidence, tried, member) for member in members}
        whole = known * _of_class(examined, name)
        total = sum(alone.values()) or 1.0
        each = {member: whole * p / total for member, p in sorted(alone.items(), key=lambda item: -item[1])}
        each = {member: p for member, p in each.items() if p >= CAL.told_probability or member == name}
        classes.append(CauseClass(tuple(each), whole, each, name if name in applied else ""))
    return tuple(sorted(classes, key=lambda item: -item.probability))


def _ranking(examined: Examined, reasons: Mapping[str, str], shared: Budget | None) -> list[Ranked]:
    """Effects by their probability.

    Parameters
    ----------
    examined : what was examined.
    reasons : why effects of the best hypothesis are not applied, by name.
    shared : what these close.
    """
    known, varying = 1.0 - CAL.nothing_unknown, examined.varying
    selection, weighed = examined.selection, examined.evidence
    tried = selection.tried
    names = list(dict.fromkeys(name for item in tried for name in item.names))
    ranked = []
    for name in names:
        holding = [k for k, item in enumerate(tried) if name in item.names]
        most = tried[max(holding, key=lambda k: weighed.scores[k])]
        magnitude, interval = _magnitude(examined, most, name)
        part = next(candidate.part for candidate in most.candidates if candidate.effect == name)
        by = 1.0 if name in examined.best.names else weighed.outdone.get(name, 1.0)
        p = known * probability(weighed, tried, name) * _itself(examined, most, name, varying.get(name))
        p *= _closes(shared, name)
        ranked.append(
            Ranked(
                name,
                min(p, 1.0 - CAL.present) if name in reasons else p,
                magnitude,
                most.main(name)[0].unit,
                interval,
                _alike(examined, name, CAL.alike),
                _gain(examined, most, name),
                reasons.get(name, DIFFERS if by > 1.0 else ""),
                *((None, None, "") if part is None else (part.since, part.until, _place(examined, part))),
                _others(examined, most, name),
            )
        )
    for name, (item, present) in examined.scatter.items():
        unit = examined.effects[name].parameter.unit if name in examined.effects else "1"
        span = (max(item.magnitude - 1.96 * item.sd, 0.0), item.magnitude + 1.96 * item.sd)
        gain = selection.search.trust * item.gain
        reason = OF_READINGS if present > CAL.present else ""
        ranked.append(Ranked(name, known * present, item.magnitude, unit, span, (), gain, reason))
    of_set = _of_sets(examined, ranked, known)
    even = replace(weighed, weights=weighed.even)
    nearest = {name: float(f"{probability(even, tried, name):.6g}") for name in names}

    def order(ranked: Ranked) -> tuple[float, float, float]:
        p = of_set[ranked.effect] / known
        return -float(f"{p:.6g}") if p >= CAL.told_probability else 0.0, -nearest.get(ranked.effect, 0.0), -ranked.gain

    return sorted(ranked, key=order)[: CAL.ranked]


def _of_sets(examined: Examined, ranked: Sequence[Ranked], known: float) -> dict[str, float]:
    """What effects are ranked by: their probability; that of all that cannot be distinguished for the first of them.

    Two aliases share the weight of what is surely one of them: an effect beside them of which less is sure comes next.
    """
    rank, led = {item.effect: item.probability for item in ranked}, set[str]()
    for item in sorted(ranked, key=lambda each: (-each.probability, -each.gain)):
        mates = {item.effect, *item.indistinguishable_from}
        if len(mates) > 1 and not mates & led:
            rank[item.effect] = max(
                known * probability(examined.evidence, examined.selection.tried, *mates), item.probability
            )
        led |= mates
    return rank


def _p_value(examined: Examined, unexplained: bool) -> float:
    """How often a vehicle without a gap would look so: like the best hypothesis, an effect of variance, or as loud.

    Where equations are rough, by what such vehicles gained, from which costs are derived; else by noise alone.
    """
    many, temper, base = len(examined.effects), examined.evidence.temper, examined.selection.base
    tried = examined.selection.tried
    counts = temper / examined.selection.search.trust
    p = [p_value(counts * (base.cost - item.cost), len(item.axes), many ** len(item.candidates)) for item in tried]
    if examined.unnamed is not None and examined.rough:
        p = [max(item, by_chance(score)) for item, score in zip(p, examined.evidence.scores, strict=True)]
    p += [p_value(item.gain, 1, many) for item, present in examined.scatter.values() if present > CAL.present]
    if unexplained:
        p.append(float(len(examined.sd) * ndtr(-CAL.surely)))  # at most: the loudest channel is further off than that
    return min(p, default=1.0)


def _constant(spread: Spread | None) -> float:
    """The probability that a magnitude that differs so between parts of a recording is a cause's."""
    if spread is None:
        return 1.0
    x = (spread.relative - CAL.varies) / CAL.varies_width
    return float(1 / (1 + exp(min(x, 30.0))))


def _closes(shared: Budget | None, name: str) -> float:
    """The probability that an effect closes as much as a cause does; one for those of which no share is known."""
    if shared is None or (value := shared.judged(name)) is None:
        return 1.0
    sd = max((value.high - value.low) / (2 * NORMAL), CAL.least_share / 10)
    return float(ndtr((value.share - _least_share(shared)) / sd))


def _weak(shared: Budget, name: str) -> Share | None:
    """What an effect closes, if a cause closes more."""
    share = shared.judged(name)
    return share if share is not None and share.share < _least_share(shared) else None


def _least_share(shared: Budget) -> float:
    """The share from which on an effect is a cause: on the recordings that chose it, any that is surely there."""
    return CAL.least_share if shared.held_out else 0.0


def _magnitude(examined: Examined, hypothesis: Hypothesis, name: str) -> tuple[float, tuple[float, float]]:
    """Magnitude of one effect in a hypothesis, with its 95 % interval."""
    (axis, at), search = hypothesis.main(name), examined.selection.search
    sd = float(np.sqrt(max(search.covariance(hypothesis)[at, at], 0.0)) * search.widening(hypothesis)[at])
    if examined.rough:
        sd = float(np.hypot(CAL.wider * sd, CAL.form_of_size * (hypothesis.m[at] - axis.null)))
    half = 1.96 * sd
    ends = [axis.value(float(np.clip(hypothesis.m[at] + side * half, axis.low, axis.high))) for side in (-1, 1)]
    return axis.value(float(hypothesis.m[at])), (min(ends), max(ends))


def _others(examined: Examined, hypothesis: Hypothesis, name: str) -> dict[str, float]:
    """Second parameters of one effect in a hypothesis that are elsewhere than usual."""
    candidate, at = next(part for part in hypothesis.parts if part[0].effect == name)
    usual = {other.name: float(other.array) for other in examined.effects[name].others}
    entry = {axis.name: axis.value(float(m)) for axis, m in zip(candidate.axes[1:], hypothesis.m[at][1:], strict=True)}
    return {parameter: value for parameter, value in entry.items() if value != usual[parameter]}


def _place(examined: Examined, part: ActingRows) -> str:
    """The name of the recording in which an effect begins or ends, and of its run where it has several."""
    k, run, _ = place_of(examined, part)
    return f"{part.recording}, run {run + 1}" if len(examined.recordings[k].runs) > 1 else part.recording


def _alike(examined: Examined, name: str, within: float) -> tuple[str, ...]:
    """Effects that explain as much in this one's place, within so much log-likelihood."""
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


def _shape(examined: Examined, channel: str, like: Sequence[Wander]) -> str:
    """What is unknown in a sentence.

    Parameters
    ----------
    channel : where it shows most.
    like : effects that it looks like.
    """
    value, names, left = examined.signs, examined.best.names, examined.unnamed
    parts = [f"most in {channel}"] if channel else []
    if like:
        first, *others = like
        unit = "" if first.unit == "1" else f" {pretty_unit(first.unit)}"
        parts.append(
            f"like {first.effect} that varies by ± {number(first.sd, 2)}{unit} "
            f"within {number(first.correlation_time, 2)} s"
            + (f", or {' or '.join(each.effect for each in others)}" if others else "")
        )
    if left is not None:
        lateral, longitudinal = (100 * v for v in (left.share_y, left.share_x))
        parts.append(
            f"unknown forces of {number(lateral, 2)} % of the lateral and {number(longitudinal, 2)} % of the "
            "longitudinal ones"
        )
    if names and value.spread > CAL.form_of_size:
        parts.append(f"{names[0]}, the nearest name, would differ by {100 * value.spread:.0f} % {value.place}")
    if value.left > CAL.form_of_size:
        on = listed([recording.name for recording in examined.recordings])
        parts.append(f"{100 * min(value.left, 1.0):.0f} % of the error beyond noise is left on {on}")
    return "; ".join(parts) or "its shape matches no effect that is known here"
