"""Named quantities on the way from states to derivatives: where effects take hold of a model."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from ...model import Namespace, Symbol
from ...motion_model import MotionModel

Relax = Callable[[str, Symbol, "NamedQuantities"], Symbol]
"""(quantity, its instantaneous value, q) -> what follows it with a lag."""


class NothingBefore:
    """The quantities before the first pass: all zero."""

    def __getattr__(self, name: str) -> float:
        return 0.0


class NamedQuantities:
    """The `q` of a model's dynamics: assigning a quantity lets its alterations act, reading gives the result.

    Parameters
    ----------
    model : whose alterations act.
    x, u, p : states, inputs and parameters; the latter two are altered here, `stated` are parameters as they were.
    relax : what a relaxation does to an assigned quantity.
    before : the quantities of the pass before; None in the first one, which finds them all zero.
    """

    def __init__(
        self, model: MotionModel, x: Namespace, u: Namespace, p: Namespace, relax: Relax, before: Any = None
    ) -> None:
        vars(self).update(
            x=x, u=SimpleNamespace(**vars(u)), p=SimpleNamespace(**vars(p)), stated=p,
            before=before or NothingBefore(),
            _alterations=model.alterations, _relaxed=_by_quantity(model), _relax=relax,
        )  # fmt: skip
        for name, change in model.alterations:
            for own in (self.p, self.u):
                if hasattr(own, name) and name not in model.quantities:
                    setattr(own, name, change(getattr(own, name), self))

    def __setattr__(self, name: str, value: Symbol) -> None:
        for altered, change in self._alterations:
            if altered == name:
                value = change(value, self)
        if name in self._relaxed:
            value = self._relax(name, value, self)
        vars(self)[name] = value

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"The quantity {name} is not there yet: the dynamics assign it later, or never.")


def _by_quantity(model: MotionModel) -> frozenset[str]:
    return frozenset(relaxation.quantity for relaxation in model.relaxations)
