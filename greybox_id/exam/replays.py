"""A recording driven again under its own commands, with other effects and without noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..datasets.virtual_vehicle import Tolerances, Truth, replay
from ..parameter import Array
from ..recording import Recording
from .aliases import View
from .vocabulary import absorbing

GLANCE = 15.0
"""Of the recording, s, that may rule an alias out before all of it is simulated."""


@dataclass(frozen=True)
class Replays:
    """A recording driven again.

    Attributes
    ----------
    recording, truth : commands, and the true vehicle with its state at the first row.
    seed : of the recording.
    tolerances : as stated; None where the vehicle file is exact.
    """

    recording: Recording
    truth: Truth
    seed: int
    tolerances: Tolerances | None
    _seen: dict[object, Array] = field(default_factory=dict)

    def readings(self, effects: Mapping[str, float], part: bool = False, beyond: str = "") -> Array:
        """Noise-free readings in noise sds, (channels, n).

        Parameters
        ----------
        effects : in place of the true ones; small effects that are tolerated stay.
        part : of the first seconds only.
        beyond : a tolerance; the vehicle lies one sd of it further off.
        """
        key = part, beyond, *sorted(effects.items())
        if key not in self._seen:
            car = self.truth.car
            if beyond and self.tolerances is not None:
                if beyond in self.tolerances.parameters:
                    moved = car.parameters[beyond] + self.tolerances.parameters[beyond]
                    car = replace(car, parameters={**car.parameters, beyond: moved})
                else:
                    null = 1.0 if beyond == "steering_ratio" else 0.0
                    moved = car.small.get(beyond, null) + self.tolerances.effects[beyond]
                    car = replace(car, small={**car.small, beyond: moved})
            commands = self.recording.rows(0, round(GLANCE / self.recording.sample_time)) if part else self.recording
            start = {name: float(self.truth.states[name][0]) for name in ("v_x", "v_y", "yaw_rate")}
            found, _ = replay(car, commands, start, effects, self.truth.forms, self.seed)
            self._seen[key] = np.stack([found[name] / sd for name, sd in car.noise.items()])
        return self._seen[key]

    def size(self, effects: Mapping[str, float], rest: Mapping[str, float]) -> dict[str, float]:
        """Channel -> root mean square of the difference that effects make beside the rest, in noise sds."""
        difference = self.readings(effects) - self.readings(rest)
        sizes = np.sqrt(np.mean(difference**2, axis=1))
        return {name: float(own) for name, own in zip(self.truth.car.noise, sizes, strict=True)}

    def evidence(self, effects: Mapping[str, float], rest: Mapping[str, float]) -> float:
        """Squares of what tolerances leave of that difference, and of what they pay; see `Answer.evidence`."""
        difference = self.readings(effects) - self.readings(rest)
        return self._view(effects, False).product(difference, difference)

    def views(self, effects: Mapping[str, float]) -> Sequence[View]:
        """The first seconds, and all of the recording."""
        return self._view(effects, True), self._view(effects, False)

    def _view(self, effects: Mapping[str, float], part: bool) -> View:
        shifts = self._shifts(effects, part)
        inner = np.linalg.inv(np.eye(len(shifts)) + shifts @ shifts.T)

        def product(a: Array, b: Array) -> float:
            return float(np.sum(a * b) - (shifts @ a.ravel()) @ inner @ (shifts @ b.ravel()))

        return View(lambda other: self.readings(other, part), product)

    def _shifts(self, effects: Mapping[str, float], part: bool) -> Array:
        """What one sd of every tolerance that may take the effects up changes, (tolerances, readings)."""
        known, base = self.tolerances, self.readings({})
        rows = self.readings({}, part).shape[1]
        there = () if known is None else (*known.parameters, *known.effects)
        names = [name for name in absorbing(effects) if name in there]
        shifts = np.zeros((len(names), len(base), rows))
        for k, name in enumerate(names):
            shifts[k] = (self.readings({}, beyond=name) - base)[:, :rows]
        return shifts.reshape(len(names), len(base) * rows)
