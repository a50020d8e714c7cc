"""What keeps a vehicle safe whatever its policy does: limits of commands, an envelope, a cap that rises.

`demo.Watched` is where they act, and a watchdog with them.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from greybox_id.base.json_data import finite
from greybox_id.base.shorthands import Array

from .adapting import WINDOW

LATE = 1.5
"""Periods of the processor's time after which a command that has not come is braking."""
CLEAN, RISE, FALL = 3, 0.1, 0.2
"""Laps without an event before the cap rises, and by what share it rises and falls."""
ASIDE, EXCESS = 0.8, 1.5
"""Share of the half width, and how many times the foretold path error, beyond which the last good policy drives."""
STEER_RATE = 2.0
"""rad/s, of the road wheels, over the largest angle of 0.42 rad: as published for a 1:10 car."""
DRIVE_TIME = 0.1
"""s in which the drive goes from nothing to its largest."""


@dataclass
class CommandLimits:
    """Largest commands and changes of commands.

    Attributes
    ----------
    low, high : (2,) of steer and drive.
    rates : (2,) per second.
    period : s.
    """

    low: Array
    high: Array
    rates: Array
    period: float

    def __post_init__(self) -> None:
        self.last = np.zeros(2)

    def __call__(self, command: Array) -> Array:
        """What is given of what is wanted; what is no number is the command before."""
        command = np.where(np.isfinite(command), command, self.last)
        step = self.rates * self.period
        self.last = np.clip(np.clip(command, self.last - step, self.last + step), self.low, self.high)
        return self.last.copy()


def limits_of(steer_max: float, brake: float, drive: float, period: float) -> CommandLimits:
    """CommandLimits of a vehicle from its largest angle, rad, and its largest braking and drive, in their unit."""
    high = np.array([steer_max, drive])
    low = np.array([-steer_max, -brake])
    rates = np.array([STEER_RATE * steer_max / 0.42, max(brake, drive) / DRIVE_TIME])
    return CommandLimits(low, high, rates, period)


class Envelope:
    """Whether a vehicle drives as foretold.

    Parameters
    ----------
    half_width : m.
    worst : m, largest path error over `WINDOW` that is foretold.
    period : s.
    """

    def __init__(self, half_width: float, worst: float, period: float) -> None:
        self.half_width, self.worst = half_width, worst
        self._squares: deque[float] = deque(maxlen=int(WINDOW / period))
        self._sum = 0.0

    def left(self, e_y: float) -> str:
        """Why the envelope is left with this lateral error, m; "" where it is not."""
        if len(self._squares) == self._squares.maxlen:
            self._sum -= self._squares[0]
        self._squares.append(e_y**2)
        self._sum += e_y**2
        if abs(e_y) > ASIDE * self.half_width:
            return f"{abs(e_y):.2f} m from the path, on a track with a half width of {self.half_width:.2f} m"
        rms = (max(self._sum, 0.0) / len(self._squares)) ** 0.5
        if len(self._squares) == self._squares.maxlen and rms > EXCESS * self.worst:
            return f"path error {rms:.3f} m over {WINDOW:g} s, where at most {self.worst:.3f} m was predicted"
        return ""

    def begin(self, worst: float | None = None) -> None:
        """Begin anew, with another policy's foretold error where there is one."""
        self.worst = self.worst if worst is None else worst
        self._squares.clear()
        self._sum = 0.0


@dataclass
class Cap:
    """The share of the grip that may be used.

    Attributes
    ----------
    share : now.
    least, most : that it stays within.
    clean : laps since the last event or rise.
    """

    share: float
    least: float = 0.4
    most: float = 0.9
    clean: int = 0

    def next_cycle(self) -> bool:
        """Rise with a cycle's end, if it was clean; whether it rose."""
        if self.clean < CLEAN or self.share >= self.most:
            return False
        self.share, self.clean = min(self.share * (1.0 + RISE), self.most), 0
        return True

    def event(self) -> None:
        """Fall."""
        self.share, self.clean = max(self.share * (1.0 - FALL), self.least), 0


def caps_from(share: float) -> tuple[float, ...]:
    """The caps that may follow upon one: after an event, without one, and after clean laps."""
    fallen, risen = Cap(share), Cap(share, clean=CLEAN)
    fallen.event()
    risen.next_cycle()
    return fallen.share, share, risen.share


class Log:
    """Events as JSON lines; one that a kill cut short is cut off when it is opened again.

    Parameters
    ----------
    file : to be appended to.
    """

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        if file.is_file():
            held = file.read_bytes()
            if not held.endswith(b"\n"):
                file.write_bytes(held[: held.rfind(b"\n") + 1])
        self._file = file

    def write(self, kind: str, **more: Any) -> Mapping[str, Any]:
        """Write an event down; the event."""
        event = {"time": time.time(), "kind": kind, **more}
        with self._file.open("a", encoding="utf-8") as opened:
            opened.write(json.dumps(finite(event), allow_nan=False) + "\n")
        return event
