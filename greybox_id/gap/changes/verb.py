"""What changed between recordings of one vehicle: its own recordings from before define what is usual.

Recordings from before are explained together: by numbers of the vehicle, some of which may differ between runs (grip,
stiffnesses, steering ratio, offset, delay and lag) with a scatter that is estimated (`between_runs`). Model error that
is common to all of them is absorbed by the vehicle's numbers and by the distribution of innovations (`innovations`).
The recording from after is explained by the same; an effect is one of these numbers beyond its scatter (`search`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import exp, inf, isfinite, log
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ...base.errors import BadInput
from ...base.numbers import listed, number, the_recordings
from ...base.shorthands import Array
from ...datasets.checks import Severity, check
from ...datasets.recording import Recording, held_twice
from ...engine.simulation import Diagnosed
from ...models.effect import Effect
from ...models.motion_model import MotionModel
from ...models.parameter import Stated
from ...models.vehicle import Vehicle
from ..estimation.calibration import CAL
from ..gap import Closure, Gap, Ranked, Where
from .between_runs import Common, RunExplained, values_of
from .closing import budget_of, channels_of, closure, loudness
from .columns import ByColumns, steering_changes
from .innovations import FollowedRun, Follower
from .search import Change, changes
from .sensitivity import Visible, visible
from .usual import GAINS, USUAL, acts, driven_alike, driven_elsewhere, numbers_of, usual


@dataclass(frozen=True)
class Changed:
    """What changed.

    Attributes
    ----------
    gap : the diagnosis against the vehicle as it was before.
    vehicle : as it was before, with scatter as tolerances.
    scatter : effect -> (mean, standard deviation) between runs; the latter relative where the effect is a factor.
    since : names of the recordings from before.
    drift : sentences on what drifts over the recordings from before, in their order.
    sds : effect -> standard deviation of its change, scatter between runs included; infinite where a change of usual
        size would not be detected.
    """

    gap: Gap
    vehicle: Vehicle
    scatter: Mapping[str, tuple[float, float]]
    since: tuple[str, ...]
    drift: tuple[str, ...] = ()
    sds: Mapping[str, float] = field(default_factory=dict)

    @property
    def changed(self) -> list[dict[str, Any]]:
        """One object per effect that changed."""
        budget = self.gap.budget
        result = []
        for one in self.gap.ranking:
            if one.effect in self.gap.applied:
                share = budget.of(one.effect) if budget is not None else None
                result.append({
                    "effect": one.effect, "magnitude": one.magnitude, "unit": one.unit, "interval": list(one.interval),
                    "before": self.scatter[one.effect][0], "probability": one.probability, "gain": one.gain,
                    "share": None if share is None else share.share,
                })  # fmt: skip
        return result

    @property
    def not_changed(self) -> list[dict[str, Any]]:
        """Effects that did not change, within twice the standard deviation; without doubtful and undetectable ones."""
        return [{"effect": name, "within": 2 * self.sds[name]} for name in self._still if isfinite(self.sds[name])]

    @property
    def not_seen(self) -> list[str]:
        """Effects whose change these recordings could not show."""
        return [name for name in self._still if not isfinite(self.sds[name])]

    @property
    def _still(self) -> list[str]:
        doubted = {item.effect for item in self.gap.ranking if item.reason}
        return [name for name in self.sds if name not in self.gap.applied and name not in doubted]

    def to_json(self) -> dict[str, Any]:
        """The gap as plain data, and what changed."""
        scatter = {name: {"mean": mean, "sd": sd} for name, (mean, sd) in self.scatter.items()}
        more = {
            "since": list(self.since), "scatter": scatter, "drift": list(self.drift), "changed": self.changed,
            "not_changed": self.not_changed, "not_seen": self.not_seen,
        }  # fmt: skip
        return self.gap.to_json() | more


@np.errstate(over="ignore", invalid="ignore")  # as in a diagnosis
def diagnose_change(
    model: Diagnosed,
    after: Sequence[Recording],
    since: Sequence[Recording],
    effects: Mapping[str, Effect],
    *,
    vehicle: Vehicle | None,
    held_out: Sequence[Recording] = (),
    say: Callable[..., None] | None = None,
) -> Changed:
    """Say what changed in a vehicle between recordings.

    Parameters
    ----------
    model : equations of motion at nominal values.
    after, since : recordings after and before something may have changed.
    effects : what may have changed, by name; of these, those of `USUAL`.
    vehicle : its stated parameters.
    held_out : further recordings from after, which choose nothing; without any, each half of those from after judges
        the choice of the other.
    say : receives lines of progress.

    Raises
    ------
    BadInput : there is no recording from before, or it is one from after; no vehicle is stated, or the model is none of
        motion.
    """
    tell = say or (lambda line, **_: None)
    model, vehicle, read, possible = _begun(model, [*after, *held_out], since, effects, vehicle)
    with threadpool_limits(1):  # matrices are tiny
        full, numbers = numbers_of(model, possible, vehicle)
        long = seconds_followed(model)
        before, rides, others = ([FollowedRun.of(one, read, long) for one in part] for part in (since, after, held_out))
        filtered = filtered_alike([*after, *held_out, *since])
        driven = driven_alike([*rides, *others], before) > CAL.driven
        nameless = () if filtered and driven else GAINS
        known = usual(Follower(full, read), numbers, before, tell, dict.fromkeys(nameless, CAL.filters))
        if not driven:  # model-form errors do not cancel
            known = replace(known, scatter=CAL.elsewhere * known.scatter)
        tell(f"estimating what has changed in {the_recordings([one.name for one in after])}")
        halves = () if others else tuple(zip(*(ride.halves() for ride in rides), strict=True))
        cost = CAL.cost_changed if driven else CAL.cost_elsewhere
        direct = by_place(known, possible, steering_changes([*after, *held_out], since))
        moved = known.x.copy()
        for place, one in direct.items():  # other changes are estimated beside those that two columns show
            moved[place] += one.shift
        base, result = changes(replace(known, x=moved), rides, others, halves, nameless, cost)
        elsewhere = () if driven else (driven_elsewhere([*rides, *others], before),)
    result = [one for one in result if one.place not in direct]
    changed = _answer(
        model, possible, vehicle, known, base, result, rides, others or rides, after, held_out, since, direct
    )
    return replace(changed, gap=replace(changed.gap, doubts=(*changed.gap.doubts, *elsewhere)))


def visible_changes(
    model: Diagnosed,
    since: Sequence[Recording],
    effects: Mapping[str, Effect],
    *,
    vehicle: Vehicle | None,
    say: Callable[..., None] | None = None,
) -> tuple[Visible, ...]:
    """Detection limits of changes on one further recording like those from before.

    Parameters
    ----------
    model, since, effects, vehicle, say : as of `diagnose_change`.

    Raises
    ------
    BadInput : as of `diagnose_change`.
    """
    model, vehicle, read, possible = _begun(model, [], since, effects, vehicle)
    with threadpool_limits(1):
        full, numbers = numbers_of(model, possible, vehicle)
        rides = [FollowedRun.of(one, read, seconds_followed(model)) for one in since]
        known = usual(Follower(full, read), numbers, rides, say or (lambda line, **_: None), {})
        names = {effect.parameter.name: name for name, effect in possible.items()}
        units = {name: effect.parameter.unit for name, effect in possible.items()}
        return visible(known, rides, names, units, CAL.cost_changed)


def seconds_followed(model: MotionModel) -> float:
    """Longest part of a recording that is filtered, s: a filter of one state takes a ninth of one of three."""
    return CAL.followed * (3 // len(model.states)) ** 2


def _begun(
    model: Diagnosed,
    after: Sequence[Recording],
    since: Sequence[Recording],
    effects: Mapping[str, Effect],
    vehicle: Vehicle | None,
) -> tuple[MotionModel, Vehicle, tuple[str, ...], dict[str, Effect]]:
    """Model, vehicle, outputs that all recordings hold, and the effects that may have changed and act on these."""
    if not since:
        raise BadInput("Since when? Name recordings from before the change.")
    if vehicle is None:
        raise BadInput(f"No vehicle is stated for {model.name}: name a vehicle, or a fit.")
    if not isinstance(model, MotionModel) or model.learnt:
        raise BadInput(f"{model.name} holds a network's weights: changes are diagnosed for equations of motion only.")
    if twice := held_twice(after, since):
        raise BadInput(
            f"{twice[0]} is named as a recording from before the change, but it holds the same data as {twice[1]}, in "
            "which something may have changed. Name recordings from before the change."
        )
    read = _readings(model, [*after, *since])
    possible = {name: effect for name, effect in effects.items() if name in USUAL and acts(effect, model, read)}
    if not possible:
        raise BadInput(f"No effect that may change between runs acts on {model.name} and these recordings.")
    return model, vehicle, read, possible


def _readings(model: MotionModel, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Outputs that all recordings hold.

    Where v_y is read, accelerations are left out: they add nothing to its changes, and are often computed from it.
    """
    read = [name for name in model.outputs if all(name in one and np.any(np.isfinite(one[name])) for one in recordings)]
    if "v_y" in read:
        read = [name for name in read if name not in ("a_x", "a_y")]
    return tuple(read)


def filtered_alike(recordings: Sequence[Recording]) -> bool:
    """Whether recordings have passed similar filters, as far as their rates show.

    Slower ones have lost peaks, which looks like a sensor's gain.
    """
    steps = [one.sample_time for one in recordings if one.sample_time > 0]
    return not steps or max(steps) < CAL.rates * min(steps)


def _answer(
    model: MotionModel,
    possible: Mapping[str, Effect],
    vehicle: Vehicle,
    known: Common,
    base: RunExplained,
    result: Sequence[Change],
    rides: Sequence[FollowedRun],
    others: Sequence[FollowedRun],
    after: Sequence[Recording],
    held_out: Sequence[Recording],
    since: Sequence[Recording],
    direct: Mapping[int, ByColumns],
) -> Changed:
    """The answer from all estimates; `direct` are the changes that two columns show by themselves."""
    effects = {effect.parameter.name: name for name, effect in possible.items()}
    names = {place: effects[number.name] for place, number in enumerate(known.numbers) if number.name in effects}
    recordings = [tuple(one.name for one in part) for part in (after, held_out or after)]

    def closed(x: Array) -> list[Closure]:
        return [closure(known, ones, x, each) for ones, each in zip((rides, others), recordings, strict=True)]

    weights = np.array([exp(min(one.least, 300.0)) for one in result])
    sure = weights / (1.0 + np.sum(weights))
    first = result[0] if result and result[0].least > 0 else None
    alike = [names[one.place] for one in result[1:] if first is not None and first.least - one.least < CAL.alike]
    directly = known.x.copy()
    for place, by in direct.items():
        directly[place] += by.shift
    mean, reason, applied = directly.copy(), "", [*direct]
    if first is not None:
        mean[first.place] += first.shift[0]
    chosen, judged = closed(mean)
    if first is not None:
        each = known.numbers[first.place]
        if judged.closed_interval[0] <= 0:
            reason = "it does not improve predictions of held-out recordings"
        elif sure[0] <= CAL.present:
            beside = f"; {listed(alike)} would explain the recordings equally well" if alike else ""
            reason = f"its probability is {sure[0]:.2f}, not more than one half{beside}"
        elif not each.low < mean[first.place] < each.high:
            reason = "it is at its bound: a symptom of another cause, not an estimate"
        if reason:
            mean = directly
            chosen, judged = closed(mean)
        else:
            applied.append(first.place)

    def ranked(place: int, shift: float, sd: float, probability: float, gain: float, **more: Any) -> Ranked:
        """An effect with its magnitude."""
        number, unit = known.numbers[place], possible[names[place]].parameter.unit
        at = np.clip(known.x[place] + shift + 1.96 * sd * np.array([-1.0, 0.0, 1.0]), number.low, number.high)
        low, size, high = (number.value(each) for each in at)
        return Ranked(names[place], float(probability), size, unit, (low, high), gain=gain, **more)

    ranking = [ranked(place, by.shift, by.sd, by.probability, 0.5 * (by.shift / by.sd) ** 2)
               for place, by in direct.items()]  # fmt: skip
    for one, p in zip(result, sure, strict=True):
        why = reason if one is first else ""
        if one.beyond > CAL.reach_sd:
            why = "it is implausibly large: a symptom of another cause, not an estimate"
        sd = float(np.hypot(one.shift[1], known.scatter[one.place]))
        mates = tuple(alike) if one is first else ()
        ranking.append(ranked(one.place, one.shift[0], sd, p, one.total, indistinguishable_from=mates, reason=why))
    loud = loudness(known, rides, base)
    odds = CAL.unnamed_slope * log(loud / CAL.unnamed_share)
    unknown = 1 / (1 + exp(-max(min(odds, 30.0), -30.0)))
    channels = channels_of(known, rides)
    shows = bool(applied) or unknown > 0.5
    by_chance = len(known.varying) * exp(-max((one.total for one in result), default=0.0))
    gap = Gap(
        model=model.name,
        recordings=recordings[0],
        doubts=tuple(
            f"{one.name}: {finding.sentence}"
            for one in (*after, *since) for finding in check(one) if finding.severity is Severity.DISTRUST
        ),
        gap_detected=shows,
        # at most, by Markov's inequality: the mean of a ratio of evidences is one
        p_value=min([1.0, by_chance, *(1.0 - by.probability for by in direct.values())]),
        unknown_probability=unknown,
        unknown=f"readings are {number(loud, 2)} times as far from predictions as before" if unknown > 0.5 else "",
        where=Where(channel=max(channels, key=lambda name: channels[name]) if shows else "", channels=channels),
        ranking=tuple(ranking),
        applied=tuple(names[place] for place in applied),
        gap=chosen,
        held_out=judged if held_out else None,
        not_excited={},
        absorbed=(),
        advice=(),
        closed=_model_at(model, possible, known, mean),
        budget=budget_of(known, others, mean, applied, names, judged, bool(held_out)),
    )  # fmt: skip
    before, scatter = _before(vehicle, possible, known)
    return Changed(gap, before, scatter, tuple(one.name for one in since), drifting(known, effects, since),
                   _sds(known, [*rides, *others], effects, applied))  # fmt: skip


def _before(
    vehicle: Vehicle, possible: Mapping[str, Effect], known: Common
) -> tuple[Vehicle, dict[str, tuple[float, float]]]:
    """The vehicle as it was, as its recordings estimate it; effect -> its magnitude and scatter between runs."""
    values = values_of(known.numbers, known.x)
    sds = np.sqrt(np.diag(known.covariance))
    numbers = {n.name: (values[n.name], float(sd * (values[n.name] if n.logarithmic else 1.0)), float(s))
               for n, sd, s in zip(known.numbers, sds, known.scatter, strict=True)}  # fmt: skip
    scatter = {name: numbers[effect.parameter.name][::2] for name, effect in possible.items()}
    before = replace(
        vehicle,
        values={name: replace(one, value=numbers[name][0], sd=numbers[name][1]) if name in numbers else one
                for name, one in vehicle.values.items()},
        effects={**vehicle.effects, **{name: Stated(_within(possible[name], m),
                                                    s * (abs(m) if possible[name].parameter.array == 1.0 else 1.0))
                                       for name, (m, s) in scatter.items()}},
    )  # fmt: skip
    return before, scatter


def _sds(
    known: Common, rides: Sequence[FollowedRun], effects: Mapping[str, str], applied: Sequence[int]
) -> dict[str, float]:
    """Effect -> standard deviation of its change on these recordings, the scatter between runs included.

    All other numbers have their prior for a run, but those that changed are free. Infinite where it exceeds the usual
    size of changes.
    """
    L, V = np.sum([known.weigher.curve(ride, known.x).H for ride in rides], axis=0), known.of_a_run.copy()
    V[applied, applied] += np.array([known.numbers[place].change for place in applied]) ** 2
    result = dict[str, float]()
    for place in known.varying:
        number = known.numbers[place]
        wide = V.copy()
        wide[place, place] += number.change**2
        left = float(np.linalg.inv(np.linalg.inv(wide) + L)[place, place])
        alone = 1.0 / max(1.0 / left - 1.0 / wide[place, place], 1e-12)  # of the readings, without the prior
        sd = float(np.hypot(np.sqrt(alone), known.scatter[place]))
        result[effects[number.name]] = sd if sd < number.change else inf
    return result


def by_place(known: Common, possible: Mapping[str, Effect], columns: Sequence[ByColumns]) -> dict[int, ByColumns]:
    """Changes that two columns show, by the index of their number."""
    places = {number.name: place for place, number in enumerate(known.numbers)}
    return {places[possible[one.effect].parameter.name]: one for one in columns
            if one.effect in possible and possible[one.effect].parameter.name in places}  # fmt: skip


def _model_at(model: MotionModel, effects: Mapping[str, Effect], known: Common, x: Array) -> MotionModel:
    """The model with the vehicle's numbers at coordinates x."""
    values = values_of(known.numbers, x)
    result = model
    for name, effect in effects.items():
        value, null = _within(effect, values.pop(effect.parameter.name)), float(effect.parameter.array)
        if name in result.effects:
            result = result.with_parameters(result[effect.parameter.name].with_value(value))
        elif abs(value - null) > 1e-9:
            result = result + effect.at(value)
    return result.with_parameters(*(result[name].with_value(v) for name, v in values.items() if name in result))


def _within(effect: Effect, value: float) -> float:
    """A magnitude within an effect's bounds: a delay between clocks may be negative, that of a model may not."""
    low, high = (float(np.asarray(end)) for end in effect.parameter.bounds)
    return min(max(value, low), high)


def drifting(known: Common, effects: Mapping[str, str], since: Sequence[Recording]) -> tuple[str, ...]:
    """Sentences on numbers that drift over recordings from before, in their order, as with a draining battery."""
    runs = len(known.deviations)
    if runs < 3:
        return ()
    at = np.linspace(-0.5, 0.5, runs)
    stated = []
    for place in known.varying:
        deviation_sd = known.deviation_sds[:, place]
        deviations, weights = known.deviations[:, place], 1 / np.maximum(deviation_sd, 1e-12) ** 2
        about = at - np.sum(weights * at) / np.sum(weights)
        information = float(np.sum(weights * about**2))
        trend = float(np.sum(weights * about * deviations)) / information
        if abs(trend) * np.sqrt(information) > CAL.drifts and abs(trend) > 2 * known.numbers[place].usual:
            stated.append(
                f"{effects[known.numbers[place].name]} drifts from {since[0].name} to {since[-1].name}: the change "
                "may be that drift."
            )
    return tuple(stated)
