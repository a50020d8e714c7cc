"""Steps and sines of the steering wheel at several speeds, and which of them are for what.

The paper shows its profiles without their numbers (Fig. 5); these reach from 1.4 to about 7 m/s^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...errors import BadInput

Array = NDArray[np.float64]
Part = Literal["train", "held out"]
RATIO = 20.0
"""Angle of the steering wheel over that of the road wheels."""
FASTEST_HANDS = 6.0
"""rad/s at the steering wheel, in a step."""
_STRAIGHT = 1.0
"""Driven straight on at the beginning and at the end, s."""


@dataclass(frozen=True)
class Manoeuvre:
    """One profile of the steering wheel at one speed.

    Attributes
    ----------
    kind : "step": to one side, held, to the other side, held; "sine": begun and ended at zero.
    speed : that the driver keeps, m/s.
    amplitude : at the steering wheel, rad; negative begins to the right.
    frequency : of a sine, Hz; of a step, one over twice the time it is held.
    duration : s.
    part : whether a model may be trained on it, or is held to it.
    """

    kind: Literal["step", "sine"]
    speed: float
    amplitude: float
    frequency: float
    duration: float = 10.0
    part: Part = "train"

    def __post_init__(self) -> None:
        if self.kind not in ("step", "sine"):
            raise BadInput(f'A manoeuvre is a "step" or a "sine", not a "{self.kind}".')
        if not (self.speed > 0.0 and self.frequency > 0.0 and self.duration > 3.0 * _STRAIGHT):
            raise BadInput(
                f"A manoeuvre needs a speed and a frequency above zero and more than {3.0 * _STRAIGHT:g} s; "
                f"{self.speed:g} m/s, {self.frequency:g} Hz and {self.duration:g} s were given."
            )

    @property
    def name(self) -> str:
        """What it is called in tables: "step 14 m/s 60 deg"."""
        often = f" {self.frequency:g} Hz" if self.kind == "sine" else ""
        return f"{self.kind} {self.speed:g} m/s {round(float(np.degrees(self.amplitude)))} deg{often}"


def _train(kind: Literal["step", "sine"], *each: tuple[float, float, float]) -> tuple[Manoeuvre, ...]:
    return tuple(Manoeuvre(kind, speed, amplitude, frequency) for speed, amplitude, frequency in each)


MANOEUVRES: tuple[Manoeuvre, ...] = (
    *_train(
        "step", (8.0, 0.8, 0.16), (8.0, -3.0, 0.2), (10.0, 3.6, 0.16), (12.0, -0.6, 0.16), (12.0, 1.5, 0.2),
        (12.0, -2.7, 0.25), (14.0, 0.9, 0.16), (14.0, -2.0, 0.2), (16.0, 0.7, 0.2), (16.0, -1.6, 0.16),
    ),
    *_train(
        "sine", (8.0, 3.2, 0.3), (10.0, -1.2, 0.5), (10.0, 3.4, 0.8), (12.0, 0.9, 0.3), (12.0, -2.0, 1.0),
        (12.0, 2.8, 0.5), (14.0, -0.8, 0.6), (14.0, 2.0, 0.4), (16.0, -1.2, 0.8), (16.0, 1.5, 0.3),
    ),
    Manoeuvre("step", 9.0, 2.8, 0.2, part="held out"),
    Manoeuvre("step", 13.0, -1.8, 0.18, part="held out"),
    Manoeuvre("step", 15.0, 1.4, 0.16, part="held out"),
    Manoeuvre("sine", 11.0, 2.6, 0.4, part="held out"),
    Manoeuvre("sine", 13.0, -1.7, 0.7, part="held out"),
    Manoeuvre("sine", 15.0, 1.3, 0.5, part="held out"),
)  # fmt: skip
"""Speed, m/s, amplitude, rad at the steering wheel, frequency, Hz. No held-out manoeuvre has the speed of a trained
one."""


def steering(manoeuvre: Manoeuvre, rate: float) -> Array:
    """Road-wheel angle of every row, rad; (n,)."""
    n = int(round(manoeuvre.duration * rate))
    time = np.arange(n) / rate - _STRAIGHT
    lasts = manoeuvre.duration - 2.0 * _STRAIGHT
    if manoeuvre.kind == "sine":
        whole = max(np.floor(lasts * manoeuvre.frequency), 1.0) / manoeuvre.frequency
        wheel = np.where((time > 0.0) & (time < whole), np.sin(2.0 * np.pi * manoeuvre.frequency * time), 0.0)
        return np.asarray(manoeuvre.amplitude / RATIO * wheel, float)
    held = 0.5 / manoeuvre.frequency
    to, back, end = 0.0, min(held, 0.5 * lasts), min(2.0 * held, lasts)
    aim = np.select([time < to, time < back, time < end], [0.0, 1.0, -1.0], 0.0) * manoeuvre.amplitude
    wheel, most = np.zeros(n), FASTEST_HANDS / rate
    for k in range(1, n):
        wheel[k] = wheel[k - 1] + np.clip(aim[k] - wheel[k - 1], -most, most)
    return np.asarray(wheel / RATIO)
