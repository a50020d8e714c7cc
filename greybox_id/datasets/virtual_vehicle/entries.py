"""One thing a vehicle may have: its name, what its magnitude means, and which magnitudes are worth an examination."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import exp, inf, log
from typing import Literal

import numpy as np

from .scale import G, Scale

Kind = Literal["racer", "car", "truck", "sports"]
"""Classes of vehicles by size."""

Sides = Literal["up", "down", "both"]
"""On which side of its null value an effect may lie."""

PER: Mapping[str, Callable[[Scale], float]] = {
    "one": lambda size: 1.0,
    "length": lambda size: size.length,
    "time": lambda size: size.time,
    "rate": lambda size: 1.0 / size.time,
    "weight": lambda size: size.weight,
    "speed": lambda size: size.top_speed,
    "weight over speed squared": lambda size: size.weight / size.top_speed**2,
    "drive": lambda size: size.drive,
    "gyro noise": lambda size: size.yaw_noise,
    "accelerometer noise": lambda size: size.accel_noise,
    "accelerometer tilt": lambda size: size.accel_noise / G,
    "turns": lambda size: size.top_speed / size.grip,
}
"""What magnitudes grow with."""


@dataclass(frozen=True)
class Entry:
    """One thing a vehicle may have.

    Attributes
    ----------
    name : what it is called.
    unit : of its magnitude.
    null : magnitude at which it is not there: 0, 1 for factors, infinity for limits.
    about : what its magnitude means.
    low, high : how far from its null it plausibly and visibly lies, in units of `per`; for factors, 0.1 is 1.1 or
        1 / 1.1; for limits, the magnitude itself.
    per : a name of `PER`.
    sides : of its null value.
    special : low and high of single classes.
    resembles : for what is outside the vocabulary, effects of it that some recordings cannot tell from this.
    """

    name: str
    unit: str
    null: float
    about: str
    low: float
    high: float
    per: str = "one"
    sides: Sides = "up"
    special: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    resembles: tuple[str, ...] = ()

    def sizes(self, size: Scale, kind: str) -> tuple[float, float]:
        """How far from its null it lies, at least and at most, on a vehicle of a size and class."""
        low, high = self.special.get(kind, (self.low, self.high))
        per = PER[self.per](size)
        return low * per, high * per

    def at(self, deviation: float) -> float:
        """The magnitude that lies so far from null; negative deviations below it."""
        if self.null == 0.0:
            return deviation
        if self.null == inf:
            return abs(deviation)
        return 1.0 + deviation if deviation >= 0.0 else 1.0 / (1.0 - deviation)

    def ranges(self, size: Scale, kind: str) -> tuple[tuple[float, float], ...]:
        """Magnitudes worth an examination, as one or two intervals (least, most)."""
        low, high = self.sizes(size, kind)
        up, down = (self.at(low), self.at(high)), (self.at(-high), self.at(-low))
        return {"up": (up,), "down": (down,), "both": (down, up)}[self.sides]

    def draw(self, size: Scale, kind: str, rng: np.random.Generator) -> float:
        """A magnitude: its distance from null is uniform in the logarithm."""
        low, high = self.sizes(size, kind)
        side = {"up": 1.0, "down": -1.0, "both": 1.0 if rng.random() < 0.5 else -1.0}[self.sides]
        return float(self.at(side * exp(rng.uniform(log(low), log(high)))))
