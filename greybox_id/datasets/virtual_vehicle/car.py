"""The virtual vehicle as it is stated: parameters, drive channel, sensors, and what may be the matter with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ...errors import BadInput
from .effects import ALL, OUTSIDE
from .entries import Kind
from .scale import PARAMETERS, Scale, scale

DRIVE_CHANNELS = ("ax_cmd", "motor_current", "drive_force")
"""What a drive command may be: m/s^2, A or N."""


@dataclass(frozen=True)
class VirtualCar:
    """A vehicle to drive in simulation.

    Attributes
    ----------
    name : for people.
    kind : class of vehicle: racer (1:10), car, truck (and delivery van), sports (and formula cars).
    parameters : `scale.PARAMETERS` and, where wheels rotate, I_w [kg m^2]; SI units.
    drive_channel : signal of the drive command, in whose unit force_per_unit is.
    noise : sd of each sensor by signal; without a sensor of v_y that signal is not among them.
    steer_max : rad.
    top_speed : brisk speed on a test track, m/s.
    small : small effects that are there at this size, as `toleranced` draws them; name -> magnitude.

    Raises
    ------
    BadInput : a parameter is missing or the drive channel is not known.
    """

    name: str
    kind: Kind
    parameters: Mapping[str, float]
    drive_channel: str
    noise: Mapping[str, float]
    steer_max: float
    top_speed: float
    small: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if lacking := [name for name in PARAMETERS if name not in self.parameters]:
            raise BadInput(f"{self.name} states no {', '.join(lacking)}, which its simulation needs.")
        if self.drive_channel not in DRIVE_CHANNELS:
            raise BadInput(f"The drive channel is one of {', '.join(DRIVE_CHANNELS)}, not {self.drive_channel}.")
        for name in ("parameters", "noise", "small"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def size(self) -> Scale:
        """Size and pace."""
        return scale(self.parameters, self.top_speed, self.steer_max, self.noise)

    @property
    def measures_v_y(self) -> bool:
        """Whether it has a sensor of v_y."""
        return "v_y" in self.noise

    @property
    def outside(self) -> tuple[str, ...]:
        """Names of effects that are not in the vocabulary and that this vehicle may have."""
        return tuple(OUTSIDE)

    def magnitude(self, effect: str, rng: np.random.Generator) -> float:
        """A plausible and visible magnitude of an effect of the vocabulary or outside it.

        Raises
        ------
        BadInput : there is no such effect.
        """
        if effect not in ALL:
            raise BadInput(f"The virtual vehicle knows no {effect}; it knows {', '.join(ALL)}.")
        return ALL[effect].draw(self.size, self.kind, rng)
