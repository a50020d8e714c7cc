"""A vehicle as its engineers state it: what is known of its parameters, how well, and who says so.

It names parameters, effects and signals; which of them a model has is the model's affair.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isinf, isnan
from numbers import Real
from pathlib import Path

from ..base.errors import BadInput


@dataclass(frozen=True)
class Stated:
    """One number as stated, in the SI unit of what it stands for.

    Attributes
    ----------
    value : the number; None for a tolerance about an effect's null value.
    sd : how well it is known, one standard deviation; None where nothing is said.
    min, max : what it can be at all; None where nothing is said.
    source : who says so.

    Raises
    ------
    BadInput : the value is no finite number, sd is negative, or min is above max.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.Stated(1457.2, sd=4.4, source="scale").plain
    False
    """

    value: float | None = None
    sd: float | None = None
    min: float | None = None
    max: float | None = None
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("value", "sd", "min", "max"):
            value = getattr(self, name)
            if value is not None and (
                not isinstance(value, Real) or isnan(value) or (name == "value" and isinf(value))
            ):
                raise BadInput(f"Stated, {name}: a number or None is needed, not {value!r:.40}.")
        if self.sd is not None and self.sd < 0.0:
            raise BadInput(f"Stated, sd: a standard deviation cannot be negative, as {self.sd:g} is.")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise BadInput(f"Stated: min = {self.min:g} is above max = {self.max:g}.")

    @property
    def plain(self) -> bool:
        """Whether nothing but the number is stated."""
        return self.sd is None and self.min is None and self.max is None


@dataclass(frozen=True)
class ChosenModel:
    """The model a vehicle is best described by, as a diagnosis or an engineer left it.

    Attributes
    ----------
    name : of the model.
    settings : the model's hyperparameters as plain data, for example its tyre.
    effects : effects that are part of it, with their magnitudes.
    """

    name: str
    settings: Mapping[str, object] = field(default_factory=dict)
    effects: Mapping[str, Stated] = field(default_factory=dict)


@dataclass(frozen=True)
class TrackingPlan:
    """What is tracked of a vehicle while it drives, unless somebody asks for something else.

    Attributes
    ----------
    parameters : what walks at random.
    disturbances : what comes and goes about where it stands.
    noise : name of a noise -> its size; noises that are not stated are tuned on the recording.
    """

    parameters: tuple[str, ...] = ()
    disturbances: tuple[str, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StatedModelError:
    """How far forces of a model are off, as stated; None where nothing is said.

    Attributes
    ----------
    share : standard deviation of unknown forces over the force itself, 1.
    amplitude : of those beside that, over the mass, m/s^2.
    correlation_time : how long they stay alike, s.
    """

    share: float | None = None
    amplitude: float | None = None
    correlation_time: float | None = None


@dataclass(frozen=True)
class Vehicle:
    """What is stated of a vehicle.

    Attributes
    ----------
    name : for people.
    values : parameter name -> number.
    effects : effect name -> tolerance: small ones known to be there at this size, with their sd.
    noise : signal name -> standard deviation of its sensor.
    steer_max : largest road-wheel angle, rad; None where it is not stated.
    model : the model it is best described by; None where that is open.
    tracking : what is tracked of it; None where that is open.
    model_error : "F_y", "F_x" -> how far lateral and longitudinal forces of a model of it are off.
    about : for people.
    path : the file it was read from.
    """

    name: str
    values: Mapping[str, Stated] = field(default_factory=dict)
    effects: Mapping[str, Stated] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    steer_max: float | None = None
    model: ChosenModel | None = None
    tracking: TrackingPlan | None = None
    model_error: Mapping[str, StatedModelError] = field(default_factory=dict)
    about: str = ""
    path: Path | None = field(default=None, compare=False)
