"""From rows to a policy: a model of the vehicle is made of them, and driven in simulation until that is mastered."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from greybox_id.base.shorthands import Array, Say
from greybox_id.datasets.recording import Recording
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.vehicle import Vehicle

from ..racing.draws import Draws
from ..racing.learner import FINE_TUNING, Learned, learn, shipped_learned
from ..racing.rules import Rules
from ..racing.world import World
from ..racing.worlds import STEER_MAX
from .arms import Twin, twin

LANES = 64
FOLLOW = 100.0
"""Of `Rules`: drivers come to a hundredth of the half width of the path, where 10 asks for a tenth and a path error of
2 cm costs less than noise does."""
SETTLED = 1.0
"""s after a start that count for no path error."""
TWIN_LAPS, TWIN_LANES, TWIN_SECONDS = 1.0, 8, 60.0
"""How much is driven in the twin to foretell, and for how long at most, s."""

WINDOW = 2.0
"""s over which a path error is watched while driving."""


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
) -> tuple[Learned, Twin, dict[str, float]]:  # fmt: skip
    """Make a model of what a vehicle drove, and go on learning in it.

    Parameters
    ----------
    vehicle : what is stated of it.
    recordings : what it drove.
    start : what drives.
    units : the world of the vehicle as it is stated, whose units of observations and actions stay.
    arm : one of `protocol.ARMS`.
    steps : periods to be driven over all lanes.
    cap : share of the grip that the speed may use.
    seed, say, stopped : see `learner.learn`.

    Returns
    -------
    The policy and what goes on from it, what it was learned on, and s of the processor by part: diagnosis, learning.

    Raises
    ------
    BadInput : there is no such arm, or rows do not hold what it needs.
    """
    began = time.process_time()
    say(f"making a model of {sum(len(recording) for recording in recordings)} rows")
    result = twin(arm, vehicle, recordings, seed)
    modelled = time.process_time() - began
    say(f"learning with {', '.join(result.applied) or arm}")
    learned = learned_on(result, vehicle, start, units, steps=steps, cap=cap, seed=seed, say=say, stopped=stopped)
    return learned, result, {"diagnosis": modelled, "learning": time.process_time() - began - modelled}


def learned_on(
    twin: Twin, vehicle: Vehicle, start: Learned, units: World, *, steps: int, cap: float, seed: int = 0,
    usage: tuple[float, float] | None = None, say: Say = lambda sentence: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Learned:  # fmt: skip
    """Go on learning in a twin; parameters as of `adapted`, and shares of the grip that are asked for, see `Rules`."""
    world = world_of(twin.model, vehicle, LANES, cap, like=units, draws=twin.draws, usage=usage)
    return learn(world, steps, start=start, seed=seed, settings=FINE_TUNING, say=say, stopped=stopped)


def used_to(model: MotionModel, vehicle: Vehicle, steps: int, cap: float, seed: int) -> Learned:
    """The shipped driver, used to a vehicle as its file states it, in so many steps; `cap`: see `adapted`."""
    world = world_of(model, vehicle, LANES, cap, like=world_of(model, vehicle, 1, cap))
    return learn(world, steps, start=shipped_learned(), seed=seed, settings=FINE_TUNING)


def last_rows(recordings: list[Recording], rows: int) -> list[Recording]:
    """The last rows of recordings, so many at most."""
    kept, left = list[Recording](), rows
    for recording in reversed(recordings):
        if left <= 1:
            break
        kept.append(recording if len(recording) <= left else recording.rows(len(recording) - left, len(recording)))
        left -= len(recording)
    return kept[::-1]


def world_of(
    model: MotionModel, vehicle: Vehicle, lanes: int, cap: float, *, like: World | None = None,
    draws: Draws | None = None, seconds: float = 30.0, usage: float | tuple[float, float] | None = None,
) -> World:  # fmt: skip
    """The world of a vehicle's model, driven at a share of the grip; `like`: see `World`, `usage`: see `Rules`."""
    rules = Rules(action="speed", reward="path", follow=FOLLOW, usage_cap=cap, usage=usage, noise=True, seconds=seconds)
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
    begun = world.situation()["s"]
    going, crashed = np.ones(TWIN_LANES, dtype=bool), np.zeros(TWIN_LANES, dtype=bool)
    times = np.full(TWIN_LANES, np.nan)
    off = np.full((int(TWIN_SECONDS / world.rules.period), TWIN_LANES), np.nan)
    for k in range(len(off)):
        _, ended, cut = world.step(act(world.observe()), still=~going)
        progress = world.situation()
        crashed |= ended
        over = going & ~ended & (progress["s"] - begun >= TWIN_LAPS * world.track.length)
        times[over] = (k + 1) * world.rules.period
        going &= ~(ended | cut | over)
        if not np.any(going):
            break
        if k * world.rules.period >= SETTLED:
            off[k, going] = progress["e_y"][going]
    laps = times[np.isfinite(times)]
    crashes = int(np.sum(crashed | ~np.isfinite(times)))
    return Foretold(_rms(off), _worst(off, world.rules.period), crashes, float(np.mean(laps)) if len(laps) else np.nan)


def _rms(off: Array) -> float:
    kept = off[np.isfinite(off)]
    return float(np.sqrt(np.mean(kept**2))) if len(kept) else float("nan")


def _worst(off: Array, period: float) -> float:
    """The largest root mean square over a window, of any vehicle."""
    window, largest = int(WINDOW / period), float("nan")
    for lane in off.T:
        kept = lane[np.isfinite(lane)]
        if len(kept) > window:
            sums = np.concatenate([[0.0], np.cumsum(kept**2)])
            largest = float(np.fmax(largest, np.sqrt(np.max(sums[window:] - sums[:-window]) / window)))
    return largest
