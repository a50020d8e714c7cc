"""A model: equations over named symbols. It holds no data and no solver.

There are three kinds: a page of equations of motion, states and their derivatives (motion_model.py); a discrete map,
whose next outputs follow from windows of past inputs (memory_model.py); and physics with a network inside
(hybrid_model.py). What every model is known by stands here; what is done with each kind in a way of its own, in modules
of its name (kinds.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from html import escape
from types import MappingProxyType, SimpleNamespace
from typing import Any, ClassVar, Self

from ..base.declared import understood
from ..base.errors import BadModel, near
from ..base.origin import Origin, origin_of
from ..base.shorthands import Array
from .parameter import Parameter, pack, unpack

Symbol = Any
"""A CasADi SX expression; CasADi ships no type information."""

Namespace = SimpleNamespace
"""Symbols by name: u.v_x, p.m."""


@dataclass(frozen=True)
class Combination:
    """A quantity made of several parameters, which a recording may tell better than each of them.

    Attributes
    ----------
    name : as a person would write it: "l_f + l_r".
    unit : SI unit in pint's spelling.
    of : parameters by name (symbols or numbers) -> the quantity.
    about : meaning, for people.
    scaled_by : the quantity of the equations that scales it, 1 nominally; it is tracked through this one.
    """

    name: str
    unit: str
    of: Callable[[Namespace], Any]
    about: str = ""
    scaled_by: str = ""


@dataclass(frozen=True, kw_only=True, repr=False)
class Model:
    """What every model is known by.

    Attributes
    ----------
    name : the word it is called by on the command line.
    about : one sentence.
    inputs : recorded signals the equations read.
    outputs : recorded signals they predict.
    parameters : in the order of the parameter vector.
    defaults : input name -> value taken when a recording lacks it (a flat road).
    symmetric : the vehicle is taken to be the same in a mirror; fitting then sees every recording mirrored too.
    settings : hyperparameters from which the model was built, for the record.
    effects : names of the effects added to it.
    together : sentences on parameters that the equations let appear only in combinations.
    combinations : quantities to report beside the parameters.
    origins : name of an effect that greybox-id does not ship -> where its equations come from.
    aliases : input -> signals any one of which is that input, the first one recorded counts.
    parts : models of some of the outputs that can be fitted alone first; they share parameters by name.
    kind : of a class, what the modules are called that deal with its models (see kinds.py).
    called : of a class, what its models are, for people.

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
    kind: ClassVar[str] = ""
    called: ClassVar[str] = "a model of its own kind"

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
        """Itself: nothing in it changes, and functions and read-only mappings have no copies."""
        return self

    def __contains__(self, name: object) -> bool:
        return any(parameter.name == name for parameter in self.parameters)

    @understood
    def __add__(self, effect: Callable[[Self], Self]) -> Self:
        """The model with an effect."""
        return effect(self)

    @property
    def origin(self) -> Origin | None:
        """Where the equations come from; None for models that greybox-id ships."""
        return origin_of(*vars(self).values())

    @property
    def size(self) -> int:
        """How many numbers the parameters hold."""
        return sum(parameter.size for parameter in self.parameters)

    @property
    def values(self) -> Array:
        """Nominal values of all parameters as one vector."""
        return pack(self.parameters)

    def with_values(self, vector: Array) -> Self:
        """The same model with other parameter values."""
        return replace(self, parameters=unpack(self.parameters, vector))

    def with_parameters(self, *parameters: Parameter) -> Self:
        """The same model with the named parameters replaced, or appended when it has none of that name."""
        new = {parameter.name: parameter for parameter in parameters}
        kept = tuple(new.pop(parameter.name, parameter) for parameter in self.parameters)
        return replace(self, parameters=kept + tuple(new.values()))


MOST_LISTED = 12
"""Names in a line of a model's `repr`."""


def _listed(names: tuple[str, ...]) -> str:
    more = len(names) - MOST_LISTED
    return ", ".join(names[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
