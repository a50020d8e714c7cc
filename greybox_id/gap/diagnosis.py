"""The verb `diagnose`: from recordings and a model to a `Gap`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from ..checks import Severity, check
from ..checks.finding import listed
from ..effect import Effect
from ..recording import Recording
from ..vehicle import Vehicle
from .advice import advice
from .axes import Axis
from .closing import closure, left_open
from .evidence import p_value, probability
from .examining import PRESENT, Examined, examine
from .gap import Closure, Gap, Ranked
from .horizons import by_horizon
from .hypothesis import Hypothesis
from .kinds import Diagnosed
from .regimes import where
from .strip import strip
from .unknown import SURELY, unknown_probability, without_a_name
from .unseen import limits, not_excited

RANKED = 8
"""Effects that are listed at most."""
ALIKE = 3.0
"""Effects whose likelihoods, tempered, differ by less than this are not told apart."""
WIDER, FORM = 2.0, 0.05
"""How much wider intervals are where the equations are rough; and the standard deviation, over its distance from the
null, of a magnitude whose effect is as rough: a play whose flanks give, a limit without a corner, has no exact size."""
NOTHING_UNKNOWN, NAMELESS = 0.01, 0.95
JITTER_LEAVES = 0.3
"""Share of the gap that jitter may leave, for it moves readings past commands too, which rates do not tell."""


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
    """Say where a simulation departs from a vehicle, which effect causes it, and how far the gap shrinks with it.

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
    scattered = [name for name, (_, present) in found.scatter.items() if present > PRESENT]
    stated = found.rough and not found.bench.learnt  # what training left follows driving anyway
    unexplained = without_a_name(found.signs, found.evidence.temper, stated, found.told)
    detected = bool(found.best.candidates) or bool(scattered) or unexplained
    unknown = unknown_probability(found.signs, found.rough, found.told) if detected else NOTHING_UNKNOWN
    if detected and not found.best.candidates and not scattered:  # a gap, and no name for it
        unknown = max(unknown, NAMELESS)
    if scattered and not found.best.candidates and found.signs.left < JITTER_LEAVES:
        unknown = min(unknown, NOTHING_UNKNOWN)
    ranking = _ranking(found, 1.0 - unknown)
    best = found.selection.base if unknown > PRESENT else found.best  # a stand-in for what has no name closes nothing
    applied = tuple(best.names)
    added = _with_effects(found, best)
    closed = _moved_along(found, best, added)
    verified, proof = None, found.closed
    if held_out:
        tell(f"verifying on {len(held_out)} recordings that were held out")
        verified = closure(found.model, added, held_out, found.vehicle, found.effects, sd=found.sd, as_it_stands=closed)
        if not applied and found.best.candidates:
            by_names = _with_effects(found, found.best)
            proof = closure(found.model, by_names, held_out, found.vehicle, found.effects, False, found.sd)
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
        p_value=_p_value(found, unexplained),
        unknown_probability=unknown,
        unknown=_shape(found, place.channel, proof) if unknown > PRESENT else "",
        where=place if detected else replace(place, channel="", regime="any"),
        ranking=tuple(ranking),
        applied=applied,
        gap=found.closed if applied or not found.best.candidates else left_open(found.closed),
        held_out=verified,
        not_excited=weak,
        absorbed=absorbed,
        advice=advice(sets, list(weak), found.effects),
        closed=closed,
        strip=strip(found.bench, selection.base.e * counted, best.e * counted, found.sd, found.seen),
        noise_stated=found.told,
        limits=limits(found),
    )


def _ranking(found: Examined, known: float) -> list[Ranked]:
    """Effects by their probability.

    Parameters
    ----------
    found : what was examined.
    known : probability that the cause has a name: a named effect that stands in for an unknown one is not present.
    """
    selection, weighed = found.selection, found.evidence
    tried = selection.tried
    names = list(dict.fromkeys(name for own in tried for name in own.names))
    ranked = []
    for name in names:
        holding = [k for k, own in enumerate(tried) if name in own.names]
        most = tried[max(holding, key=lambda k: weighed.scores[k])]
        rest = min((own.cost for own in (selection.base, *tried) if set(own.names) == set(most.names) - {name}),
                   default=selection.base.cost)  # fmt: skip
        magnitude, interval = _magnitude(found, most, name)
        ranked.append(
            Ranked(
                name,
                known * probability(weighed, tried, name),
                magnitude,
                _axis_of(most, name).unit,
                interval,
                _alike(found, name),
                rest - most.cost,
            )
        )
    for name, (own, present) in found.scatter.items():
        unit = found.effects[name].parameter.unit if name in found.effects else "1"
        span = (max(own.magnitude - 1.96 * own.sd, 0.0), own.magnitude + 1.96 * own.sd)
        gain = selection.search.trust * own.gain
        ranked.append(Ranked(name, known * present, own.magnitude, unit, span, (), gain))
    of_set = _of_sets(found, ranked, known)
    return sorted(ranked, key=lambda own: (-round(of_set[own.effect] / known, 6), -own.gain))[:RANKED]


def _of_sets(found: Examined, ranked: Sequence[Ranked], known: float) -> dict[str, float]:
    """What effects are ranked by: their probability; that of all that cannot be told apart for the first of them.

    Two aliases share the weight of what is surely one of them: an effect beside them of which less is sure comes next.
    """
    weighed = list(zip(found.evidence.weights, found.selection.tried, strict=False))
    rank, led = {own.effect: own.probability for own in ranked}, set[str]()
    for own in sorted(ranked, key=lambda each: (-each.probability, -each.gain)):
        mates = {own.effect, *own.indistinguishable_from}
        if len(mates) > 1 and not mates & led:
            together = sum(weight for weight, each in weighed if mates & set(each.names))
            rank[own.effect] = max(known * together, own.probability)
        led |= mates
    return rank


def _p_value(found: Examined, unexplained: bool) -> float:
    """How often noise alone would look so: like the best hypothesis, like an effect of variance, or as loud."""
    many, temper, base = len(found.effects), found.evidence.temper, found.selection.base
    tried = found.selection.tried
    counts = temper / found.selection.search.trust
    p = [p_value(counts * (base.cost - own.cost), len(own.axes), many ** len(own.candidates)) for own in tried]
    p += [p_value(own.gain, 1, many) for own, present in found.scatter.values() if present > PRESENT]
    if unexplained:
        p.append(float(len(found.sd) * norm.sf(SURELY)))  # at most: the loudest channel is further off than that
    return min(p, default=1.0)


def _axis_of(hypothesis: Hypothesis, name: str) -> Axis:
    return next(own.axes[0] for own in hypothesis.candidates if own.effect == name)


def _magnitude(found: Examined, hypothesis: Hypothesis, name: str) -> tuple[float, tuple[float, float]]:
    """Magnitude of one effect in a hypothesis, with its 95 % interval."""
    axis, at = _axis_of(hypothesis, name), 0
    for own in hypothesis.candidates:
        if own.effect == name:
            break
        at += len(own.axes)
    search = found.selection.search
    sd = float(np.sqrt(max(search.covariance(hypothesis)[at, at], 0.0)) * search.widening(hypothesis)[at])
    if found.rough:
        sd = float(np.hypot(WIDER * sd, FORM * (hypothesis.m[at] - axis.null)))
    half = 1.96 * sd
    ends = [axis.value(float(np.clip(hypothesis.m[at] + side * half, axis.low, axis.high))) for side in (-1, 1)]
    return axis.value(float(hypothesis.m[at])), (min(ends), max(ends))


def _alike(found: Examined, name: str) -> tuple[str, ...]:
    """Effects that explain as much in this one's place."""
    tried, scores = found.selection.tried, found.evidence.scores
    holding = [k for k, own in enumerate(tried) if name in own.names]
    k = max(holding, key=lambda j: scores[j])
    others = set(tried[k].names) - {name}
    alike = []
    for j, own in enumerate(tried):
        new = set(own.names) - others
        if j != k and len(own.names) == len(tried[k].names) and others < set(own.names) | {""} and len(new) == 1:
            (other,) = new
            if other != name and abs(scores[j] - scores[k]) < ALIKE and scores[k] > 0:
                alike.append(other)
    return tuple(dict.fromkeys(alike))


def _with_effects(found: Examined, best: Hypothesis) -> Diagnosed:
    """The model as it was, with a hypothesis' effects at their magnitudes; tolerances stay where they are stated."""
    model = found.model
    for candidate in best.candidates:
        effect = found.effects[candidate.effect]
        at = sum(len(own.axes) for own in best.candidates[: best.candidates.index(candidate)])
        values = [axis.value(float(m)) for axis, m in zip(candidate.axes, best.m[at:], strict=False)]
        if candidate.effect not in model.effects:
            model = model + effect.at(values[0])
        names = [axis.name for axis in candidate.axes]
        model = model.with_parameters(
            *(replace(model[n].with_value(v), fixed=True) for n, v in zip(names, values, strict=True))
        )
    return model


def _moved_along(found: Examined, best: Hypothesis, closed: Diagnosed) -> Diagnosed:
    """The closed model with tolerances where its effects were found: magnitudes go with these and with no others."""
    if not best.candidates:
        return closed
    search = found.selection.search
    p, own = search.vector(best), {axis.index for axis in best.axes}
    moved = [axis for axis in search.moving if axis.name in found.model and axis.index not in own]
    at = {axis.name: float(np.clip(p[axis.index], *closed[axis.name].bounds)) for axis in moved}  # curves reach beyond
    return closed.with_parameters(*(closed[name].with_value(value) for name, value in at.items()))


def _shape(found: Examined, channel: str, proof: Closure) -> str:
    """What is unknown in a sentence.

    Parameters
    ----------
    channel : where it shows most.
    proof : how far the nearest names would close the gap, on recordings that were held out if there are any.
    """
    own, names = found.signs, found.best.names
    parts = [f"most in {channel}"] if channel else []
    if names and own.spread > 0.05:
        parts.append(f"{names[0]}, the nearest name, would differ by {100 * own.spread:.0f} % along {own.along}")
    if names:
        place = "here" if proof is found.closed else f"on {', '.join(proof.recordings)} (held out)"
        does = f"close {100 * proof.closed:.0f} % of the gap" if proof.closed > 0 else "make the gap larger"
        parts.append(f"{listed(names)} in its place would {does} {place}")
    if own.left > 0.05:
        parts.append(f"{100 * min(own.left, 1.0):.0f} % of the gap is left")
    return "; ".join(parts) or "its shape is none that is known here"
