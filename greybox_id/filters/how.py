"""Options of tracking: filter, readings, noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import get_args

from ..base.errors import BadInput, must_be_one_of
from .filtering import GATE
from .kernel import Kind, SigmaPoints

READINGS = ("v_x", "yaw_rate", "a_y")
"""Default readings: what a series car measures."""
TUNED_ON = 60.0
"""Default of the seconds at the beginning of a recording on which noise is tuned."""


@dataclass(frozen=True)
class TrackOptions:
    """Options of tracking.

    Attributes
    ----------
    filter : "ekf" or "ukf".
    smooth : whether estimates use later readings, too.
    readings : outputs whose readings are used.
    coloured : outputs with coloured noise in addition to white noise.
    noise : stated sizes of noises; the others are tuned.
    known : sizes of noises known for the vehicle, used for those that the model has.
    tune : seconds at the beginning on which noise is tuned; 0 keeps it as stated or guessed.
    calibrate : seconds at the beginning on which the model's free parameters are tuned, too; 0 keeps them.
    gate : innovation, in standard deviations, beyond which a reading's noise is raised.
    points : sigma points of the UKF.

    Raises
    ------
    BadInput : a value cannot be used.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.TrackOptions(filter="ukf", smooth=True).filter
    'ukf'
    """

    filter: Kind = "ekf"
    smooth: bool = False
    readings: Sequence[str] = READINGS
    coloured: Sequence[str] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    tune: float = TUNED_ON
    calibrate: float = 0.0
    gate: float = GATE
    points: SigmaPoints = field(default_factory=SigmaPoints)

    def __post_init__(self) -> None:
        for name in ("readings", "coloured"):
            if isinstance(getattr(self, name), str):
                raise BadInput(
                    f"{name}: a list of names is needed, as in {name}=['a_y'], not the text {getattr(self, name)!r}."
                )
        must_be_one_of(get_args(Kind), self.filter, "filter: there is no")
        for name, least in (("tune", "zero or more"), ("calibrate", "zero or more"), ("gate", "above zero")):
            value = getattr(self, name)
            if not (
                isinstance(value, int | float)
                and isfinite(value)
                and (value > 0 or (value == 0 and "zero or" in least))
            ):
                raise BadInput(f"{name}: a number {least} is needed, not {value!r:.40}.")
