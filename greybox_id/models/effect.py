"""An effect: a phenomenon that a model may lack, as a named transform from model to model.

At its null value an effect leaves the model's predictions unchanged. `model + effect` is a model, whose parts are
transformed as well; the effect's parameters are appended to the model's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar, cast

from ..base.declared import understood
from ..base.errors import BadModel
from ..base.numbers import pretty_unit
from ..base.origin import origin_of
from .memory_model import MemoryModel
from .model import Model, by_kind
from .motion_model import MotionModel
from .parameter import Parameter

AnyModel = TypeVar("AnyModel", bound=Model)


@dataclass(frozen=True, repr=False)
class Effect:
    """A named transform from model to model.

    Attributes
    ----------
    name : of the effect.
    parameter : its magnitude, at its null value.
    touches : signals, parameters or quantities that it changes; a model (or part) with none of them is left as it is.
    needs : names that it reads in addition; a model must have all of them.
    apply : equations of motion that already have the parameters -> the same with the effect.
    apply_to_memory : the same for models with memory; None if it is not defined for them.
    memory_parameter : its magnitude in models with memory, if it differs there.
    others : parameters in addition to its magnitude, usually held.
    typical : a magnitude at which it is clearly present, from which fits start and which sets their scale.
    gradual : whether the derivative of predictions by the magnitude is non-zero at the null value; it is zero for a
        lag, play, limit or square.
    instead_of : effects of which it is an alternative form: a model has one of them or the other.
    group : steering, drive, tyres, body, road, sensors or timing.
    driven_by : those of `needs` that must be inputs of the model, because actuators read them.
    rounds : the input of a motion model that it rounds to integer multiples of its magnitude; empty for none. Such a
        magnitude has a local optimum for every number of steps, so fits try many sizes.
    reads_only : whether it changes only what sensors read, or when: the motion is unchanged, unless the signal is also
        an input.
    by_name : whether a diagnosis tries it only if it is named: on most recordings another effect mimics it.

    Examples
    --------
    >>> import greybox_id as gb
    >>> delay = gb.effects.steering_delay
    >>> delay
    Effect steering_delay: pure delay of the steering command [s], nothing changes at 0
    >>> (gb.models.lateral() + delay.at(0.03)).effects
    ('steering_delay',)
    """

    name: str
    parameter: Parameter
    touches: tuple[str, ...]
    apply: Callable[[MotionModel], MotionModel] | None = None
    apply_to_memory: Callable[[MemoryModel], MemoryModel] | None = None
    memory_parameter: Parameter | None = None
    needs: tuple[str, ...] = ()
    others: tuple[Parameter, ...] = ()
    typical: float = 1.0
    gradual: bool = True
    instead_of: tuple[str, ...] = ()
    group: str = ""
    driven_by: tuple[str, ...] = ()
    by_name: bool = False
    rounds: str = ""
    reads_only: bool = False

    def __post_init__(self) -> None:
        for name in ("parameter", "memory_parameter"):
            value = getattr(self, name)
            if value is not None and value.null is None and value.shape == ():
                object.__setattr__(self, name, replace(value, null=float(value.array)))

    def __repr__(self) -> str:
        value = self.parameter
        unit = "" if value.unit == "1" else f" [{pretty_unit(value.unit)}]"
        null = "" if value.null is None else f", nothing changes at {value.null:g}"
        at = "" if value.null is None or float(value.array) == value.null else f"; here {float(value.array):g}"
        return f"Effect {self.name}: {value.about}{unit}{null}{at}{' (fixed)' if value.fixed else ''}"

    def __call__(self, model: AnyModel) -> AnyModel:
        """Add the effect to a model and to those of its parts that it concerns."""
        if not self.concerns(model):
            raise BadModel(
                f"Effect {self.name} acts on {' and '.join(self.touches)}{self._needing()}, "
                f"but model {model.name} has inputs {', '.join(model.inputs)} and outputs {', '.join(model.outputs)}."
            )
        if self.name in model.effects:
            raise BadModel(f"Model {model.name} already has the effect {self.name}.")
        return self._on(replace(model, parts=tuple(self._on(part) for part in model.parts)))

    def at(self, value: float) -> Effect:
        """The same effect at another magnitude, held when fitting."""
        return self._with(lambda parameter: replace(parameter.with_value(value), fixed=True))

    @understood
    def free(self, start: float | None = None) -> Effect:
        """The same effect, estimated when fitting.

        Parameters
        ----------
        start : initial magnitude of the estimation, in the unit of `parameter`; `typical` by default, since the
            derivatives of many effects vanish at their null value.

        Raises
        ------
        BadInput : `start` lies outside the bounds.

        Examples
        --------
        >>> import greybox_id as gb
        >>> (gb.models.lateral() + gb.effects.steering_delay.free(start=0.03))["steering_delay"].fixed
        False
        """
        value = self.typical if start is None else start
        return self._with(lambda parameter: replace(parameter.with_value(value), fixed=False))

    def starting_at(self, value: float) -> Effect:
        """The same effect with another initial magnitude."""
        return self._with(lambda parameter: parameter.with_value(value))

    def concerns(self, model: Model) -> bool:
        """Whether the effect changes anything in the model."""
        return acting(model, self) is not None

    def _needing(self) -> str:
        needs = [f"the input {name}" if name in self.driven_by else name for name in self.needs]
        return f" and needs {' and '.join(needs)}" if needs else ""

    def _with(self, change: Callable[[Parameter], Parameter]) -> Effect:
        in_memory = self.memory_parameter and change(self.memory_parameter)
        return replace(self, parameter=change(self.parameter), memory_parameter=in_memory)

    def _on(self, model: AnyModel) -> AnyModel:
        acts = acting(model, self)
        if acts is None:
            return model
        magnitude, apply = acts
        value = tuple(parameter for parameter in self.others if parameter.name not in model)
        changed = apply(model.with_parameters(magnitude, *value))
        origin = origin_of(self.apply, self.apply_to_memory)
        origins = {**model.origins, self.name: origin} if origin is not None else model.origins
        return cast(AnyModel, replace(changed, effects=(*model.effects, self.name), origins=origins))


Acting = tuple[Parameter, Callable[[Any], Model]]
"""An effect's magnitude, and the transform of a model that has this parameter."""


@by_kind
def acting(model: Model, effect: Effect) -> Acting | None:
    """Magnitude and transform of an effect for a kind of model; None if it changes nothing there."""
    return None


@acting.register(MotionModel)
def _on_motion(model: MotionModel, effect: Effect) -> Acting | None:
    there = not model.names.isdisjoint(effect.touches) and model.names.issuperset(effect.needs)
    there = there and set(model.inputs).issuperset(effect.driven_by)
    if effect.apply is None or not there:
        return None
    if effect.rounds not in model.inputs:
        return effect.parameter, effect.apply
    rounded = {**model.rounded, effect.parameter.name: effect.rounds}
    return effect.parameter, lambda model: replace(effect.apply(model), rounded=rounded)


@acting.register(MemoryModel)
def _on_memory(model: MemoryModel, effect: Effect) -> Acting | None:
    if effect.apply_to_memory is None or {*model.inputs, *model.outputs}.isdisjoint(effect.touches):
        return None
    return effect.memory_parameter or effect.parameter, effect.apply_to_memory
