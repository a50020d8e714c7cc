"""A simulation on its way: what was commanded, what can be read and what is true, as far as it has come."""

from __future__ import annotations

import numpy as np

from .compiled import Car, Grid, Row
from .driver import Driver
from .layout import READABLE, ROW_TRUTH
from .loop import first_moment, simulator


class Simulation:
    """A vehicle that carries out a plan; parameters as of `loop.simulator`.

    Parameters
    ----------
    steps : how many there can be.
    start : (3,) v_x, v_y, yaw_rate at the first row.

    Attributes
    ----------
    done : steps that were taken.
    state : (STATES,) as it is now.
    commands, readable, truth : (rows, 2), (steps, 2, k) and (rows, k), as of `loop.simulator`; zero from `done` on.
    """

    def __init__(
        self, car: Car, knows: Driver, road: Grid, spacing: float, plan: Grid, first: int, hold: int, steps: int,
        start: Row, gusts: Row,
    ) -> None:  # fmt: skip
        self._given = (car, knows, road, spacing, plan, first, hold, gusts)
        self._now = first_moment(car, start)
        self.state = self._now.s
        self.plan, self.steps, self.done = plan, steps, 0
        self.commands, self.truth = np.zeros((len(plan), 2)), np.zeros((len(plan), len(ROW_TRUTH)))
        self.readable = np.zeros((steps, 2, len(READABLE)))

    def advance(self, to: int) -> None:
        """Take steps until so many are done."""
        simulator()(*self._given, self._now, self.done, to, self.commands, self.readable, self.truth)
        self.done = to
