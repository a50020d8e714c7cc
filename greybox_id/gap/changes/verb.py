"""What changed between recordings of one vehicle: its own recordings from before define what is usual.

Recordings from before are explained together: by numbers of the vehicle, some of which may differ between runs (grip,
stiffnesses, steering ratio, offset, delay and lag) with a scatter that is estimated (`between_runs`). Model error that
is common to all of them is absorbed by the vehicle's numbers and by the distribution of innovations (`innovations`).
The recording from after is explained by the same; an effect is one of these numbers beyond its scatter (`search`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, log, sqrt
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ...base.errors import BadInput
from ...base.numbers import the_recordings
from ...datasets.checks import doubts
from ...datasets.recording import Recording, held_twice
from ...engine.simulation import Diagnosed
from ...models.effect import Effect
from ...models.motion_model import MotionModel
from ...models.parameter import Stated
from ...models.vehicle import Vehicle
from ..estimation.calibration import CAL
from ..gap import Gap
from .between_runs import Common, change_sds, values_of
from .columns import steering_changes
from .comparison import ChangeComparison, within
from .innovations import FollowedRun, Follower
from .search import ChangeSearch
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


@dataclass(frozen=True)
class Visible:
    """Detection limit of a change.

    Attributes
    ----------
    effect : name.
    size : least detectable distance from the usual value, in the effect's unit; relative where it is a factor. Infinite
        if larger than such changes are.
    scatter, told : its two parts, standard deviations: scatter between runs to which nothing is done, and uncertainty
        of the estimate from one recording.
    usual : of a factor, the mean of the runs; else its magnitude.
    factor : whether it is one.
    unit : of the effect.
    """

    effect: str
    size: float
    scatter: float
    told: float
    usual: float
    factor: bool
    unit: str


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
        unchanged, rides, others = (
            [FollowedRun.of(one, read, long) for one in part] for part in (since, after, held_out)
        )
        filtered = filtered_alike([*after, *held_out, *since])
        driven = driven_alike([*rides, *others], unchanged) > CAL.driven
        nameless = () if filtered and driven else GAINS
        known = usual(Follower(full, read), numbers, unchanged, tell, nameless)
        if not driven:  # model-form errors do not cancel
            known = replace(known, scatter=CAL.elsewhere * known.scatter)
        tell(f"estimating what has changed in {the_recordings([one.name for one in after])}")
        halves = () if others else tuple(zip(*(ride.halves() for ride in rides), strict=True))
        cost = CAL.cost_changed * (1.0 if driven else CAL.elsewhere)
        places = {number.name: place for place, number in enumerate(known.numbers)}
        by_columns = [one for one in steering_changes([*after, *held_out], since) if one.effect in possible]
        direct = {places[possible[one.effect].parameter.name]: one for one in by_columns}
        moved = known.x.copy()
        for place, one in direct.items():  # other changes are estimated beside those that two columns show
            moved[place] += one.shift
        shown = [known.numbers[place].name for place in direct]
        search = ChangeSearch(replace(known, x=moved), rides, others, halves, (*nameless, *shown), cost)
        elsewhere = () if driven else (driven_elsewhere([*rides, *others], unchanged),)
    names = tuple(one.name for one in after), tuple(one.name for one in held_out or after)
    compared = ChangeComparison(possible, known, rides, others or rides, names, unchanged, direct, search)
    gap = compared.answer(model, bool(held_out), (*doubts([*after, *since]), *elsewhere))
    before, scatter = _before(vehicle, possible, known)
    applied = [k for k, one in enumerate(known.numbers) if compared.effects.get(one.name) in gap.applied]
    sds = _sds(known, [*rides, *others], compared.effects, applied)
    return Changed(
        gap, before, scatter, tuple(one.name for one in since), drifting(known, compared.effects, since), sds
    )


def visible_changes(
    model: Diagnosed,
    since: Sequence[Recording],
    effects: Mapping[str, Effect],
    *,
    vehicle: Vehicle | None,
    say: Callable[..., None] | None = None,
) -> tuple[Visible, ...]:
    """Detection limits of changes on one further recording like those from before; all as of `diagnose_change`."""
    model, vehicle, read, possible = _begun(model, [], since, effects, vehicle)
    with threadpool_limits(1):
        full, numbers = numbers_of(model, possible, vehicle)
        rides = [FollowedRun.of(one, read, seconds_followed(model)) for one in since]
        known = usual(Follower(full, read), numbers, rides, say or (lambda line, **_: None))
        return visible(known, rides, possible)


def visible(known: Common, rides: Sequence[FollowedRun], possible: Mapping[str, Effect]) -> tuple[Visible, ...]:
    """Detection limits on one further recording like these, smallest share of a usual change first.

    A change of c sd gains c^2 / 2 nats, less Occam's factor for a prior as wide as changes are; it is detected from
    where that is what a change must gain (`search.Change`).

    Parameters
    ----------
    known : of the recordings from before.
    rides : these recordings, each of which stands for a further one.
    possible : effects that may change, by name.
    """
    names = {effect.parameter.name: name for name, effect in possible.items()}
    V = known.of_a_run
    sds = change_sds(np.median([known.weigher.curve(ride, known.x).H for ride in rides], axis=0), V)
    result = list[tuple[float, Visible]]()
    for place in known.varying:
        number, sd = known.numbers[place], float(sds[place])
        away = sd * sqrt(2.0 * (CAL.cost_changed + 0.5 * log(1.0 + (number.change / sd) ** 2)))
        size = away if away < CAL.reach_sd * number.change else inf
        alone, middle = sqrt(max(sd**2 - float(V[place, place]), 0.0)), number.value(known.x[place])
        name, scatter = names[number.name], float(known.scatter[place])
        unit = possible[name].parameter.unit
        limit = Visible(name, size, scatter, alone, middle, number.logarithmic, unit)
        result.append((size / number.change, limit))
    return tuple(limit for _, limit in sorted(result, key=lambda item: item[0]))


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
    read = tuple(name for name in model.outputs if all(_is_read(name, one) for one in (*after, *since)))
    if "v_y" in read:  # accelerations add nothing to its changes, and are often computed from it
        read = tuple(name for name in read if name not in ("a_x", "a_y"))
    possible = {name: effect for name, effect in effects.items() if name in USUAL and acts(effect, model, read)}
    if not possible:
        raise BadInput(f"No effect that may change between runs acts on {model.name} and these recordings.")
    return model, vehicle, read, possible


def _is_read(name: str, recording: Recording) -> bool:
    return name in recording and bool(np.any(np.isfinite(recording[name])))


def filtered_alike(recordings: Sequence[Recording]) -> bool:
    """Whether recordings have passed similar filters, as far as their rates show.

    Slower ones have lost peaks, which looks like a sensor's gain.
    """
    steps = [one.sample_time for one in recordings if one.sample_time > 0]
    return not steps or max(steps) < CAL.rates * min(steps)


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
        effects={**vehicle.effects, **{name: Stated(within(possible[name], m),
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
        if abs(trend) * np.sqrt(information) > CAL.tolerated_sd and abs(trend) > 2 * known.numbers[place].usual:
            stated.append(
                f"{effects[known.numbers[place].name]} drifts from {since[0].name} to {since[-1].name}: the change "
                "may be that drift."
            )
    return tuple(stated)
