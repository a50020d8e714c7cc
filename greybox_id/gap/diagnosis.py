"""The verb `diagnose`: from recordings and a model to a `Gap`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import ndtr
from threadpoolctl import threadpool_limits

from ..base.numbers import number, pretty_unit
from ..datasets.checks import doubts
from ..datasets.checks.finding import listed
from ..datasets.recording import Recording
from ..datasets.spins import span, spins, without_spins
from ..engine.motion.traced import traced_once
from ..engine.simulation import Diagnosed
from ..fitting.scores.horizons import by_horizon
from ..models.effect import Effect
from ..models.vehicle import Vehicle
from .advice import advice, detection_limits
from .budget import closes, shared_out, weak
from .closed_model import closed_model, moved, place_of
from .closing import left_open, on_held_out
from .courses import courses
from .estimation.calibration import CAL
from .estimation.hold import otherwise, restated
from .estimation.hypothesis import Hypothesis
from .estimation.observer import PULLED
from .estimation.preparing import excerpt
from .estimation.strip import strip
from .estimation.wandering import Wander
from .evidence import by_chance, p_value, probability
from .examining import Examined, examine
from .gap import Budget, CauseClass, Closure, Gap, Ranked
from .judging import (
    alike_of,
    closes_too_little,
    gain_of,
    genuine,
    insignificant,
    known_sizes,
    misnamed_probability,
    of_class,
    refused,
    restricted_to,
    size_sd,
    superfluous,
    unnamed_probability,
)
from .regimes import where

DIFFERS = "its estimate differs between parts of the drive, which suggests that the equations have the wrong form"
OF_READINGS = "it only adds noise to readings and does not change a simulation"


@np.errstate(over="ignore", invalid="ignore")  # simulations of a search may diverge: infinite costs are refused
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
    vehicle : stated tolerances, which are refitted and charged for, and sensor noise. A number stated without an sd is
        exact.
    held_out : recordings that choose nothing, on which the closure is verified.
    say : receives lines of progress.
    horizons : whether to compute errors over fixed horizons on the diagnosed recordings too; on those held out they
        always are.
    seed : kept for the record; no result depends on a random draw.

    Raises
    ------
    BadInput : a recording lacks what the model reads, or no effect acts on the model.
    """
    del seed
    tell = say or (lambda line, **_: None)
    given = recordings
    recordings, held_out = ([without_spins(one) for one in part] for part in (recordings, held_out))
    left_out = tuple(_spun(one) for one, left in zip(given, recordings, strict=True) if left is not one)
    with traced_once(), threadpool_limits(1):  # matrices are tall and thin: further threads only wait for each other
        result = examine(model, recordings, effects, vehicle, tell)
        doubted = restated(recordings, result.recordings)
        gap = answer(result, otherwise(held_out) if doubted else held_out, tell)
        gap = replace(gap, doubts=(*gap.doubts, *left_out, *doubted))
        if not horizons or gap.closed is None:
            return gap
        errors = by_horizon(model, gap.closed, result.recordings, result.sd)
        return replace(gap, gap=replace(gap.gap, errors=errors))


def _spun(recording: Recording) -> str:
    """A sentence on the rows that are left out, because the vehicle spins."""
    when = listed([span(recording, a, b) for a, b in spins(recording)])
    return f"{recording.name}: the vehicle spins {when}. No model of handling describes that: these rows are left out."


def answer(examined: Examined, held_out: Sequence[Recording], tell: Callable[..., None]) -> Gap:
    """The answer of a diagnosis, from what was examined."""
    selection, good, sd = examined.selection, examined.good, examined.sd
    scattered = any(present > CAL.present for _, present in examined.scatter.values())
    unknown = 1.0 - (1.0 - unnamed_probability(examined)) * (1.0 - misnamed_probability(examined))
    like = examined.resembles if unknown > CAL.suspected else ()
    if like:  # gains by far more than chance
        unknown = max(unknown, CAL.nameless)
    detected = bool(examined.best.candidates) or scattered or unknown > CAL.present
    causes, closed, verified = _verified(examined, _budgeted(examined, held_out, tell), detected, held_out, tell)
    best, shared = causes.best, causes.shared
    ranking, applied = _ranking(examined, causes), tuple(best.names)
    whole = shared if shared is not None and shared.shows else causes.telling
    if whole is not None and whole.held_out and whole.unnamed.low > CAL.present:
        # more than half of the excess is surely due to no named effect
        unknown = max(unknown, CAL.nameless)
    if shared is not None and not shared.shows and any(share.low <= 0 for share in shared.shares):
        shared = None  # shares of next to no gap, where the effects themselves are certain
    like = like or (examined.resembles if unknown > CAL.present else ())
    before = (selection.base.e / sd) ** 2
    excess = np.sum(np.where(good, before - ((best.e / sd) ** 2 if applied else 1), 0.0), axis=1)
    ratio = np.array([np.sqrt(np.mean(before[one, c])) if np.any(one := good[:, c]) else np.nan
                      for c in range(len(sd))])  # fmt: skip
    place = where(examined.bench, excess, ratio, examined.seen, selection.expected_gains, examined.effects)
    limits, unexcited, absorbed = detection_limits(examined)
    unread = [name for name, c in zip(examined.bench.channels, examined.bench.counted.T, strict=True) if not np.any(c)]
    sets = [(item.effect, *item.indistinguishable_from) for item in ranking[:2] if item.indistinguishable_from]
    counted, shown = np.where(good, 1.0, 0.0), excerpt(examined.recordings)
    errors = [examined.at_its_best(item).e * counted for item in (selection.base, best)]  # as the closure is computed
    return Gap(
        model=examined.model.name,
        recordings=tuple(recording.name for recording in examined.recordings),
        doubts=doubts(examined.recordings),
        gap_detected=detected,
        p_value=_p_value(examined, unknown > CAL.present),
        unknown_probability=unknown,
        unknown=_shape(examined, place.channel, like) if unknown > CAL.present else "",
        where=place if detected else replace(place, channel="", regime="any"),
        ranking=tuple(ranking),
        applied=applied,
        gap=examined.closes(best) if applied or not examined.best.candidates else left_open(examined.closed),
        held_out=verified,
        not_excited=unexcited,
        absorbed=absorbed,
        advice=advice(sets, list(unexcited), examined.effects, unread, selection.apart),
        closed=closed,
        strip=strip(examined.bench, errors[0], errors[1], sd, examined.seen, excess, shown),
        noise_stated=examined.noise_stated,
        limits=limits,
        budget=shared,
        unnamed=examined.unnamed,
        resembles=like,
        courses=courses(examined, best, like, held_out),
        moved=moved(examined, best, closed),
        tried={item.candidate.effect: item.gain for item in selection.expected_gains},
        held=_held(examined),
        classes=_classes(examined, ranking, causes),
    )


@dataclass(frozen=True)
class _Causes:
    """The effects of the best explanation that are causes, as far as they were judged.

    Attributes
    ----------
    best : the explanation by them alone.
    reasons : why the others are not applied, by name.
    chances : of each effect, how likely its size is chance.
    shared : budget of the causes.
    telling : budget by which effects were refused, or could have been.
    """

    best: Hypothesis
    reasons: Mapping[str, str]
    chances: Mapping[str, float]
    shared: Budget | None
    telling: Budget | None


def _budgeted(examined: Examined, held_out: Sequence[Recording], tell: Callable[..., None]) -> _Causes:
    """Causes that are significant, and that close enough of the gap by its budget."""
    if not examined.best.candidates:
        return _Causes(examined.best, {}, {}, None, None)
    sizes = known_sizes(examined, examined.best)
    reasons, chances = insignificant(examined, sizes, CAL.by_chance)
    leave, _ = insignificant(examined, sizes, CAL.present)
    doubtful = set(reasons) - set(leave)
    best = restricted_to(examined, set(examined.best.names) - set(leave)) if leave else examined.best
    shared, telling = None, None
    stated = examined.inexact and not examined.bench.learnt  # with stated tolerances, innovations alone do not suffice
    while set(best.names) - doubtful:  # judged beside doubtful effects, too: these are likelier present than not
        shared = shared_out(examined, best, held_out, tell)
        telling = shared if shared is not None and shared.shows and (shared.held_out or stated) else None
        leaving = refused(examined, set(best.names) - doubtful, telling)
        little = {name: by.share for name in leaving if telling is not None and (by := weak(telling, name)) is not None}
        if len(little) > 1:  # only the smallest leaves: it may hide what the others close
            least = min(little, key=lambda name: little[name])
            leaving = {name: why for name, why in leaving.items() if name not in little or name == least}
        reasons |= leaving
        best = restricted_to(examined, set(best.names) - set(leaving))
        if len(little) < 2:
            break
    best = restricted_to(examined, set(best.names) - doubtful) if doubtful else best
    best, unneeded = superfluous(examined, best)
    return _Causes(best, reasons | unneeded, chances, shared, telling)


def _verified(
    examined: Examined, causes: _Causes, detected: bool, held_out: Sequence[Recording], tell: Callable[..., None]
) -> tuple[_Causes, Diagnosed, Closure | None]:
    """Causes with which the model errs less on held-out recordings, that model, and how far it closes the gap there."""
    best, shared, reasons = causes.best, causes.shared, dict(causes.reasons)
    while True:
        if shared is not None and {share.effect for share in shared.shares} != set(best.names):  # some have left
            shared = shared_out(examined, best, held_out, tell) if best.names else None
        if shared is not None and (why := closes_too_little(shared, not examined.inexact)):
            reasons |= dict.fromkeys(best.names, why)
            best, shared = restricted_to(examined, set()), None
        if held_out:
            tell(f"verifying on {on_held_out(held_out)}")
        closed, verified, worse = closed_model(examined, best, detected, held_out, shared)
        if not worse:
            return replace(causes, best=best, reasons=reasons, shared=shared), closed, verified
        weakest = min(best.names, key=partial(gain_of, examined, examined.best))
        reasons[weakest] = worse
        best = restricted_to(examined, set(best.names) - {weakest})


def _held(examined: Examined) -> str:
    """How simulations were kept from spinning, where free runs of the model spin with and without effects; else ""."""
    name = PULLED.format("yaw_rate")
    names = [parameter.name for parameter in examined.bench.model.parameters]
    if name not in names or not (rate := examined.selection.search.nominal[names.index(name)]) > 0:
        return ""
    return (
        "Free runs of this model spin, with and without effects. An observer therefore pulls yaw_rate to its reading "
        f"within {number(1 / rate, 2)} s, so errors are those of predictions about {number(1 / rate, 2)} s ahead"
    )


def _classes(examined: Examined, ranking: Sequence[Ranked], causes: _Causes) -> tuple[CauseClass, ...]:
    """The class of each effect of the best explanation: effects that act alike; doubts about it hold for all."""
    classes = []
    tried = examined.selection.tried
    for name in examined.best.names:
        if not any(item.effect == name for item in ranking):
            continue
        members = (name, *alike_of(examined, name, CAL.alike))
        alone = {member: probability(examined.evidence, tried, member) for member in members}
        whole = _discounted(examined, examined.best, name, of_class(examined, name), causes)
        total = sum(alone.values()) or 1.0
        each = {member: whole * p / total for member, p in sorted(alone.items(), key=lambda item: -item[1])}
        each = {member: p for member, p in each.items() if p >= CAL.least_probability or member == name}
        classes.append(CauseClass(tuple(each), whole, each, name if name in causes.best.names else ""))
    return tuple(sorted(classes, key=lambda item: -item.probability))


def _ranking(examined: Examined, causes: _Causes) -> list[Ranked]:
    """Effects by their probability."""
    known = 1.0 - CAL.nothing_unknown
    selection, weighed = examined.selection, examined.evidence
    tried = selection.tried
    names = list(dict.fromkeys(name for item in tried for name in item.names))
    ranked = []
    for name in names:
        holding = [k for k, item in enumerate(tried) if name in item.names]
        most = tried[max(holding, key=lambda k: weighed.scores[k])]
        by = 1.0 if name in examined.best.names else weighed.outdone.get(name, 1.0)
        p = _discounted(examined, most, name, probability(weighed, tried, name), causes)
        ranked.append(_ranked(examined, most, name, p, causes.reasons.get(name, DIFFERS if by > 1.0 else "")))
    for name, (item, present) in examined.scatter.items():
        unit = examined.effects[name].parameter.unit if name in examined.effects else "1"
        span = (max(item.magnitude - 1.96 * item.sd, 0.0), item.magnitude + 1.96 * item.sd)
        gain = selection.search.trust * item.gain
        reason = OF_READINGS if present > CAL.present else ""
        ranked.append(Ranked(name, known * present, item.magnitude, unit, span, (), gain, reason))
    of_set = _ranking_keys(examined, ranked, known)
    even = replace(weighed, weights=weighed.even)
    nearest = {name: float(f"{probability(even, tried, name):.6g}") for name in names}

    def order(ranked: Ranked) -> tuple[float, float, float]:
        p = of_set[ranked.effect] / known
        return -float(f"{p:.6g}") if p >= CAL.least_probability else 0.0, -nearest.get(ranked.effect, 0.0), -ranked.gain

    return sorted(ranked, key=order)[: CAL.ranked]


def _discounted(examined: Examined, hypothesis: Hypothesis, name: str, p: float, causes: _Causes) -> float:
    """The probability that an effect is present and is what it is named after; below one half if it is refused."""
    is_genuine = genuine(examined, hypothesis, name, examined.varying.get(name)) * closes(causes.telling, name)
    p *= (1.0 - CAL.nothing_unknown) * is_genuine * (1.0 - causes.chances.get(name, 0.0))
    return min(p, float(np.nextafter(1.0 - CAL.present, 0.0))) if name in causes.reasons else p


def _ranking_keys(examined: Examined, ranked: Sequence[Ranked], known: float) -> dict[str, float]:
    """Keys by which effects are ranked: their probability; for the first of a class, that of the whole class.

    Two aliases share the weight of a certain cause: a less certain effect beside them then ranks after the first of
    them.
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
    """How often a vehicle without a gap gains as much, by the best hypothesis, effects on scatter or unknown error.

    Where equations are inexact, by what such vehicles gained, from which costs are derived; else by noise alone.
    """
    many, temper, base = len(examined.effects), examined.evidence.temper, examined.selection.base
    tried = examined.selection.tried
    counts = temper / examined.selection.search.trust
    p = [p_value(counts * (base.cost - item.cost), len(item.axes), many ** len(item.candidates)) for item in tried]
    if examined.unnamed is not None and examined.inexact:
        p = [max(item, by_chance(score)) for item, score in zip(p, examined.evidence.scores, strict=True)]
    p += [p_value(item.gain, 1, many) for item, present in examined.scatter.values() if present > CAL.present]
    if unexplained:
        p.append(float(len(examined.sd) * ndtr(-CAL.surely)))  # at most: the worst channel deviates more
    return min(p, default=1.0)


def _ranked(examined: Examined, hypothesis: Hypothesis, name: str, p: float, reason: str) -> Ranked:
    """One effect as a cause, at its magnitude in a hypothesis."""
    candidate, at = next(part for part in hypothesis.parts if part[0].effect == name)
    (axis, *seconds), (m, *others) = candidate.axes, hypothesis.m[at].tolist()
    half = 1.96 * size_sd(examined, hypothesis, name)
    ends = [axis.value(float(np.clip(m + side * half, axis.low, axis.high))) for side in (-1, 1)]
    usual = {other.name: float(other.array) for other in examined.effects[name].others}
    values = {second.name: second.value(other) for second, other in zip(seconds, others, strict=True)}
    since, until, within = None, None, ""
    if (part := candidate.part) is not None:
        k, run, _ = place_of(examined, part)
        several = len(examined.recordings[k].runs) > 1
        since, until, within = part.since, part.until, f"{part.recording}, run {run + 1}" if several else part.recording
    return Ranked(
        name, p, axis.value(m), axis.unit, (min(ends), max(ends)), alike_of(examined, name, CAL.alike),
        gain_of(examined, hypothesis, name), reason, since, until, within,
        {parameter: value for parameter, value in values.items() if value != usual[parameter]},
    )  # fmt: skip


def _shape(examined: Examined, channel: str, like: Sequence[Wander]) -> str:
    """The unexplained error, largest in a channel and like some effects that vary, in a sentence."""
    signs, names, left = examined.signs, examined.best.names, examined.unnamed
    parts = [f"the unexplained error is largest in {channel}"] if channel else []
    if like:
        first, *others = like
        unit = "" if first.unit == "1" else f" {pretty_unit(first.unit)}"
        parts.append(
            f"like {first.effect} that varies by ± {number(first.sd, 2)}{unit} "
            f"within {number(first.correlation_time, 2)} s"
            + (f", or {' or '.join(each.effect for each in others)}" if others else "")
        )
    if left is not None:
        lateral, longitudinal = (100 * size for size in left.sizes)
        parts.append(
            f"unknown forces of {number(lateral, 2)} % of the lateral and {number(longitudinal, 2)} % of the "
            "longitudinal ones"
        )
    if names and signs.spread > CAL.form_of_size:
        parts.append(
            f"the estimate of {names[0]}, the nearest named effect, would differ by {100 * signs.spread:.0f} % "
            f"{signs.place}"
        )
    if signs.left > CAL.form_of_size:
        on = listed([recording.name for recording in examined.recordings])
        parts.append(f"{100 * min(signs.left, 1.0):.0f} % of the error beyond noise is left on {on}")
    return "; ".join(parts) or "its shape matches no known effect"
