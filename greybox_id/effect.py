"""An effect: something a model may lack, as a named transform from model to model.

At its null value an effect leaves the model's predictions unchanged. `model + effect` is a model, and so
are its parts; the effect's parameters are appended to the model's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from .errors import BadModel
from .model import Model
from .parameter import Parameter


@dataclass(frozen=True)
class Effect:
    """A named transform from model to model.

    Attributes
    ----------
    name : the word it is called by.
    parameter : its magnitude, at its null value.
    touches : signals it acts on; a model (or part) that has none of them is left as it is.
    apply : model that already has the parameter -> model with the effect.
    """

    name: str
    parameter: Parameter
    touches: tuple[str, ...]
    apply: Callable[[Model], Model]

    def __call__(self, model: Model) -> Model:
        """Put the effect on a model and on those of its parts that it concerns."""
        if not self._concerns(model):
            raise BadModel(
                f"Effect {self.name} acts on {' and '.join(self.touches)}, "
                f"but model {model.name} has inputs {', '.join(model.inputs)} and outputs {', '.join(model.outputs)}."
            )
        if self.name in model.effects:
            raise BadModel(f"Model {model.name} already has the effect {self.name}.")
        return self._on(replace(model, parts=tuple(self._on(part) for part in model.parts)))

    def at(self, value: float) -> Effect:
        """The same effect at another magnitude, held there when fitting."""
        return replace(self, parameter=replace(self.parameter.with_value(value), fixed=True))

    def _concerns(self, model: Model) -> bool:
        return any(signal in (*model.inputs, *model.outputs) for signal in self.touches)

    def _on(self, model: Model) -> Model:
        if not self._concerns(model):
            return model
        changed = self.apply(model.with_parameters(self.parameter))
        return replace(changed, effects=(*model.effects, self.name))
