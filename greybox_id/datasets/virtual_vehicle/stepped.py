"""The virtual vehicle for controllers: it takes one command at a time and says where it is."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ...errors import BadInput
from .car import VirtualCar
from .compiled import Row
from .forms import Forms
from .layout import OPEN_DRIVE, ROAD, ROW_TRUTH, TURN, YAW, X, Y
from .loop import STEP
from .made import made
from .manoeuvres import robot


class SteppedCar:
    """A vehicle that is commanded from outside; it starts at x = y = yaw = 0, with commands of zero before.

    Parameters
    ----------
    car : the vehicle; its small effects act together with `effects`.
    v_x : m/s, at which it starts straight ahead.
    duration : s, that it can be driven at most.
    rate : commands a second; a whole number of simulation steps of 1 ms lies between them.
    effects, forms, seed : as for `drive.drive`.

    Raises
    ------
    BadInput : an effect, a form or the rate is not known.
    """

    def __init__(
        self,
        car: VirtualCar,
        v_x: float,
        duration: float,
        rate: float = 50.0,
        effects: Mapping[str, float] = MappingProxyType({}),
        forms: str | Forms = "nominal",
        seed: int = 0,
    ) -> None:
        own = made(car, effects, forms, seed, rate)
        nothing = np.zeros(max(int(round(duration * rate)), 1))
        self._hold = own.hold
        start = np.array([v_x, 0.0, 0.0])
        self._simulation = own.simulation(robot(nothing, nothing), np.zeros((8, ROAD)), 1.0, 0, start)

    @property
    def time(self) -> float:
        """s, since the start."""
        return self._simulation.done * STEP

    @property
    def motion(self) -> dict[str, float]:
        """Where it is and how it moves, as it really is: x, y [m], yaw [rad], v_x, v_y [m/s], yaw_rate [rad/s]."""
        s = self._simulation.state
        names = ("v_x", "v_y", "yaw_rate", "x", "y", "yaw")
        return {name: float(s[k]) for name, k in zip(names, (0, 1, 2, X, Y, YAW), strict=True)}

    def step(self, steer: float, drive: float) -> None:
        """Hold a command for a period: steering, rad, and drive, in the unit of the vehicle's channel.

        Raises
        ------
        BadInput : the duration is over, or the motion has blown up.
        """
        now = self._simulation
        row = now.done // self._hold
        if row >= len(now.plan):
            raise BadInput(f"The drive was to last {self.time:g} s; start it with a longer duration.")
        now.plan[row, TURN], now.plan[row, OPEN_DRIVE] = steer, drive
        now.advance(now.done + self._hold)
        if not np.all(np.isfinite(now.state)):
            raise BadInput(f"The simulated motion blew up after {self.time:g} s.")

    def truth(self) -> dict[str, Row]:
        """Name -> (rows,) just after each command so far: road-wheel angle, forces, loads and slips, as in `Truth`."""
        rows = self._simulation.done // self._hold
        return {name: self._simulation.truth[:rows, k] for k, name in enumerate(ROW_TRUTH)}
