"""What a controller is to do and may do, in the vehicle's own measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Row = NDArray[np.float64]


@dataclass(frozen=True)
class Wishes:
    """What is squared is a deviation over the number given here; commands are in order of the model's inputs.

    Attributes
    ----------
    stages : periods to look ahead.
    path, course, speed : deviations that weigh the same: m, rad and m/s.
    rates : of the commands, that weigh as much, in their units per second.
    low, high, fastest : bounds of the commands and of their rates.
    slip : slip angle that front and rear tyres are not to exceed, rad.
    beyond : weight of what exceeds the track or that slip, as a share of it, and of its square.
    """

    stages: int
    path: float
    course: float
    speed: float
    rates: Row
    low: Row
    high: Row
    fastest: Row
    slip: float
    beyond: float = 100.0

    @property
    def units(self) -> Row:
        """Largest commands: what they are reckoned in."""
        return np.maximum(-self.low, self.high)
