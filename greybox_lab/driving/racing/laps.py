"""Laps that a policy drives, and how well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.json_data import attributes
from greybox_id.base.shorthands import Array

from .world import Observations, World

RUN_IN = 0.25
"""Of a lap, driven before one is timed: vehicles begin at half the speed of the track or more."""
TOO_SLOW = 5.0
"""Times the lap time of the speed on the track after which a lap is given up."""


class Actor(Protocol):
    """What drives; `racing.policy.Policy` does."""

    def act(self, seen: Observations) -> Array:
        """(L, 2) what drivers do who see (L, size)."""


@dataclass(frozen=True)
class Laps:
    """Laps that were tried.

    Attributes
    ----------
    tried : how many.
    lap_times : s, of those that were driven to their end, (n,).
    crashes : how many ended off the track, in a spin or at a halt.
    given_up : how many took more than `TOO_SLOW` times as long as they should.
    path_error_rms, path_error_p95 : m, root mean square and 95 % quantile of |e_y|; NaN without a period of it.
    steering_rate_rms : rad/s, of the commands.
    speed : m/s, mean.
    """

    tried: int
    lap_times: Array
    crashes: int
    given_up: int
    path_error_rms: float
    path_error_p95: float
    steering_rate_rms: float
    speed: float

    @property
    def lap_time(self) -> float:
        """s, mean of the laps driven; NaN without any."""
        return float(np.mean(self.lap_times)) if len(self.lap_times) else float("nan")

    def plain(self) -> dict[str, float | int]:
        """As plain data; the lap time is the mean."""
        driven = ("path_error_rms", "path_error_p95", "steering_rate_rms", "speed")
        return {
            "tried": self.tried,
            "driven": len(self.lap_times),
            **attributes(self, "crashes", "given_up", "lap_time", *driven),
        }


def drive(world: World, policy: Actor, laps: int, *, seed: int = 0) -> Laps:
    """Let a policy drive laps, spread over the lanes of a world.

    A lap begins a quarter of one after the start; who crashes, then or before, has lost it and begins anew. That the
    world cuts episodes off does not matter here.

    Parameters
    ----------
    world : where; it begins anew.
    policy : what drives, by what is most probable.
    laps : how many are tried, over all lanes.
    seed : lane k draws from seed + k.

    Raises
    ------
    BadInput : no lap is asked for.
    """
    if not laps > 0:
        raise BadInput(f"laps: a number above zero is needed, not {laps!r}.")
    lanes, track, T = len(world.lanes), world.track, world.rules.period
    longest = (
        (1.0 + RUN_IN) * TOO_SLOW * track.length * float(np.mean(1.0 / np.minimum(track.speed, world.rules.speed_cap)))
    )
    left = laps // lanes + (np.arange(lanes) < laps % lanes)
    world.reset(np.ones(lanes, dtype=bool), [seed + k for k in range(lanes)])
    line, since = world.situation()["s"] + RUN_IN * track.length, np.full(lanes, np.nan)
    now, tried_for = np.zeros(lanes), np.zeros(lanes)
    times, crashes, given_up, last = [], 0, 0, np.full(lanes, np.nan)
    errors, rates, speeds = [], [], []
    while np.any(left > 0):
        resting, before = left <= 0, world.situation()["s"]
        actions = np.clip(policy.act(world.observe()), -1.0, 1.0)
        _, ended, _ = world.step(actions, still=resting)
        progress, timed = world.situation(), ~resting & ~np.isnan(since) & ~ended
        now, tried_for = now + T, tried_for + T
        errors.append(progress["e_y"][timed])
        rates.append((actions[:, 0] - last)[timed] * world.steer_max / T)
        speeds.append((progress["s"] - before)[timed] / T)
        last = actions[:, 0]
        over = ~resting & ~ended & (progress["s"] >= line)
        crossed = now - T * (progress["s"] - line) / np.maximum(progress["s"] - before, 1e-9)
        times += (crossed - since)[over & timed].tolist()
        left = left - (over & timed)
        since, tried_for = np.where(over, crossed, since), np.where(over, 0.0, tried_for)
        line = np.where(over, line + track.length, line)
        slow = ~resting & ~ended & (tried_for > longest)
        crashes, given_up = crashes + int(np.sum(ended)), given_up + int(np.sum(slow))
        lost = ended | slow
        if np.any(lost):
            left = left - lost
            world.reset(lost)
            line = np.where(lost, world.situation()["s"] + RUN_IN * track.length, line)
            since, last = np.where(lost, np.nan, since), np.where(lost, np.nan, last)
            tried_for = np.where(lost, 0.0, tried_for)
    e_y, steering, speed = np.abs(np.concatenate(errors)), np.concatenate(rates), np.concatenate(speeds)
    steering = steering[np.isfinite(steering)]
    if not len(e_y):
        e_y = speed = steering = np.array([np.nan])
    return Laps(
        laps, np.array(times), crashes, given_up, float(np.sqrt(np.mean(e_y**2))), float(np.quantile(e_y, 0.95)),
        float(np.sqrt(np.mean(steering**2))), float(np.mean(speed)),
    )  # fmt: skip
