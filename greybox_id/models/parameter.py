"""Parameters, scalar or array: as a model holds them with prior and bounds, and as engineers state them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import isinf, isnan
from numbers import Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..base.errors import BadInput
from ..base.numbers import exact, pretty_unit
from ..base.shorthands import Array

SCOPES = ("model", "run")


@dataclass(frozen=True)
class Stated:
    """One number as engineers state it: value in the SI unit of its quantity, uncertainty, limits and source.

    Attributes
    ----------
    value : the number; None for a tolerance about an effect's null value.
    sd : its standard deviation; None if not stated.
    min, max : limits of its possible values; None if not stated.
    source : of the number.

    Raises
    ------
    BadInput : the value is not a finite number, sd is negative, or min is above max.

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
            raise BadInput(f"Stated, sd: a standard deviation cannot be negative, but it is {self.sd:g}.")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise BadInput(f"Stated: min = {self.min:g} is above max = {self.max:g}.")

    @property
    def plain(self) -> bool:
        """Whether only the value is stated."""
        return self.sd is None and self.min is None and self.max is None


@dataclass(frozen=True)
class Prior:
    """Prior of a parameter: independent Gaussians, and smoothness of arrays.

    Attributes
    ----------
    sd : standard deviation of each entry about its mean, in the parameter's unit; a scalar or an array that
        broadcasts to the parameter's shape, infinite for an unconstrained entry.
    mean : scalar or array of the parameter's shape; None takes the parameter's nominal value.
    step_sd : for arrays, standard deviation of the difference between neighbours along each axis, relative to the
        mean's difference; a scalar, or an array that broadcasts to the shape of the differences; None for no
        smoothness along an axis.
    strength : name of the factor that scales this prior as a regulariser and is chosen by cross-validation; empty if
        the prior is knowledge, not to be tuned.

    Raises
    ------
    BadInput : a standard deviation is not positive, or the mean is not a number.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.Parameter("B_f", "1/rad", 6.0, prior=gb.models.Prior(sd=3.0, mean=6.0)).prior.sd
    3.0
    """

    sd: ArrayLike
    mean: ArrayLike | None = None
    step_sd: tuple[ArrayLike | None, ...] = ()
    strength: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.step_sd, tuple):
            raise BadInput(
                "Prior, step_sd: one entry for each axis is needed, a number or None, as in (0.4, None), not "
                f"{self.step_sd!r:.40}."
            )
        spreads = {"sd": self.sd} | {f"step_sd[{k}]": item for k, item in enumerate(self.step_sd) if item is not None}
        for name, value in spreads.items():
            if not np.all(_numbers(value, f"Prior, {name}") > 0.0):
                raise BadInput(
                    f"Prior, {name}: standard deviations above zero are needed, not {value!r:.40}; if a value is "
                    "known exactly, fix the parameter."
                )
        if self.mean is not None and not np.all(np.isfinite(_numbers(self.mean, "Prior, mean"))):
            raise BadInput(f"Prior, mean: finite numbers are needed, not {self.mean!r:.40}.")


def _numbers(value: ArrayLike, where: str) -> Array:
    """A value as an array. Raises `BadInput` if it is not numeric."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise BadInput(f"{where}: a number or an array of numbers is needed, not {value!r:.40}.") from error


@dataclass(frozen=True)
class Parameter:
    """A named number or array of numbers with its unit, bounds and prior.

    Attributes
    ----------
    name : the field's symbol: m, I_z, C_f.
    unit : SI unit in pint's spelling, "1" when there is none.
    value : nominal value, a number or an array.
    bounds : lowest and highest admissible value of every entry.
    prior : knowledge before the data; None for none.
    fixed : whether fitting holds it.
    scope : "model", one value for all data; "run", one value per run (a nuisance parameter such as a timing offset);
        new runs take the mean over the training runs.
    about : meaning, for people.
    source : of the nominal value.
    axes : for local models, the signal along each leading axis of the value and its centres, in the SI unit.
    null : of the magnitude of an effect, the value without effect; None for all other parameters.

    Raises
    ------
    BadInput : the value is not a number or outside the bounds, or the shapes of prior and value differ.

    Examples
    --------
    >>> import greybox_id as gb
    >>> I_z = gb.models.Parameter("I_z", "kg m^2", 0.05, bounds=(0.005, 0.5), about="yaw inertia")
    >>> float(I_z.with_value(0.04).value)
    0.04
    """

    name: str
    unit: str
    value: ArrayLike
    bounds: tuple[float, float] = (-np.inf, np.inf)
    prior: Prior | None = None
    fixed: bool = False
    scope: Literal["model", "run"] = "model"
    about: str = ""
    source: str = ""
    axes: tuple[tuple[str, tuple[float, ...]], ...] = ()
    null: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise BadInput(f"Parameter: a name is needed, as in Parameter('m', 'kg', 3.5), not {self.name!r:.40}.")
        value = _numbers(self.value, f"Parameter {self.name}, value")
        value.setflags(write=False)
        object.__setattr__(self, "value", value)
        low, high = self._bounds()
        if not low <= high:
            raise BadInput(f"Parameter {self.name}: the lower bound {low:g} is above the upper bound {high:g}.")
        if np.any(np.isnan(value)):
            raise BadInput(f"Parameter {self.name}: its value is not a number.")
        if np.any(value < low) or np.any(value > high):
            raise BadInput(f"Parameter {self.name}: value {value} is outside its bounds [{low:g}, {high:g}].")
        if self.scope not in SCOPES:
            raise BadInput(f"Parameter {self.name}: scope must be one of {', '.join(SCOPES)}, not {self.scope!r:.40}.")
        self._must_suit(self.prior)

    def _bounds(self) -> tuple[float, float]:
        try:
            low, high = (float(bound) for bound in self.bounds)
        except (TypeError, ValueError) as error:
            raise BadInput(
                f"Parameter {self.name}, bounds: a lowest and a highest value are needed, not {self.bounds!r:.40}."
            ) from error
        return low, high

    def _must_suit(self, prior: Prior | None) -> None:
        """Raise `BadInput` if a prior is not a `Prior`, or its shape does not fit the value."""
        if prior is None:
            return
        if not isinstance(prior, Prior):
            raise BadInput(f"Parameter {self.name}, prior: a Prior is needed, as in Prior(sd=0.5), not {prior!r:.40}.")
        for name, item in (("sd", np.shape(prior.sd)), ("mean", np.shape(0.0 if prior.mean is None else prior.mean))):
            if not _broadcasts(item, self.shape):
                raise BadInput(
                    f"Parameter {self.name} has shape {self.shape}; the {name} of its prior has shape {item}."
                )
        if len(prior.step_sd) > len(self.shape):
            raise BadInput(
                f"Parameter {self.name} has shape {self.shape}; its prior's step_sd has {len(prior.step_sd)} axes."
            )

    def __repr__(self) -> str:
        unit = "" if self.unit == "1" else f" [{pretty_unit(self.unit)}]"
        array = self.array
        ends = f" from {exact(float(array.min()), 6)} to {exact(float(array.max()), 6)}" if array.size else ""
        stated = [exact(float(array), 6) if array.shape == () else f"array of shape {array.shape}{ends}"]
        stated += ["fixed"] * self.fixed
        if np.any(np.isfinite(self.bounds)):
            stated.append(f"bounds [{', '.join(exact(end, 6) for end in self.bounds)}]")
        stated += ["with a prior"] * (self.prior is not None) + ["one for each run"] * (self.scope == "run")
        return f"Parameter {self.name}{unit}: {', '.join(stated)}{f'; {self.about}' if self.about else ''}"

    @property
    def array(self) -> Array:
        """The nominal value as an array; shape () for a scalar."""
        return np.asarray(self.value, dtype=float)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value; () for a scalar."""
        return self.array.shape

    @property
    def size(self) -> int:
        """Number of entries."""
        return self.array.size

    def with_value(self, value: ArrayLike) -> Parameter:
        """The same parameter at another value of the same shape; its prior is unchanged."""
        new = np.asarray(value, dtype=float)
        if new.shape != self.shape:
            raise BadInput(f"Parameter {self.name} has shape {self.shape}; a value of shape {new.shape} was given.")
        prior = self.prior
        if prior is not None and prior.mean is None:
            prior = replace(prior, mean=self.array)
        return replace(self, value=new, prior=prior)


def _broadcasts(shape: tuple[int, ...], to: tuple[int, ...]) -> bool:
    try:
        return np.broadcast_shapes(shape, to) == to
    except ValueError:
        return False


def pack(parameters: Iterable[Parameter]) -> Array:
    """Values of several parameters as one vector, in order, arrays in row-major order."""
    values = [parameter.array.ravel() for parameter in parameters]
    return np.concatenate(values) if values else np.empty(0)


def placed(parameters: Iterable[Parameter]) -> Iterator[tuple[Parameter, slice]]:
    """Each parameter, with the slice of its entries in a vector as returned by `pack`."""
    start = 0
    for parameter in parameters:
        yield parameter, slice(start, start + parameter.size)
        start += parameter.size


def free_places(parameters: Iterable[Parameter]) -> dict[str, int]:
    """Name -> index in such a vector, of free scalar parameters."""
    return {item.name: place.start for item, place in placed(parameters) if item.shape == () and not item.fixed}


def unpack(parameters: Iterable[Parameter], vector: Array) -> tuple[Parameter, ...]:
    """The parameters with the values of a vector as returned by `pack`."""
    return tuple(item.with_value(vector[place].reshape(item.shape)) for item, place in placed(parameters))
