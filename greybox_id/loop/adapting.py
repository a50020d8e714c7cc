"""From rows to a policy: what the vehicle lacks is named, closed, and driven in simulation until that is mastered."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from ..api.diagnosing import diagnose
from ..errors import BadInput
from ..gap.closed_vehicle import NORMAL, closed_vehicle
from ..gap.gap import Gap
from ..models.registry import model_of
from ..motion_model import MotionModel
from ..parameter import Array
from ..racing.draws import Draws, nothing_drawn, of_posterior
from ..racing.learner import FINE_TUNING, Learned, learn, shipped_learned
from ..racing.world import Rules, World
from ..racing.worlds import STEER_MAX
from ..recording import Recording
from ..vehicle import Vehicle

ARMS = ("named", "nominal")
"""named: what `greybox gap` names is in the model that is learned on. nominal: the vehicle file alone."""
LANES = 64
DRAWN = 256
"""Draws of what was named, within its uncertainty."""
WIDEST = 3.0
"""Standard deviations that a draw may be off: beyond, nulls and limits of effects are crossed."""
SETTLED = 1.0
"""s after a start that count for no path error."""
TWIN_LAPS, TWIN_LANES, TWIN_SECONDS = 1.0, 8, 60.0
"""How much is driven in the twin to foretell, and for how long at most, s."""

WINDOW = 2.0
"""s over which a path error is watched while driving."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Adapted:
    """What came of rows.

    Attributes
    ----------
    learned : the policy, and what goes on from it.
    vehicle : with what closes the gap; the one that was stated where nothing was applied.
    model : that was learned on.
    detected : whether the simulation of the vehicle file deviates from the rows at all.
    named : what is held for the cause: effect, magnitude, unit, interval, probability.
    applied : effect -> magnitude, of those in the model.
    seconds : of the processor, by part: diagnosis, learning.
    """

    learned: Learned
    vehicle: Vehicle
    model: MotionModel
    detected: bool = False
    named: tuple[Mapping[str, Any], ...] = ()
    applied: Mapping[str, float] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Foretold:
    """How a policy drives in the twin.

    Attributes
    ----------
    path_error : root mean square of the lateral error, m.
    worst : the largest over `WINDOW`, m.
    crashes : vehicles of `TWIN_LANES` that crashed.
    lap_time : mean, s; NaN where not one drove a lap.
    """

    path_error: float
    worst: float
    crashes: int
    lap_time: float


def adapted(
    vehicle: Vehicle, recordings: Sequence[Recording], start: Learned, units: World, arm: str, *, steps: int,
    cap: float, seed: int = 0, say: Say = lambda sentence: None, stopped: Callable[[], bool] = lambda: False,
) -> Adapted:  # fmt: skip
    """Name what a vehicle lacks, and go on learning with it.

    Parameters
    ----------
    vehicle : what is stated of it.
    recordings : what it drove.
    start : what drives.
    units : the world of the vehicle as it is stated, whose units of observations and actions stay.
    arm : one of `ARMS`.
    steps : periods to be driven over all lanes.
    cap : share of the grip that the speed may use.
    seed, say, stopped : see `learner.learn`.

    Raises
    ------
    BadInput : there is no such arm, or rows cannot be diagnosed.
    """
    if arm not in ARMS:
        raise BadInput(f"There is no arm {arm!r}; there are {', '.join(ARMS)}.")
    found = Adapted(start, vehicle, stated_model(vehicle))
    began = time.process_time()
    if arm == "named":
        say("diagnosing")
        found = named(vehicle, recordings, start)
    diagnosed = time.process_time() - began
    say(f"learning with {', '.join(found.applied) or 'the vehicle file'}")
    drawn = randomised(found) if found.applied else nothing_drawn()
    world = world_of(found.model, vehicle, LANES, cap, like=units, draws=drawn)
    learned = learn(world, steps, start=start, seed=seed, settings=FINE_TUNING, say=say, stopped=stopped)
    seconds = {"diagnosis": diagnosed, "learning": time.process_time() - began - diagnosed}
    return replace(found, learned=learned, seconds=seconds)


def used_to(model: MotionModel, vehicle: Vehicle, steps: int, cap: float, seed: int) -> Learned:
    """The shipped driver, used to a vehicle as its file states it, in so many steps; `cap`: see `adapted`."""
    world = world_of(model, vehicle, LANES, cap, like=world_of(model, vehicle, 1, cap))
    return learn(world, steps, start=shipped_learned(), seed=seed, settings=FINE_TUNING)


def named(vehicle: Vehicle, recordings: Sequence[Recording], start: Learned) -> Adapted:
    """What `greybox gap` says of rows, and the model that closes the gap."""
    gap = diagnose(vehicle, list(recordings), vehicle=vehicle)
    if not gap.applied or not isinstance(gap.closed, MotionModel):
        return Adapted(start, vehicle, stated_model(vehicle), gap.gap_detected, causes(gap))
    applied = {name: float(gap.closed[name].array) for name in gap.applied}
    closed = closed_vehicle(vehicle, gap)
    return Adapted(start, closed, gap.closed, gap.gap_detected, causes(gap), applied)


def causes(gap: Gap) -> tuple[Mapping[str, Any], ...]:
    """What is held for the cause: applied effects, and others that are more likely there than not."""
    return tuple(
        {
            "effect": own.effect,
            "magnitude": own.magnitude,
            "unit": own.unit,
            "interval": list(own.interval),
            "probability": own.probability,
        }
        for own in gap.ranking
        if own.effect in gap.applied or own.probability > 0.5
    )


def randomised(found: Adapted) -> Draws:
    """Draws of what was applied, as uncertain as it is, so that what is learned does not hang on a number."""
    generator = np.random.default_rng(0)
    columns = {}
    for own in found.named:
        name = str(own["effect"])
        if name not in found.applied or found.model[name].shape != ():
            continue
        low, high = own["interval"]
        sd = (high - low) / (2 * NORMAL)
        off = np.clip(generator.standard_normal(DRAWN), -WIDEST, WIDEST) * (sd if np.isfinite(sd) else 0.0)
        low, high = (own_bound if own_bound is not None else np.nan for own_bound in found.model[name].bounds)
        columns[name] = np.fmax(np.fmin(found.applied[name] + off, high), low)
    return of_posterior(pd.DataFrame(columns), "what was applied") if columns else nothing_drawn()


def last_rows(recordings: list[Recording], rows: int) -> list[Recording]:
    """The last rows of recordings, so many at most."""
    kept, left = list[Recording](), rows
    for own in reversed(recordings):
        if left <= 1:
            break
        kept.append(own if len(own) <= left else own.rows(len(own) - left, len(own)))
        left -= len(own)
    return kept[::-1]


def stated_model(vehicle: Vehicle) -> MotionModel:
    """The model of a vehicle. Raises `BadInput` where it has one of another kind."""
    model = model_of(vehicle)
    if not isinstance(model, MotionModel):
        raise BadInput(f"{vehicle.name}: its model {model.name} is none of motion; name single_track.")
    return model


def world_of(
    model: MotionModel, vehicle: Vehicle, lanes: int, cap: float, *, like: World | None = None,
    draws: Draws | None = None, seconds: float = 30.0, noise: bool = True,
) -> World:  # fmt: skip
    """The world of a vehicle's model, driven at a share of the grip; `like`: see `World`."""
    rules = Rules(action="speed", reward="path", usage_cap=cap, noise=noise, seconds=seconds)
    sd = {"v_y": vehicle.noise.get("v_x", 0.0), **vehicle.noise}
    return World(model, lanes, rules, draws=draws, sd=sd, steer_max=vehicle.steer_max or STEER_MAX, like=like)


def foretold(
    model: MotionModel, vehicle: Vehicle, act: Callable[[Any], Array], units: World, cap: float,
    draws: Draws | None = None,
) -> Foretold:  # fmt: skip
    """Drive a lap in the twin, several vehicles from several places at once; the first second counts for no path error.

    Parameters
    ----------
    model, vehicle : the twin.
    act : what is seen becomes what is done.
    units, cap : as in `adapted`.
    draws : what of the twin is not known.
    """
    world = world_of(model, vehicle, TWIN_LANES, cap, like=units, draws=draws, seconds=TWIN_SECONDS)
    world.reset(np.ones(TWIN_LANES, dtype=bool), list(range(TWIN_LANES)))
    begun = world.told()["s"]
    going, crashed = np.ones(TWIN_LANES, dtype=bool), np.zeros(TWIN_LANES, dtype=bool)
    times = np.full(TWIN_LANES, np.nan)
    off = np.full((int(TWIN_SECONDS / world.rules.period), TWIN_LANES), np.nan)
    for k in range(len(off)):
        _, ended, cut = world.step(act(world.observe()), still=~going)
        told = world.told()
        crashed |= ended
        over = going & ~ended & (told["s"] - begun >= TWIN_LAPS * world.track.length)
        times[over] = (k + 1) * world.rules.period
        going &= ~(ended | cut | over)
        if not np.any(going):
            break
        if k * world.rules.period >= SETTLED:
            off[k, going] = told["e_y"][going]
    laps = times[np.isfinite(times)]
    crashes = int(np.sum(crashed | ~np.isfinite(times)))
    return Foretold(_rms(off), _worst(off, world.rules.period), crashes, float(np.mean(laps)) if len(laps) else np.nan)


def _rms(off: Array) -> float:
    kept = off[np.isfinite(off)]
    return float(np.sqrt(np.mean(kept**2))) if len(kept) else float("nan")


def _worst(off: Array, period: float) -> float:
    """The largest root mean square over a window, of any vehicle."""
    window, largest = int(WINDOW / period), float("nan")
    for own in off.T:
        kept = own[np.isfinite(own)]
        if len(kept) > window:
            sums = np.concatenate([[0.0], np.cumsum(kept**2)])
            largest = float(np.fmax(largest, np.sqrt(np.max(sums[window:] - sums[:-window]) / window)))
    return largest
