"""The verb `diagnose`: from recordings and a model to a `Gap`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import exp, log

import numpy as np
from scipy.special import ndtr
from threadpoolctl import threadpool_limits

from ..base.errors import BadInput
from ..base.numbers import pretty_unit
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
from .gap import Budget, CauseClass, Gap, Ranked
from .regimes import where
from .selection import refitted
from .unknown import unknown_probability, without_a_name

DIFFERS = "its magnitude differs between parts of the drive, as errors of the equations' form make it differ"
OF_READINGS = "it scatters readings: there is nothing that a simulation could add"


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
        found = examine(model, recordings, effects, vehicle, tell)
        said = answer(found, held_out, tell)
        if not horizons or said.closed is None:
            return said
        errors = by_horizon(model, said.closed, recordings, found.sd)
        return replace(said, gap=replace(said.gap, errors=errors))


def answer(found: Examined, held_out: Sequence[Recording], tell: Callable[..., None]) -> Gap:
    """What a diagnosis says of what it found."""
    selection = found.selection
    scattered = [name for name, (_, present) in found.scatter.items() if present > CAL.present]
    unknown = 1.0 - (1.0 - something_unnamed(found)) * (1.0 - by_no_name(found))
    detected = bool(found.best.candidates) or bool(scattered) or unknown > CAL.present
    shared = _budget(found, held_out, tell) if found.best.candidates else None
    telling = shared if shared is not None and shared.shows else None
    best, reasons = _causes(found, telling)
    if held_out:
        tell(f"verifying on {listed([own.name for own in held_out])}, held out")
    closed, verified, worse = closed_model(found, best, detected, held_out)
    if worse:
        reasons |= dict.fromkeys(best.names, worse)
        best = selection.base
    ranking, applied = _ranking(found, reasons, telling), tuple(best.names)
    if telling is None and shared is not None and any(own.effect in applied and own.low <= 0 for own in shared.shares):
        shared = None  # shares of next to nothing, beside names that are surely there
    like = found.resembles() if unknown > CAL.present else ()
    excess = np.sum(np.where(found.good, (selection.base.e / found.sd) ** 2 - (best.e / found.sd) ** 2, 0.0), axis=1)
    if not applied:
        excess = np.sum(np.where(found.good, (selection.base.e / found.sd) ** 2 - 1, 0.0), axis=1)
    ratio = np.array([
        np.sqrt(np.mean((selection.base.e[own, c] / found.sd[c]) ** 2)) if np.any(own := found.good[:, c]) else np.nan
        for c in range(len(found.sd))
    ])  # fmt: skip
    place = where(found.bench, excess, ratio, found.seen, selection.promised, found.effects)
    weak, absorbed = not_excited(found)
    sets = [(own.effect, *own.indistinguishable_from) for own in ranking[:2] if own.indistinguishable_from]
    counted = np.where(found.good, 1.0, 0.0)
    return Gap(
        model=found.model.name,
        recordings=tuple(own.name for own in found.recordings),
        doubts=tuple(
            f"{own.name}: {finding.sentence}"
            for own in found.recordings
            for finding in check(own)
            if finding.severity is Severity.DISTRUST
        ),
        gap_detected=detected,
        p_value=_p_value(found, unknown > CAL.present),
        unknown_probability=unknown,
        unknown=_shape(found, place.channel, like) if unknown > CAL.present else "",
        where=place if detected else replace(place, channel="", regime="any"),
        ranking=tuple(ranking),
        applied=applied,
        gap=found.closed if applied or not found.best.candidates else left_open(found.closed),
        held_out=verified,
        not_excited=weak,
        absorbed=absorbed,
        advice=advice(sets, list(weak), found.effects, unread(found)),
        closed=closed,
        strip=strip(
            found.bench,
            selection.base.e * counted,
            best.e * counted,
            found.sd,
            found.seen,
            excess,
            excerpt(found.recordings),
        ),
        noise_stated=found.told,
        limits=limits(found),
        budget=shared,
        unnamed=found.unnamed,
        resembles=like,
        moved=moved(found, best, closed),
        tried={own.candidate.effect: own.gain for own in selection.promised},
        held=_held(found),
        classes=_classes(found, ranking, applied),
    )


def _held(found: Examined) -> str:
    """How simulations were kept from spinning, if free runs of the model do whatever it is given."""
    name = PULLED.format("yaw_rate")
    names = [own.name for own in found.bench.model.parameters]
    if name not in names or not (rate := found.selection.search.nominal[names.index(name)]) > 0:
        return ""
    return (
        f"Free runs spin here, with and without an effect: they were restarted all the time, by an observer that pulls "
        f"yaw_rate to its reading within {1 / rate:.2g} s; errors are those of predictions about so far ahead"
    )


def something_unnamed(found: Examined) -> float:
    """The probability that something outside the named effects is at work; it silences no name.

    Told by the model error that is left beside them, over what is believed of it, by noise over what is stated, and by
    tolerances that are further off than they are stated to be.
    """
    if found.unnamed is None:
        return _without_forces(found)
    own, usual = found.unnamed, found.expected.median
    share = max(own.share_y / usual.share_y, own.share_x / usual.share_x)
    loud = max(own.noise.values(), default=1.0) if found.told else 1.0
    odds = [
        CAL.unnamed_slope * log(share / CAL.unnamed_share),
        CAL.unnamed_noise_slope * log(loud / CAL.unnamed_noise),
    ]
    if own.strain > 0:
        odds.append(CAL.mimic_slope * log(own.strain / CAL.unnamed_strain))
    return float(1 - np.prod([1 / (1 + exp(min(x, 30.0))) for x in odds]))


def _without_forces(found: Examined) -> float:
    """The same of models that know no forces: told by what is left of free runs, and how that follows driving."""
    scattered = any(present > CAL.present for _, present in found.scatter.values())
    stated = found.rough and not found.bench.learnt  # what training left follows driving anyway
    nameless = without_a_name(found.signs, found.evidence.temper, stated, found.told)
    if not found.best.candidates and not scattered and not nameless:
        return CAL.nothing_unknown
    p = unknown_probability(found.signs, found.told)
    return p if found.best.candidates or scattered else max(p, CAL.nameless)


def _budget(found: Examined, held_out: Sequence[Recording], tell: Callable[..., None]) -> Budget | None:
    """Which share of the excess each effect of the best hypothesis closes, on what was held out if there is any."""
    names = found.best.names
    if len(names) > CAL.few:
        return _budget_of_many(found, held_out, tell)
    if held_out:
        tell(f"sharing out the gap among {listed(names)} on {listed([own.name for own in held_out])}, held out")
        full = with_effects(found, found.best)
        there = found.selection.search.values(found.best)
        whole, bench = refitted_tolerances(full, held_out, found.vehicle, found.effects, found.sd, there)
        misfits = {frozenset(names): whole}
        for own in subsets(names)[:-1]:
            model = with_effects(found, found.best, own)
            try:
                misfits[own], _ = refitted_tolerances(
                    model, held_out, found.vehicle, found.effects, found.sd, whole.values, whole.trust
                )
            except BadInput:  # some effects without the others may leave the range of numbers
                if not own:
                    raise
                misfits[own] = misfits[frozenset()]
        good = plain(misfits[frozenset(names)].e, fresh(bench), bench)
        return budget(misfits, names, found.sd, good, bench, tuple(own.name for own in held_out), True)
    search = found.selection.search
    known = {frozenset(own.names): own for own in found.selection.tried}
    more = [own for own in subsets(names) if own not in found.freed]
    parts = [known.get(own) or refitted(search, found.best.only(own)) for own in more]
    free = dict(zip(more, at_their_best(search, parts, found.sd, found.good), strict=True))
    misfits = {own: misfit(search, {**free, **found.freed}[own]) for own in subsets(names)}
    good = plain(misfits[frozenset(names)].e, found.good, found.bench)
    return budget(misfits, names, found.sd, good, found.bench, tuple(own.name for own in found.recordings), False)


def _budget_of_many(found: Examined, held_out: Sequence[Recording], tell: Callable[..., None]) -> Budget | None:
    """The same of many effects: what each does adds up, to first order, in sets that are neither none nor all."""
    best, names = found.best, found.best.names
    search = found.selection.search
    if held_out:
        tell(f"sharing out the gap among {listed(names)} on {listed([own.name for own in held_out])}, held out")
        full = with_effects(found, best)
        there = search.values(best)
        whole, search, own = freed_tolerances(full, held_out, found.vehicle, found.effects, found.sd, there)
        search.about(own)
        nothing, _ = refitted_tolerances(
            with_effects(found, best, set()),
            held_out,
            found.vehicle,
            found.effects,
            found.sd,
            whole.values,
            whole.trust,
        )
        known = {frozenset(names): whole, frozenset[str](): nothing}
        misfits = of_subsets(search, own, _absent(found, search), known)
        good = plain(whole.e, fresh(search.bench), search.bench)
        return budget(misfits, names, found.sd, good, search.bench, tuple(one.name for one in held_out), True)
    known = {frozenset(own): misfit(search, found.freed[own]) for own in (frozenset(names), frozenset[str]())}
    with search.elsewhere():
        if found.unnamed is not None:
            search.recoloured(white_noise(found.sd, found.good, found.bench.rows))
        own = found.freed[frozenset(names)]
        search.about(own)
        misfits = of_subsets(search, own, _absent(found, search), known)
    good = plain(known[frozenset(names)].e, found.good, found.bench)
    return budget(misfits, names, found.sd, good, found.bench, tuple(own.name for own in found.recordings), False)


def _absent(found: Examined, search: Search) -> dict[str, dict[int, float]]:
    """Effect of the best hypothesis -> parameter that is elsewhere without it -> where."""
    own = found.selection.search
    places = {parameter.name: index for index, parameter in scalars(search.bench.model)}
    mains = {each.effect: each.axes[0] for each in found.best.candidates}
    return {
        name: {axis.index if search is own else places[axis.name]: axis.value(axis.null)}
        for name, axis in mains.items()
    }


def _causes(found: Examined, shared: Budget | None) -> tuple[Hypothesis, dict[str, str]]:
    """The effects of the best hypothesis that are called causes, and why the others are not, by name.

    Parameters
    ----------
    found : what was examined.
    shared : what these close; None where that tells nothing: of next to no gap, which tolerances may close by chance.
    """
    best, reasons = found.best, dict[str, str]()
    varying = found.varying
    for candidate, at in best.parts:
        name, axis, m = candidate.effect, candidate.axes[0], best.m[at.start]
        share = shared.of(name) if shared is not None else None
        sure = _of_class(found, name)
        spread = varying.get(name)
        if spread is not None and spread.relative > CAL.varies:
            reasons[name] = (
                f"an effect that mimics it: its magnitude differs by {100 * min(spread.relative, 2.0):.0f} % "
                f"{spread.place}, that of a cause does not"
            )
        elif found.unnamed is not None and _mimics(found, best, name) > CAL.present:
            reasons[name] = (
                f"an effect that mimics it: beside it stated tolerances are off by chi-square "
                f"{found.unnamed.tolerances:.0f}, where {found.unnamed.expected:.0f} is usual, and it gains little more"
            )
        elif sure <= CAL.present:
            alike = _alike(found, name, CAL.alike)
            beside = f", and as much speaks for {listed(alike)}" if alike else ""
            reasons[name] = f"its probability is {sure:.2f}, no more than one half{beside}"
        elif min(abs(m - axis.low), abs(m - axis.high)) < CAL.at_bound * axis.scale:
            reasons[name] = "it stands at its bound: a symptom of something else, no size"
        elif shared is not None and share is not None and not (share.share >= _least_share(shared) and share.low > 0):
            judged = "on what was held out" if shared.held_out else "in free run"
            reasons[name] = (
                f"a refinement: {judged} it closes {100 * share.share:.0f} % of the excess "
                f"[{100 * share.low:.0f}, {100 * share.high:.0f}]"
            )
        else:  # several doubts, each of them below one half
            told = (1.0 - CAL.nothing_unknown) * sure * _itself(found, best, name, spread) * _closes(shared, name)
            if told <= CAL.present:
                reasons[name] = f"its probability is {told:.2f}, no more than one half"
    if not reasons:
        return best, reasons
    kept = frozenset(best.names) - set(reasons)
    known = {frozenset(own.names): own for own in (*found.selection.tried, found.selection.base)}
    search = found.selection.search
    return known.get(kept) or refitted(search, best.only(kept)), reasons


def _gain(found: Examined, hypothesis: Hypothesis, name: str) -> float:
    """Log-likelihood that an effect gains beside the others of a hypothesis."""
    base, others = found.selection.base, set(hypothesis.names) - {name}
    without = [own.cost for own in found.selection.tried if set(own.names) == others]
    return max(min([base.cost, *without]) - hypothesis.cost, 0.0)  # either may have been left on its way


def _mimics(found: Examined, hypothesis: Hypothesis, name: str) -> float:
    """The probability that an effect stands for one without a name, which strains tolerances where it is none."""
    strain = found.unnamed.strain if found.unnamed is not None else 0.0
    if strain == 0.0:
        return 0.0
    x = CAL.mimic_slope * log(CAL.mimic * strain / max(_gain(found, hypothesis, name), TINY))
    return float(1 / (1 + exp(-max(min(x, 30.0), -30.0))))


def by_no_name(found: Examined) -> float:
    """The probability that an effect of the best explanation is there and is not what it is called."""
    varying, tried = found.varying, found.selection.tried
    others = [
        probability(found.evidence, tried, name) * (1.0 - _itself(found, found.best, name, varying.get(name)))
        for name in found.best.names
    ]
    return float(1.0 - np.prod([1.0 - own for own in others]))


def _itself(found: Examined, hypothesis: Hypothesis, name: str, spread: Spread | None) -> float:
    """The probability that what an effect explains is its own: of one size everywhere, and no strain of tolerances."""
    return _constant(spread) * (1.0 - _mimics(found, hypothesis, name))


def _of_class(found: Examined, name: str) -> float:
    """The probability that an effect is there, or one that these recordings cannot tell from it."""
    within = CAL.alike if found.selection.at_once else CAL.twins
    return probability(found.evidence, found.selection.tried, name, *_alike(found, name, within))


def _classes(found: Examined, ranking: Sequence[Ranked], applied: Sequence[str]) -> tuple[CauseClass, ...]:
    """Of every effect of the best explanation, what acts as it does."""
    classes, known = [], 1.0 - CAL.nothing_unknown
    for name in found.best.names:
        rank = next((own for own in ranking if own.effect == name), None)
        if rank is None:
            continue
        alone = {
            own: probability(found.evidence, found.selection.tried, own)
            for own in (name, *_alike(found, name, CAL.alike))
        }
        whole = known * _of_class(found, name)
        total = sum(alone.values()) or 1.0
        each = {own: whole * p / total for own, p in sorted(alone.items(), key=lambda item: -item[1])}
        each = {own: p for own, p in each.items() if p >= CAL.told_probability or own == name}
        classes.append(CauseClass(tuple(each), whole, each, name if name in applied else ""))
    return tuple(sorted(classes, key=lambda own: -own.probability))


def _ranking(found: Examined, reasons: Mapping[str, str], shared: Budget | None) -> list[Ranked]:
    """Effects by their probability.

    Parameters
    ----------
    found : what was examined.
    reasons : why effects of the best hypothesis are not applied, by name.
    shared : what these close.
    """
    known, varying = 1.0 - CAL.nothing_unknown, found.varying
    selection, weighed = found.selection, found.evidence
    tried = selection.tried
    names = list(dict.fromkeys(name for own in tried for name in own.names))
    ranked = []
    for name in names:
        holding = [k for k, own in enumerate(tried) if name in own.names]
        most = tried[max(holding, key=lambda k: weighed.scores[k])]
        magnitude, interval = _magnitude(found, most, name)
        part = next(own.part for own in most.candidates if own.effect == name)
        by = 1.0 if name in found.best.names else weighed.outdone.get(name, 1.0)
        ranked.append(
            Ranked(
                name,
                known
                * probability(weighed, tried, name)
                * _itself(found, most, name, varying.get(name))
                * _closes(shared, name),
                magnitude,
                most.main(name)[0].unit,
                interval,
                _alike(found, name, CAL.alike),
                _gain(found, most, name),
                reasons.get(name, DIFFERS if by > 1.0 else ""),
                *((None, None, "") if part is None else (part.since, part.until, _place(found, part))),
                _others(found, most, name),
            )
        )
    for name, (own, present) in found.scatter.items():
        unit = found.effects[name].parameter.unit if name in found.effects else "1"
        span = (max(own.magnitude - 1.96 * own.sd, 0.0), own.magnitude + 1.96 * own.sd)
        gain = selection.search.trust * own.gain
        reason = OF_READINGS if present > CAL.present else ""
        ranked.append(Ranked(name, known * present, own.magnitude, unit, span, (), gain, reason))
    of_set = _of_sets(found, ranked, known)
    even = replace(weighed, weights=weighed.even)
    nearest = {name: float(f"{probability(even, tried, name):.6g}") for name in names}

    def order(own: Ranked) -> tuple[float, float, float]:
        p = of_set[own.effect] / known
        return -float(f"{p:.6g}") if p >= CAL.told_probability else 0.0, -nearest.get(own.effect, 0.0), -own.gain

    return sorted(ranked, key=order)[: CAL.ranked]


def _of_sets(found: Examined, ranked: Sequence[Ranked], known: float) -> dict[str, float]:
    """What effects are ranked by: their probability; that of all that cannot be distinguished for the first of them.

    Two aliases share the weight of what is surely one of them: an effect beside them of which less is sure comes next.
    """
    rank, led = {own.effect: own.probability for own in ranked}, set[str]()
    for own in sorted(ranked, key=lambda each: (-each.probability, -each.gain)):
        mates = {own.effect, *own.indistinguishable_from}
        if len(mates) > 1 and not mates & led:
            rank[own.effect] = max(known * probability(found.evidence, found.selection.tried, *mates), own.probability)
        led |= mates
    return rank


def _p_value(found: Examined, unexplained: bool) -> float:
    """How often a vehicle without a gap would look so: like the best hypothesis, an effect of variance, or as loud.

    Where equations are rough, by what such vehicles gained, from which costs are derived; else by noise alone.
    """
    many, temper, base = len(found.effects), found.evidence.temper, found.selection.base
    tried = found.selection.tried
    counts = temper / found.selection.search.trust
    p = [p_value(counts * (base.cost - own.cost), len(own.axes), many ** len(own.candidates)) for own in tried]
    if found.unnamed is not None and found.rough:
        p = [max(own, by_chance(score)) for own, score in zip(p, found.evidence.scores, strict=True)]
    p += [p_value(own.gain, 1, many) for own, present in found.scatter.values() if present > CAL.present]
    if unexplained:
        p.append(float(len(found.sd) * ndtr(-CAL.surely)))  # at most: the loudest channel is further off than that
    return min(p, default=1.0)


def _constant(spread: Spread | None) -> float:
    """The probability that a magnitude that differs so between parts of a recording is a cause's."""
    if spread is None:
        return 1.0
    x = (spread.relative - CAL.varies) / CAL.varies_width
    return float(1 / (1 + exp(min(x, 30.0))))


def _closes(shared: Budget | None, name: str) -> float:
    """The probability that an effect closes as much as a cause does; one for those of which no share is known."""
    if shared is None or (own := shared.of(name)) is None:
        return 1.0
    sd = max((own.high - own.low) / (2 * NORMAL), CAL.least_share / 10)
    return float(ndtr((own.share - _least_share(shared)) / sd))


def _least_share(shared: Budget) -> float:
    """The share from which on an effect is a cause: on the recordings that chose it, any that is surely there."""
    return CAL.least_share if shared.held_out else 0.0


def _magnitude(found: Examined, hypothesis: Hypothesis, name: str) -> tuple[float, tuple[float, float]]:
    """Magnitude of one effect in a hypothesis, with its 95 % interval."""
    (axis, at), search = hypothesis.main(name), found.selection.search
    sd = float(np.sqrt(max(search.covariance(hypothesis)[at, at], 0.0)) * search.widening(hypothesis)[at])
    if found.rough:
        sd = float(np.hypot(CAL.wider * sd, CAL.form_of_size * (hypothesis.m[at] - axis.null)))
    half = 1.96 * sd
    ends = [axis.value(float(np.clip(hypothesis.m[at] + side * half, axis.low, axis.high))) for side in (-1, 1)]
    return axis.value(float(hypothesis.m[at])), (min(ends), max(ends))


def _others(found: Examined, hypothesis: Hypothesis, name: str) -> dict[str, float]:
    """Second parameters of one effect in a hypothesis that are elsewhere than usual."""
    candidate, at = next(own for own in hypothesis.parts if own[0].effect == name)
    usual = {own.name: float(own.array) for own in found.effects[name].others}
    own = {axis.name: axis.value(float(m)) for axis, m in zip(candidate.axes[1:], hypothesis.m[at][1:], strict=True)}
    return {parameter: value for parameter, value in own.items() if value != usual[parameter]}


def _place(found: Examined, part: ActingRows) -> str:
    """The name of the recording in which an effect begins or ends, and of its run where it has several."""
    k, run, _ = place_of(found, part)
    return f"{part.recording}, run {run + 1}" if len(found.recordings[k].runs) > 1 else part.recording


def _alike(found: Examined, name: str, within: float) -> tuple[str, ...]:
    """Effects that explain as much in this one's place, within so much log-likelihood."""
    tried, scores = found.selection.tried, found.evidence.scores
    holding = [k for k, own in enumerate(tried) if name in own.names]
    k = max(holding, key=lambda j: scores[j])
    others = set(tried[k].names) - {name}
    alike = []
    for j, own in enumerate(tried):
        new = set(own.names) - others
        if j != k and len(own.names) == len(tried[k].names) and others < set(own.names) | {""} and len(new) == 1:
            (other,) = new
            if other != name and abs(scores[j] - scores[k]) < within and scores[k] > 0:
                alike.append(other)
    return tuple(dict.fromkeys(alike))


def _shape(found: Examined, channel: str, like: Sequence[Wander]) -> str:
    """What is unknown in a sentence.

    Parameters
    ----------
    channel : where it shows most.
    like : effects that it looks like.
    """
    own, names, left = found.signs, found.best.names, found.unnamed
    parts = [f"most in {channel}"] if channel else []
    if like:
        first, *others = like
        unit = "" if first.unit == "1" else f" {pretty_unit(first.unit)}"
        parts.append(
            f"like {first.effect} that varies by ± {first.sd:.2g}{unit} within {first.correlation_time:.2g} s"
            + (f", or {' or '.join(each.effect for each in others)}" if others else "")
        )
    if left is not None:
        lateral, longitudinal = (100 * v for v in (left.share_y, left.share_x))
        parts.append(
            f"unknown forces of {lateral:.2g} % of the lateral and {longitudinal:.2g} % of the longitudinal ones"
        )
    if names and own.spread > CAL.form_of_size:
        parts.append(f"{names[0]}, the nearest name, would differ by {100 * own.spread:.0f} % {own.place}")
    if own.left > CAL.form_of_size:
        on = listed([own.name for own in found.recordings])
        parts.append(f"{100 * min(own.left, 1.0):.0f} % of the error beyond noise is left on {on}")
    return "; ".join(parts) or "its shape is none that is known here"
