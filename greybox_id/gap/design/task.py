"""The task of a design apart from its goal, and the limits that plans are made with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array
from ...models.motion_model import MotionModel
from ...models.single_track import G
from ..estimation.axes import scalars
from .arena import Arena
from .limits import DriveLimits
from .primitives import Handling

NEEDED = 0.95
"""Share of the draws of what is uncertain that must keep to the limits."""
FARTHEST = 2.5
"""Draws of what is uncertain are cut at so many standard deviations."""
SHORTEST, LONGEST = 2.0, 300.0
"""Durations of plans, s."""
MOST_ROWS = 12_000
ONE_AXLE, BOTH_AXLES = 0.4, 0.7
"""Largest share of the friction that plans use for driving, by one axle, and for braking, by both."""


@dataclass(frozen=True)
class DesignTask:
    """The task of a design apart from its goal.

    Attributes
    ----------
    arena, limits : within which it has to stay.
    duration, rate : s at most, rows a second.
    repeat : how often the manoeuvre will be driven.
    seed : of everything random.
    follow : whether a driver keeps the path; else commands are given as planned.
    effort : of the search, over the usual one.
    """

    arena: Arena
    limits: DriveLimits
    duration: float
    rate: float
    repeat: int
    seed: int
    follow: bool
    effort: float = 1.0

    def cautious(self, vehicle: Handling, model: MotionModel, samples: Array) -> tuple[DesignTask, Handling]:
        """The task with limits, and the vehicle with grip, that plans are made with.

        Where friction is hardly known, plans begin gentler.

        Parameters
        ----------
        samples : (K, parameters) draws of what is uncertain.
        """
        friction = [samples[:, k] for k, one in scalars(model) if one.name in ("D_f", "D_r", "mu_f", "mu_r")]
        if not friction:
            return self, vehicle
        low = G * float(np.quantile(np.min(friction, axis=0), 1.0 - NEEDED))
        most, limits = self.limits.grip * low, self.limits
        slower = replace(
            limits, drive_max=min(limits.drive_max, ONE_AXLE * most), brake_max=min(limits.brake_max, BOTH_AXLES * most)
        )
        return replace(self, limits=slower), replace(vehicle, grip=min(vehicle.grip, low))

    def must_fit(self) -> None:
        """Raise `BadInput` where not even a straight drive at the lowest speed fits in."""
        limits, arena = self.limits, self.arena
        if arena.breadth <= 2.0 * limits.margin:
            raise BadInput(
                f"‹arena› {arena.words} is too small: the vehicle with its margin is {2.0 * limits.margin:.2g} m wide, "
                f"the arena {arena.breadth:.2g} m. Name one of at least {3.0 * limits.margin:.2g} m, or state a "
                "smaller margin (‹limits›)."
            )
        v = 1.15 * limits.speed_min
        straight = v**2 / limits.drive_max + v * SHORTEST + v**2 / (2.0 * limits.brake_max) + 2.0 * limits.margin
        turning = 2.0 * (v**2 / (0.5 * limits.grip * G) + limits.margin)
        if arena.length < straight and arena.breadth < turning:
            raise BadInput(
                f"‹arena› {arena.words} is too small: at {v:.2g} m/s, the lowest speed, the vehicle needs "
                f"{straight:.0f} m straight on or a circle of {turning:.0f} m. Name a larger one, or lower speed_min "
                "(‹limits›)."
            )
