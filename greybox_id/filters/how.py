"""How a recording is tracked: filter, readings, noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import get_args

from ..base.errors import BadInput, must_be_one_of
from .filtering import GATE
from .kernel import Kind, SigmaPoints

READINGS = ("v_x", "yaw_rate", "a_y")
"""What a series car measures: readings that a filter takes unless others are named."""
TUNED_ON = 60.0
"""Noise is tuned on so many seconds at the beginning of a recording."""


@dataclass(frozen=True)
class TrackOptions:
    """How a recording is tracked.

    Attributes
    ----------
    filter : "ekf" or "ukf".
    smooth : whether later readings count as well.
    readings : outputs whose readings are taken.
    coloured : outputs whose error has a slow part besides white noise.
    noise : sizes that are stated; the others are tuned.
    known : sizes known of the vehicle, which count for those of the noises that there are.
    tune : seconds at the beginning on which noise is tuned; 0 takes it as stated or guessed.
    calibrate : seconds at the beginning on which the model's free parameters are tuned along; 0 leaves them.
    gate : readings further off than so many standard deviations count as noisier.
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
