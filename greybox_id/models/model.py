"""A model: equations over named symbols. It holds no data and no solver.

There are three kinds: equations of motion, with states and their derivatives (motion_model.py); discrete maps, whose
next outputs follow from windows of past inputs (memory_model.py); and physics with a network inside (hybrid_model.py).
This module has what all kinds share.

Operations that differ between kinds are functions with one implementation per kind:

    @by_kind
    def simulate(model: Model, recording: Recording) -> Prediction:
        "Free run of every run of a recording."
        raise BadInput(f"{model.name} is not simulated.")  # for kinds without an implementation

    @simulate.register(MotionModel)
    def _simulated(model: MotionModel, recording: Recording) -> Prediction: ...

A package declares such a function in one of its modules; others call it like any function. The implementation for a
kind is in a module of that package named after `Model.kind` (`fitting/scores/motion.py`, `fitting/motion.py`), which is
imported when first needed, or in any other module that calls `register`. So a new kind changes no existing file.

Hyperparameters of models are plain data, read from files and options, and checked field by field.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache, update_wrapper
from html import escape
from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType, SimpleNamespace
from typing import (
    Any,
    ClassVar,
    Concatenate,
    Generic,
    ParamSpec,
    Self,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from ..base.declared import understood
from ..base.errors import BadInput, BadModel, near
from ..base.origin import Origin, origin_of
from ..base.shorthands import Array
from ..base.signals import unit_of, unit_of_quantity
from .parameter import Parameter, pack, unpack

Symbol = Any
"""A CasADi SX expression; CasADi ships no type information."""

Namespace = SimpleNamespace
"""Symbols by name: u.v_x, p.m."""


@dataclass(frozen=True)
class Combination:
    """A function of several parameters that a recording may determine better than each of them.

    Attributes
    ----------
    name : as printed: "l_f + l_r".
    unit : SI unit in pint's spelling.
    of : parameters by name (symbols or numbers) -> the value.
    about : meaning, for people.
    scaled_by : the quantity of the equations that multiplies it, nominally 1; a tracker estimates it through this one.
    """

    name: str
    unit: str
    of: Callable[[Namespace], Any]
    about: str = ""
    scaled_by: str = ""


@dataclass(frozen=True, kw_only=True, repr=False)
class Model:
    """Attributes of every model.

    Attributes
    ----------
    name : on the command line.
    about : one sentence.
    inputs : recorded signals that the equations read.
    outputs : recorded signals that they predict.
    parameters : in the order of the parameter vector.
    defaults : input name -> value if a recording lacks it (a flat road).
    symmetric : whether the vehicle is assumed to be mirror-symmetric; fitting then uses every recording mirrored too.
    settings : hyperparameters from which the model was built, for the record.
    effects : names of the effects added to it.
    together : sentences on parameters that appear in the equations only in combination.
    combinations : quantities to report with the parameters.
    origins : name of an effect that greybox-id does not ship -> where its equations are defined.
    aliases : input -> signals that can serve as this input; the first one recorded is used.
    parts : models of some of the outputs that can be fitted alone first; they share parameters by name.
    units : SI units of inputs, outputs and quantities that are not known signals, by name.
    kind : class attribute: name of the modules with implementations for its models (see `by_kind`).
    called : class attribute: what its models are called in sentences.

    Examples
    --------
    >>> import greybox_id as gb
    >>> model = gb.models.lateral(vehicle="roboracer") + gb.effects.steering_delay.free(start=0.03)
    >>> model
    Model lateral + steering_delay: single-track vehicle at a measured speed, two degrees of freedom
      inputs   steer, v_x
      outputs  v_y, yaw_rate, a_y
      free     m, I_z, l_f, l_r, B_f, C_f, D_f, B_r, C_r, D_r, steering_delay
      fixed    h_cg, track_f, track_r, E_f, S_h_f, S_v_f, E_r, S_h_r, S_v_r
    >>> float(model["steering_delay"].value)
    0.03
    """

    name: str
    about: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    defaults: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    symmetric: bool = False
    settings: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    effects: tuple[str, ...] = ()
    together: tuple[str, ...] = ()
    combinations: tuple[Combination, ...] = ()
    origins: Mapping[str, Origin] = field(default_factory=lambda: MappingProxyType({}))
    aliases: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    parts: tuple[Model, ...] = ()
    units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    kind: ClassVar[str] = ""
    called: ClassVar[str] = "a model of its own kind"

    def unit(self, name: str) -> str:
        """SI unit of a signal or a quantity: as stated in `units`, else by its name, else "1"."""
        return self.units.get(name) or unit_of(name, unit_of_quantity(name))

    def __repr__(self) -> str:
        names = {
            "inputs": self.inputs,
            "outputs": self.outputs,
            "free": tuple(p.name for p in self.parameters if not p.fixed),
            "fixed": tuple(p.name for p in self.parameters if p.fixed),
        }
        lines = [f"  {title:8} {_listed(name)}" for title, name in names.items() if name]
        return "\n".join([f"Model {' + '.join((self.name, *self.effects))}: {self.about}", *lines])

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def __post_init__(self) -> None:
        names = [parameter.name for parameter in self.parameters]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise BadModel(f"Model {self.name} has two parameters of the name {', '.join(twice)}.")

    def __getitem__(self, name: str) -> Parameter:
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        names = [parameter.name for parameter in self.parameters]
        raise BadModel(f"Model {self.name} has no parameter {name!r}; it has {', '.join(names)}.{near(name, names)}")

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Itself: it is immutable, and functions and read-only mappings cannot be copied."""
        return self

    def __contains__(self, name: object) -> bool:
        return any(parameter.name == name for parameter in self.parameters)

    @understood
    def __add__(self, effect: Callable[[Self], Self]) -> Self:
        """The model with an effect."""
        return effect(self)

    @property
    def origin(self) -> Origin | None:
        """Where the equations are defined; None for models that greybox-id ships."""
        return origin_of(*vars(self).values())

    @property
    def size(self) -> int:
        """Total number of values in the parameters."""
        return sum(parameter.size for parameter in self.parameters)

    @property
    def values(self) -> Array:
        """Nominal values of all parameters as one vector."""
        return pack(self.parameters)

    def with_values(self, vector: Array) -> Self:
        """The same model with other parameter values."""
        return replace(self, parameters=unpack(self.parameters, vector))

    def with_parameters(self, *parameters: Parameter) -> Self:
        """The same model with the named parameters replaced, or appended if it has none of that name."""
        new = {parameter.name: parameter for parameter in parameters}
        kept = tuple(new.pop(parameter.name, parameter) for parameter in self.parameters)
        return replace(self, parameters=kept + tuple(new.values()))


MOST_LISTED = 12
"""Largest number of names in a line of a model's `repr`."""


def _listed(names: tuple[str, ...]) -> str:
    more = len(names) - MOST_LISTED
    return ", ".join(names[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


P = ParamSpec("P")
T = TypeVar("T")
Kind = TypeVar("Kind", bound=Model)


class ByKind(Generic[P, T]):
    """A function of a model with one implementation per kind of model.

    Parameters
    ----------
    otherwise : implementation for kinds without their own, often one that raises an error with the reason.
    """

    def __init__(self, otherwise: Callable[Concatenate[Model, P], T]) -> None:
        self._answers: dict[type[Model], Callable[..., T]] = {Model: otherwise}
        self._floor = otherwise.__module__.rpartition(".")[0]
        update_wrapper(self, otherwise)

    def __call__(self, model: Model, /, *args: P.args, **kwargs: P.kwargs) -> T:
        """Call the implementation for the model's kind."""
        for kind in type(model).__mro__:
            if kind not in self._answers and vars(kind).get("kind"):
                _load(f"{self._floor}.{vars(kind)['kind']}")
            if kind in self._answers:
                return self._answers[kind](model, *args, **kwargs)
        raise TypeError(f"{model!r:.60} is no model.")

    def register(
        self, kind: type[Kind]
    ) -> Callable[[Callable[Concatenate[Kind, P], T]], Callable[Concatenate[Kind, P], T]]:
        """Decorator: registers the implementation for a kind and its subclasses."""

        def keep(answer: Callable[Concatenate[Kind, P], T]) -> Callable[Concatenate[Kind, P], T]:
            self._answers[kind] = answer
            return answer

        return keep


def by_kind(otherwise: Callable[Concatenate[Model, P], T]) -> ByKind[P, T]:
    """Decorator: a function whose first argument is a model, with one implementation per kind."""
    return ByKind(otherwise)


def must_be(kind: type[Kind], model: Model, otherwise: str = "") -> Kind:
    """The model if it is of the kind needed. Raises `BadInput` with that sentence otherwise."""
    if isinstance(model, kind):
        return model
    raise BadInput(otherwise or f"{model.name} is {model.called}; {kind.called} is needed here.")


@cache
def _load(module: str) -> None:
    if find_spec(module) is not None:
        import_module(module)


Settings = TypeVar("Settings")


@dataclass(frozen=True)
class NoSettings:
    """Hyperparameters of models that have none."""


def from_mapping(kind: type[Settings], values: Mapping[str, Any], where: str = "") -> Settings:
    """A settings dataclass from plain data.

    Raises
    ------
    BadInput : an unknown name, or a value of the wrong type; the error says which, and what is accepted.
    """
    hints = get_type_hints(kind)
    known = [f.name for f in fields(cast(Any, kind))]
    there_are = f"there are {', '.join(where + name for name in known)}" if known else "there are none"
    for name in values:
        if name not in known:
            raise BadInput(
                f"There is no setting {where}{name}; {there_are}.{near(where + name, (where + one for one in known))}"
            )
    return kind(**{name: _value(hints[name], value, where + name) for name, value in values.items()})


def within(settings: object, **limits: tuple[float, float]) -> None:
    """Raise `BadInput` if a hyperparameter is outside its limits."""
    for name, (low, high) in limits.items():
        value = getattr(settings, name)
        if not low <= value <= high:
            raise BadInput(f"Setting {name} must lie between {low:g} and {high:g}; {value:g} was given.")


def _value(hint: Any, value: Any, name: str) -> Any:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in get_args(hint):
            return None
        hint = next(h for h in get_args(hint) if h is not type(None))
        origin = get_origin(hint)
    if is_dataclass(hint) and isinstance(hint, type):
        if not isinstance(value, Mapping):
            raise BadInput(f"Setting {name} is a group of settings, but {value!r} was given.")
        return from_mapping(hint, value, f"{name}.")
    if origin is tuple:
        if not isinstance(value, (list, tuple)) or not value:
            raise BadInput(f"Setting {name} is a list of numbers, but {value!r} was given.")
        return tuple(_value(float, v, name) for v in value)
    if hint is bool and isinstance(value, bool):
        return value
    if hint is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if hint is str and isinstance(value, str):
        return value
    raise BadInput(f"Setting {name} is a {getattr(hint, '__name__', hint)}, but {value!r} was given.")
