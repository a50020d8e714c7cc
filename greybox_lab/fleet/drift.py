"""Which vehicle left where it was: a parameter that rises or falls along its recordings, jumps between two, or wanders.

A vehicle's recordings, in the order of their odometer or time, are those of `hierarchy` with one more unknown: the
change of one parameter, along x from 0 to 1 (slope), at once (step), or by increments at random (walk), see `changes`.
Over the fleet vehicles are found at a false discovery rate (Benjamini & Hochberg, Controlling the false discovery rate,
JRSS B 57 (1995)); changes found are taken out before T and W are estimated again, which they would else inflate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from greybox_id.base.shorthands import Array

from .changes import WALK, VehicleChange, changes_of, dismissed, shows, together
from .hierarchy import Informed, Population, marginal, population, scattered
from .joined import Flags, FleetDistances, distances, spared, strangers

RATE = 0.05
"""False discovery rate."""
LEAST = 4
"""Recordings below which a change cannot be distinguished from scatter: two on either side of a step."""
ROUNDS = 4
"""How often changes are taken out and T and W estimated again."""
Order = Sequence[np.ndarray[tuple[int], np.dtype[np.int64]]]


@dataclass(frozen=True)
class Drifted:
    """A fleet with its changes.

    Attributes
    ----------
    population : without what changed: vehicles where their series begin.
    changes : the likeliest change of every parameter of every vehicle that has enough recordings.
    today, covariance : (vehicles, parameters) and (vehicles, parameters, parameters) where series end.
    apart : (recordings,) which are set apart.
    distances : of recordings from their vehicles.
    """

    population: Population
    changes: tuple[VehicleChange, ...]
    today: Array
    covariance: Array
    apart: Flags
    distances: FleetDistances


def drifted(seen: Informed, order: Order, x: Sequence[Array], doubted: Flags | None = None) -> Drifted:
    """Find what changed, and which recordings lie apart.

    Parameters
    ----------
    seen : what recordings say.
    order : per vehicle, its recordings' numbers in the order in which they were driven.
    x : per vehicle, from 0 to 1 along that order.
    doubted : recordings that count less the further they lie from their vehicle.
    """
    count, size = seen.vector.shape
    doubts = np.zeros(count, dtype=bool) if doubted is None else doubted
    apart, weight, softly = strangers(seen), np.ones(count), np.ones(count)
    taken: dict[int, list[VehicleChange]] = {}
    result: Population | None = None
    kept: frozenset[tuple[int, int, str, int]] = frozenset()
    for turn in range(ROUNDS):
        part = weight * ~apart
        result = population(_without(seen, taken, order).weighted(part), result)
        both = scattered(seen, result.scatter)
        far = _far(seen, both, result, order, x, taken, (part, softly))
        softly = np.where(apart | doubts, far.weights(size), 1.0)
        changes = _all(softly, both, result, order, x)
        taken = _refined(changes, softly, both, result, order, x)
        far = _far(seen, both, result, order, x, taken, (part, softly))
        now = frozenset(
            (change.vehicle, change.parameter, change.kind, change.at) for change in changes if change.drifts
        )
        was, apart = apart, spared(seen, far.apart())
        weight = np.where(doubts, far.weights(size), 1.0)
        if now == kept and np.array_equal(was, apart) and (turn or not (now or doubts.any())):
            break
        kept = now
    assert result is not None
    part = np.where(apart, softly, weight)  # for vehicles that changed: what shows a change is not left out
    information, vector = both[0] * part[:, None, None], both[1] * part[:, None]
    today, covariance = result.vehicle.copy(), result.covariance.copy()
    by_place = {(change.vehicle, change.parameter): change for change in changes}
    for vehicle, of in taken.items():
        rows = order[vehicle]
        end = together(information[rows], vector[rows], result, x[vehicle], of)
        today[vehicle], covariance[vehicle] = end.mean[-1], end.covariance[-1] + result.unsure[vehicle]
        by_place |= {(vehicle, change.parameter): change for change in end.changes}
    return Drifted(result, tuple(by_place.values()), today, covariance, apart, far)


def _without(seen: Informed, taken: dict[int, list[VehicleChange]], order: Order) -> Informed:
    """What recordings say of the vehicle before it changed.

    A walk is not taken out as it was estimated, which would take scatter with it: recordings are as good as unknown in
    that parameter, by the variance of the walk.
    """
    information, vector = seen.information.copy(), seen.vector.copy()
    for vehicle, changes in taken.items():
        rows = order[vehicle]
        for change in changes:
            tied = information[rows][:, :, change.parameter]
            if change.kind == WALK:
                share = change.wander / (1.0 + change.wander * tied[:, change.parameter])
                vector[rows] -= tied * (share * vector[rows, change.parameter])[:, None]
                information[rows] -= share[:, None, None] * tied[:, :, None] * tied[:, None, :]
            else:
                vector[rows] -= tied * change.moved[:, None]
    return replace(seen, information=information, vector=vector)


def _far(
    seen: Informed, both: tuple[Array, Array], population: Population, order: Order, x: Sequence[Array],
    taken: dict[int, list[VehicleChange]], weights: tuple[Array, Array],
) -> FleetDistances:  # fmt: skip
    """How far recordings lie from where their vehicles are by then.

    Vehicles that changed are where all of their recordings have them, by their soft weights: what lies apart from where
    a vehicle was may be what shows that it changed.
    """
    weight = weights[0].copy()
    at, covariance = population.vehicle[seen.vehicle], population.covariance[seen.vehicle]
    for vehicle, changes in taken.items():
        rows = order[vehicle]
        weight[rows] = part = weights[1][rows]
        joint = together(
            both[0][rows] * part[:, None, None], both[1][rows] * part[:, None], population, x[vehicle], changes
        )
        at[rows], covariance[rows] = joint.mean, joint.covariance
    return distances(seen, both, at, covariance, weight)


def _refined(
    changes: Sequence[VehicleChange], weight: Array, both: tuple[Array, Array], population: Population, order: Order,
    x: Sequence[Array],
) -> dict[int, list[VehicleChange]]:  # fmt: skip
    """The changes that were found, by vehicle, those of one vehicle estimated together."""
    taken: dict[int, list[VehicleChange]] = {}
    for change in changes:
        if change.drifts:
            taken.setdefault(change.vehicle, []).append(change)
    for vehicle, of in taken.items():
        rows = order[vehicle]
        part = weight[rows]
        taken[vehicle] = together(
            both[0][rows] * part[:, None, None], both[1][rows] * part[:, None], population, x[vehicle], of
        ).changes
    return taken


def _all(
    weight: Array, both: tuple[Array, Array], population: Population, order: Order, x: Sequence[Array]
) -> list[VehicleChange]:  # fmt: skip
    """The changes of all vehicles; those found at the rate are taken out before the vehicle's others are looked for."""
    information, vector = both[0] * weight[:, None, None], both[1] * weight[:, None]
    size = len(population.mean)
    dof = float(max(1, len(vector) - len(order)))  # with which the scatter of recordings is known
    series = [vehicle for vehicle in range(len(order)) if len(order[vehicle]) >= LEAST]
    alone = marginal(Informed(information, vector, np.zeros(len(vector), dtype=np.int64), 1))
    taken: dict[int, list[VehicleChange]] = {vehicle: [] for vehicle in series}
    best: dict[int, list[VehicleChange]] = {}
    active = list(series)
    for _ in range(size):
        for vehicle in active:
            rows = order[vehicle]
            best[vehicle] = [
                each if shows(each, alone[0][rows], alone[1][rows]) else dismissed(each)
                for each in changes_of(
                    vehicle, information[rows], vector[rows], population, x[vehicle], taken[vehicle], dof
                )
            ]
        firsts = {vehicle: min(best[vehicle], key=lambda each: each.p) for vehicle in active if best[vehicle]}
        hits = _discovered([first.p for first in firsts.values()])
        active = [first for first, hit in zip(firsts, hits, strict=True) if hit]
        for vehicle in active:
            taken[vehicle].append(replace(firsts[vehicle], drifts=True))
        if not active:
            break
    changes: list[VehicleChange] = []
    for vehicle in series:
        done = {each.parameter for each in taken[vehicle]}
        changes += [*taken[vehicle], *(each for each in best.get(vehicle, ()) if each.parameter not in done)]
    return changes


def _discovered(p: Sequence[float]) -> list[bool]:
    """Which of several hypotheses are rejected at the false discovery rate."""
    from scipy.stats import false_discovery_control

    return [bool(adjusted <= RATE) for adjusted in false_discovery_control(p)] if p else []
