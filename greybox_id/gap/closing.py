"""How far a gap closes: errors before and after, over what noise alone would leave.

Stated tolerances are refitted in both, and what they cost is charged to both, so that a fitted nuisance never passes
for a gap that closed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..effect import Effect
from ..engine.simulation import Diagnosed, FreeRuns
from ..errors import BadInput
from ..estimation.axes import nuisances, shifting
from ..estimation.blocks import blocks
from ..estimation.calibration import CAL
from ..estimation.colour import sound, white_noise
from ..estimation.hypothesis import Hypothesis, by_cost
from ..estimation.preparing import excerpt, prepare_plain
from ..estimation.refit import refit, settled
from ..estimation.search import Search
from ..estimation.stated_noise import stated_noise
from ..estimation.variance import fresh
from ..recording import Recording
from ..scores.horizons import Errors, by_horizon, diverges
from ..shorthands import Array
from ..signals import unit_of
from ..statistics import correlation_time, resampled, robust_sd
from ..vehicle import Vehicle
from .gap import Closure


@dataclass(frozen=True)
class Misfit:
    """Errors of a model with its tolerances refitted.

    Attributes
    ----------
    e : (N, channels) prediction minus reading.
    charge : what the tolerances cost, twice their negative log-belief.
    trust : as how many readings one counted.
    values : parameter -> where the tolerances are.
    """

    e: Array
    charge: float
    trust: float = 1.0
    values: Mapping[str, float] = field(default_factory=dict)


def closure(
    before: Diagnosed,
    after: Diagnosed,
    recordings: Sequence[Recording],
    vehicle: Vehicle | None,
    effects: Mapping[str, Effect],
    horizons: bool = True,
    sd: Array | None = None,
    as_it_stands: Diagnosed | None = None,
) -> Closure:
    """How far a gap closes on recordings that chose nothing.

    Parameters
    ----------
    before, after : the model as stated, and with effects at their magnitudes.
    recordings : on which both are simulated.
    vehicle : what is stated: tolerances and sensor noise.
    effects : by name, for the vehicle's tolerances.
    horizons : whether errors over fixed horizons are wanted too.
    sd : (channels,) noise where none is stated; None takes what is faster than motion.
    as_it_stands : the model whose errors over horizons these are, with tolerances elsewhere; None takes `after`.
    """
    stands = as_it_stands or after
    there = {own.name: float(own.array) for own in stands.parameters if own.shape == ()}
    then, bench = refitted_tolerances(after, recordings, vehicle, effects, sd, there)
    first = then
    if after is not before:
        first, _ = refitted_tolerances(before, recordings, vehicle, effects, sd, {**there, **then.values}, then.trust)
    noise, told = stated_noise(bench, vehicle, then.e)
    sd = noise if told or sd is None else sd
    good = plain(then.e, fresh(bench), bench) & np.isfinite(first.e)
    names = tuple(recording.name for recording in recordings)
    found = closed_by(first, then, sd, good, bench, names)
    return replace(found, errors=by_horizon(before, stands, recordings, sd)) if horizons else found


def plain(e: Array, good: NDArray[np.bool_], bench: FreeRuns) -> NDArray[np.bool_]:
    """(N, channels) readings whose errors are neither outliers nor near to that: few of these are as much as a gap."""
    return sound(e, good, bench.rows, CAL.far_reading)


def refitted_tolerances(
    model: Diagnosed,
    recordings: Sequence[Recording],
    vehicle: Vehicle | None,
    effects: Mapping[str, Effect],
    sd: Array | None = None,
    there: Mapping[str, float] | None = None,
    trust: float | None = None,
) -> tuple[Misfit, FreeRuns]:
    """Errors of a model whose tolerances are refitted to recordings.

    Parameters
    ----------
    model, recordings, vehicle, effects, sd : as of `closure`.
    there : values of parameters; tolerances are refitted from there, too, and the better of both counts.
    trust : as how many readings one counts, as beside another model that this one is compared with; None: as many as
        what is left allows. Errors that noise does not explain are alike for a while: taken for noise, they would press
        every tolerance to where it reaches.
    """
    examined = excerpt(recordings)
    prepared = prepare_plain(model, examined, effects, vehicle)
    bench = prepared.bench(examined)
    own = nuisances(prepared.everything, effects, shifting(prepared.everything))
    start = np.where(bench.counted, bench.simulate(bench.model.values[None])[0] - bench.measured, 0.0)
    if not np.all(np.isfinite(start)):
        raise BadInput(f"{model.name} leaves the range of numbers on {recordings[0].name}.")
    noise, told = stated_noise(bench, vehicle, start)
    sd = noise if told or sd is None else sd
    good = sound(start, fresh(bench), bench.rows)
    search = Search(bench, own, white_noise(sd, good, bench.rows), CAL.trusts[0])
    search.about(None)
    starts = [search.at_means(), *([search.at_values(there)] if there and search.moving else [])]
    found, most = starts[0], 1.0
    for step in CAL.trusts if own else CAL.trusts[-1:]:
        search.trusting(min(step, most))
        tried = list[Hypothesis]()
        for begin in starts:
            search.about(begin)
            tried += [settled(search, each) for each in refit(search, [search.start_of(begin)])]
        if tried:  # none where derivatives leave the range of numbers
            found = min(tried, key=by_cost)
            starts, most = [found], _worth(found.e / sd, good) if trust is None else trust
    if not np.isfinite(found.cost):  # wherever it was refitted: as stated it is within the range
        return Misfit(start, 0.0), bench
    return replace(misfit(search, found), trust=search.trust, values=search.values(found)), bench


def _worth(e: Array, good: NDArray[np.bool_]) -> float:
    """As how many readings one counts: noise is new in each, what is beyond noise is alike for its correlation time."""
    if not np.any(good):
        return 1.0
    beyond = robust_sd(e[good]) ** 2 - 1.0  # spins are few, and not the rule
    return 1.0 / (1.0 + beyond * correlation_time(np.where(good, e, 0.0))) if beyond > 0 else 1.0


def misfit(search: Search, found: Hypothesis) -> Misfit:
    """What a hypothesis leaves."""
    return Misfit(found.e, search.charge(found))


def closed_by(
    before: Misfit, after: Misfit, sd: Array, good: NDArray[np.bool_], bench: FreeRuns, names: tuple[str, ...]
) -> Closure:
    """The closure that two misfits are.

    Parameters
    ----------
    before, after : on the same readings.
    sd : (channels,) of noise.
    good : (N, channels) readings that count.
    bench : whose recordings these are.
    names : of the recordings.
    """
    count = max(int(np.sum(good)), 1)
    first, then = (np.sum(np.where(good, own.e / sd, 0.0) ** 2, axis=1) for own in (before, after))
    rows = np.sum(good, axis=1)
    edges = blocks(bench)
    sums = np.array([[np.sum(first[a:b]), np.sum(then[a:b]), np.sum(rows[a:b])] for a, b in edges])
    charges = np.array([before.charge, after.charge])

    floor = min(1.0, (float(np.sum(then)) + charges[1]) / count)  # noise has no more than is left

    def share(total: Array) -> float:
        E0, E1 = (total[:2] + charges) / total[2]
        return float((E0 - E1) / max(E0 - floor, CAL.least_gap))

    low, high = resampled(sums, share, CAL.draws)
    E0, E1 = (float(np.sum(first)) + charges[0]) / count, (float(np.sum(then)) + charges[1]) / count
    closed = (E0 - E1) / max(E0 - floor, CAL.least_gap)
    return Closure(E0, E1, floor, closed, (float(low), float(high)), names, _errors(before, after, sd, good, bench))


def left_open(found: Closure) -> Closure:
    """What a closure is where nothing is applied: errors stay as they were."""
    errors = tuple(replace(own, after=own.before) for own in found.errors)
    return replace(
        found, after=found.before, floor=min(1.0, found.before), closed=0.0, closed_interval=(0.0, 0.0), errors=errors
    )


def _errors(before: Misfit, after: Misfit, sd: Array, good: NDArray[np.bool_], bench: FreeRuns) -> tuple[Errors, ...]:
    """Free-run errors per channel."""
    found = []
    for c, channel in enumerate(bench.channels):
        own = good[:, c]
        if np.any(own):
            free = ((each.e[own, c], diverges(each.e[own, c], bench.measured[own, c])) for each in (before, after))
            a, b = (np.inf if lost else float(np.sqrt(np.mean(e**2))) for e, lost in free)
            found.append(Errors(channel, unit_of(channel), None, a, b, float(sd[c])))
    return tuple(found)
