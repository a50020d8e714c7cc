"""Recordings from after, compared with the vehicle as it was before: which changes are named, and why not others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb, exp, log, sqrt
from typing import Any

import numpy as np

from ...base.errors import BadInput
from ...base.numbers import listed, number
from ...base.shorthands import Array
from ...base.statistics import resampled
from ...models.effect import Effect
from ...models.motion_model import MotionModel
from ..budget import shapley_weights, with_intervals
from ..estimation.calibration import CAL
from ..estimation.free_runs import subsets
from ..gap import Budget, CauseClass, Closure, Gap, Ranked, Where
from .between_runs import Common, values_of
from .columns import ByColumns
from .innovations import FollowedRun
from .search import NONE, ChangeSearch, Places
from .usual import GAINS, LEVER_ARM


@dataclass(frozen=True)
class ChangeComparison:
    """Recordings from after, compared with the vehicle as it was before.

    Attributes
    ----------
    possible : effects that may have changed, by name.
    known : the vehicle as it was before.
    rides, others : recordings on which changes were chosen, and on which they were judged.
    names : of these recordings.
    since : recordings from before.
    direct : changes that two columns show by themselves, by the index of their number.
    search : sets of other changes.
    """

    possible: Mapping[str, Effect]
    known: Common
    rides: Sequence[FollowedRun]
    others: Sequence[FollowedRun]
    names: tuple[tuple[str, ...], tuple[str, ...]]
    since: Sequence[FollowedRun]
    direct: Mapping[int, ByColumns]
    search: ChangeSearch

    @cached_property
    def effects(self) -> dict[str, str]:
        """Effect of each number that may have changed."""
        return {effect.parameter.name: name for name, effect in self.possible.items()}

    def effect(self, place: int) -> str:
        """Name of the effect of a number."""
        return self.effects[self.known.numbers[place].name]

    def mean(self, places: Places) -> Array:
        """Coordinates of the vehicle as it was before, with the changes that two columns show and those of a set."""
        x = self.known.x + self.search.sizes(places)
        for place, by in self.direct.items():
            x[place] += by.shift
        return x

    @property
    def classes(self) -> tuple[CauseClass, ...]:
        """Of each change that is applied or doubted, those that explain the recordings about as well."""
        result = []
        for place in (*self.places, *self.doubted):
            members = (place, *self.search.alike(self._set_of(place), place))
            each = {self.effect(one): self.search.probability(one) for one in members}
            names = tuple(sorted(each, key=lambda name: -each[name]))
            applied = self.effect(place) if place in self.places else ""
            result.append(CauseClass(names, self.search.probability(*members), each, applied))
        return tuple(sorted(result, key=lambda one: -one.probability))

    def _set_of(self, place: int) -> Places:
        """The set in which a change is shown."""
        if place in self.places:
            return self.places
        return self.doubted[place][0] if place in self.doubted else self.search.likeliest(place)

    @cached_property
    def _judged(self) -> tuple[Places, dict[int, tuple[Places, str]]]:
        places, doubted = self.search.best(), dict[int, tuple[Places, str]]()
        while doubts := {place: reason for place in places if (reason := self._doubt(places, place))}:
            worst = min(doubts, key=lambda place: self.search.change(places, place).least)
            doubted[worst] = places, doubts[worst]
            places = self.search.best(places - {worst})
        return places, doubted

    @property
    def places(self) -> Places:
        """The changes that are applied, beside those that two columns show."""
        return self._judged[0]

    @property
    def doubted(self) -> Mapping[int, tuple[Places, str]]:
        """Changes that gain what they must and are not applied: in which set, and why."""
        return self._judged[1]

    def _doubt(self, places: Places, place: int) -> str:
        """Why a change is not applied, although it gains what it must; "" if it is."""
        one, mean, members = self.known.numbers[place], self.mean(places), self.search.alike(places, place)
        if self._closure(self.others, self.names[1], self.mean(places - {place}), mean).closed <= 0:
            return "it does not improve predictions of held-out recordings"
        if (
            probability := self.search.probability(place, *members)
        ) <= CAL.present:  # the best of a class stands for it
            what = f"the probability of one of {listed([self.effect(it) for it in (place, *members)])}"
            return f"{what if members else 'its probability'} is {probability:.2f}, not more than one half"
        if not one.low < mean[place] < one.high:
            return "it is at its bound: a symptom of another cause, not an estimate"
        return ""

    def ranking(self, louder: float = 1.0) -> tuple[Ranked, ...]:
        """Changes that two columns show, those that are applied, then others that were tried.

        Parameters
        ----------
        louder : how much larger errors are than before; if larger, sizes are less certain by as much (Birge, Physical
            Review 40, 1932).
        """
        result = [self._ranked(place, by.shift, by.sd, by.probability, 0.5 * (by.shift / by.sd) ** 2)
                  for place, by in self.direct.items()]  # fmt: skip
        first = sorted(self.places, key=lambda place: -self.search.change(self.places, place).total)
        for place in (*first, *(place for place in self.search.tried if place not in first)):
            places, why = self._set_of(place), self.doubted.get(place, (NONE, ""))[1]
            one = self.search.change(places, place)
            if one.beyond > CAL.reach_sd:
                why = "it is implausibly large: a symptom of another cause, not an estimate"
            sd = max(louder, 1.0) * float(np.hypot(one.sd, self.known.scatter[place]))
            size = float(self.search.sizes(places)[place])
            sd = float(np.hypot(sd, self._form(place) * size))
            mates = self.search.alike(places, place) if place in self.places or place in self.doubted else ()
            alike, p = tuple(self.effect(mate) for mate in mates), self.search.probability(place)
            result.append(self._ranked(place, size, sd, p, one.total, indistinguishable_from=alike, reason=why))
        return tuple(result)

    def _form(self, place: int) -> float:
        """Standard deviation of a change that is due to inexact equations, relative.

        How far a sensor is mounted away shows by what the yaw rate adds: if the equations need a gain of the gyro that
        no gyro has, one of them is off by as much.
        """
        form = CAL.form_of_size
        if self.known.numbers[place].name == LEVER_ARM:
            gains = [abs(float(self.known.x[k])) for k, one in enumerate(self.known.numbers) if one.name in GAINS]
            form = max(form, *gains) if gains else form
        return form

    def _ranked(self, place: int, shift: float, sd: float, probability: float, gain: float, **more: Any) -> Ranked:
        """An effect with its magnitude."""
        number, name = self.known.numbers[place], self.effect(place)
        at = np.clip(self.known.x[place] + shift + 1.96 * sd * np.array([-1.0, 0.0, 1.0]), number.low, number.high)
        low, size, high = (number.value(each) for each in at)
        unit = self.possible[name].parameter.unit
        return Ranked(name, float(probability), size, unit, (low, high), gain=gain, **more)

    def by_chance(self) -> float:
        """How often an unchanged vehicle would show as much, at most: the mean of a ratio of evidences is one."""
        n = len(self.known.varying)
        each = (log(comb(n, len(places))) - self.search.total(places) for places in self.search.sets if places)
        return min([1.0, *(exp(min(one, 0.0)) for one in each), *(1.0 - by.probability for by in self.direct.values())])

    def left_over(self, mean: Array) -> float:
        """How much larger errors are than before: explained within scatter, or by what changed and no scatter at all.

        For the former, innovations count by their scales: mean over channels, median over recordings. For the latter,
        two recordings from before must show how much larger errors are between runs.
        """
        known, unchanged = self.known, self.search.sets[NONE].explained.x
        innovations = [item for ride in self.rides for item in known.weigher.innovations(ride, unchanged)]
        scales = [known.weigher.noise.scales(item) for item in innovations if item is not None]
        base = float(np.median(np.mean(scales, axis=1))) if scales else 1.0
        if len(self.since) < 2:
            return base
        (after, count), (before, its_count) = (
            np.sum(self._squares(rides, x), axis=0) for rides, x in ((self.others, mean), (self.since, known.x))
        )
        return max(base, sqrt((after / count) / (before / its_count)))

    def _channels(self) -> dict[str, float]:
        """Channel -> root mean square of innovations over their predicted size, with the numbers from before."""
        read = self.known.weigher.follower.read
        squares, count = np.zeros(len(read)), np.zeros(len(read))
        for ride in self.rides:
            (innovations,) = self.known.weigher.innovations(ride, self.known.x)
            if innovations is not None:
                squares += np.sum((innovations.white**2).reshape(-1, len(read)), axis=0)
                count += np.sum(innovations.there.reshape(-1, len(read)), axis=0)
        return dict(zip(read, np.sqrt(squares / np.maximum(count, 1.0)).tolist(), strict=True))

    def answer(self, model: MotionModel, held_out: bool, doubts: tuple[str, ...]) -> Gap:
        """The gap to the vehicle as it was before."""
        mean = self.mean(self.places)
        both = zip((self.rides, self.others), self.names, strict=True)
        chosen, judged = (self._closure(rides, names, self.known.x, mean) for rides, names in both)
        loud = self.left_over(mean)
        odds = CAL.unnamed_slope * log(loud / CAL.unnamed_share)
        unknown = 1 / (1 + exp(-max(min(odds, 30.0), -30.0)))
        channels, ranking = self._channels(), self.ranking(loud)
        applied = {place: self.effect(place) for place in (*self.direct, *self.places)}
        order = [one.effect for one in ranking if one.effect in applied.values()]
        applied = dict(sorted(applied.items(), key=lambda item: order.index(item[1])))
        shows = bool(applied) or unknown > 0.5
        return Gap(
            model=model.name,
            recordings=self.names[0],
            doubts=doubts,
            gap_detected=shows,
            p_value=min(self.by_chance(), 1.0 - unknown) if shows else self.by_chance(),
            unknown_probability=unknown,
            unknown=f"readings are {number(loud, 2)} times as far from predictions as before" if unknown > 0.5 else "",
            where=Where(channel=max(channels, key=lambda name: channels[name]) if shows else "", channels=channels),
            ranking=ranking,
            applied=tuple(applied.values()),
            gap=chosen,
            held_out=judged if held_out else None,
            not_excited={},
            absorbed=(),
            advice=(),
            closed=self._model_at(model, mean),
            classes=self.classes,
            budget=self._budget(mean, applied, held_out) if applied else None,
        )

    def _closure(self, rides: Sequence[FollowedRun], names: tuple[str, ...], first: Array, then: Array) -> Closure:
        """How far errors close from the vehicle's numbers `first` to other ones."""
        sums = self._squares(rides, first, then)
        total = np.sum(sums, axis=0)
        before, after = (float(item) for item in total[:2] / total[2])

        def share(total: Array) -> float:
            before, after = total[:2] / total[2]
            return float((before - after) / max(before - min(1.0, before, after), CAL.least_gap))

        low, high = (float(end) for end in resampled(sums, share, CAL.draws))
        return Closure(before, after, min(1.0, before, after), share(total), (low, high), names)

    def _budget(self, mean: Array, applied: Mapping[int, str], held_out: bool) -> Budget:
        """Shares of the applied effects (by index of their number) by Shapley; the rest of the gap is unexplained."""
        x, effects = self.known.x, tuple(applied.values())
        weights = shapley_weights(effects)
        means = [np.where([applied.get(k) in some for k in range(len(x))], mean, x) for some in subsets(effects)]

        def shares(total: Array) -> Array:
            E = total[:-1] / total[-1]
            excess = max(E[0] - min(1.0, E[0], E[-1]), CAL.least_gap)
            E[1:-1] = np.minimum(E[1:-1], max(E[0], E[-1]))  # sets that lose the vehicle explain nothing
            return np.asarray(np.append(weights @ E, excess - E[0] + E[-1]) / excess)

        *result, rest = with_intervals((*effects, "unexplained"), self._squares(self.others, *means), shares)
        return Budget(tuple(result), rest, self.names[1], held_out)

    def _squares(self, rides: Sequence[FollowedRun], *means: Array) -> Array:
        """(blocks, means + 1) sums of squared innovations with each of several coordinates, and numbers of readings."""
        weigher, result = self.known.weigher, list[Array]()
        ones = np.ones(weigher.noise.channels)
        for ride in rides:
            several = weigher.innovations(ride, *means)
            there = [one for one in several if one is not None]
            if len(there) < len(several):
                raise BadInput(f"The filter diverges on {ride.recording.name}: is this the right vehicle?")
            squares = [np.sum(weigher.noise.white(one, ones) ** 2, axis=1) for one in there]
            result.append(np.stack([*squares, np.sum(there[0].there, axis=1)], axis=1))
        return np.concatenate(result)

    def _model_at(self, model: MotionModel, x: Array) -> MotionModel:
        """The model with the vehicle's numbers at coordinates x."""
        values = values_of(self.known.numbers, x)
        result = model
        for name, effect in self.possible.items():
            value, null = within(effect, values.pop(effect.parameter.name)), float(effect.parameter.array)
            if name in result.effects:
                result = result.with_parameters(result[effect.parameter.name].with_value(value))
            elif abs(value - null) > 1e-9:
                result = result + effect.at(value)
        return result.with_parameters(*(result[name].with_value(v) for name, v in values.items() if name in result))


def within(effect: Effect, value: float) -> float:
    """A magnitude within an effect's bounds: a delay between clocks may be negative, that of a model may not."""
    low, high = (float(np.asarray(end)) for end in effect.parameter.bounds)
    return min(max(value, low), high)
