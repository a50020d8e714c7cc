"""Equations of motion in the order in which the model evaluates them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from ...engine.motion.trace import NamedQuantities
from ...models.model import Namespace
from ...models.model import Symbol as Casadi
from ...models.motion_model import MotionModel
from .expression import SHIFTED, Call, Constant, Equation, Symbol, added, divided, symbols
from .tracing import Reader, is_plain, traced


@traced.register(MotionModel)
def motion_equations(model: MotionModel) -> tuple[Equation, ...]:
    """Equations in the order in which the model evaluates them."""
    return _Written(model).equations()


class _Written:
    def __init__(self, model: MotionModel) -> None:
        self.model = model
        self.read = Reader()
        self.named = self.read.named
        self.made: list[Equation] = []

    def equations(self) -> tuple[Equation, ...]:
        model = self.model
        x = SimpleNamespace(**{state.name: self.named(Symbol(state.name)) for state in model.states})
        u = SimpleNamespace(**{name: self.named(self._input(name)) for name in model.inputs})
        p = SimpleNamespace(
            **{
                parameter.name: self._parameter(parameter.name, parameter.shape, parameter.size)
                for parameter in model.parameters
            }
        )
        q = _Recorded(self, x, u, p)
        rates = dict(model.dynamics(q.x, q.u, q.p, q))
        dotted = {name: self.named(Symbol(name, dots=1)) for name in (state.name for state in model.states)}
        vars(q)["rates"] = SimpleNamespace(**dotted)
        for more in model.extra_rates:
            rates |= more(q)
        quantities, self.made = self.made, []
        derivatives = [
            Equation(Symbol(name, dots=1), self.read(rates[name]))
            for name in dotted
            if self.read(rates[name]) != Constant(0.0)
        ]
        return (*self._needed(quantities, derivatives, self._readings(q)), *derivatives, *self.made, *self._late())

    def _input(self, name: str) -> Symbol:
        delayed = any(signal == name for signal, _ in self.model.delays)
        return Symbol(name, mark="late" if delayed else "")

    def _parameter(self, name: str, shape: tuple[int, ...], size: int) -> Any:
        if shape == ():
            return self.named(Symbol(name))
        return [self.named(Symbol(name, entry=(k + 1,))) for k in range(size)]

    def _readings(self, q: Any) -> list[Equation]:
        """Readings of sensors that differ from the quantity itself."""
        read = SimpleNamespace(**{name: self.named(Symbol(name)) for name in self.model.outputs})
        for sensor in self.model.sensors:
            for name, value in sensor(read, q).items():
                if name in self.model.outputs:
                    setattr(read, name, value)
        result = [Equation(Symbol(name, mark="read"), self.read(getattr(read, name))) for name in self.model.outputs]
        self.made = [item for item in result if item.right != Symbol(item.left.name)]
        return self.made

    def _needed(self, quantities: list[Equation], *others: list[Equation]) -> list[Equation]:
        """Quantities that influence a derivative or a reading."""
        target = set(self.model.outputs) | {s.name for other in others for e in other for s in symbols(e.right)}
        kept: list[Equation] = []
        for quantity in reversed(quantities):
            if quantity.left.name in target:
                target |= {s.name for s in symbols(quantity.right)}
                kept.insert(0, quantity)
        return kept

    def _late(self) -> list[Equation]:
        """Equations of delayed inputs and readings."""
        p = SimpleNamespace(
            **{
                parameter.name: self._parameter(parameter.name, parameter.shape, parameter.size)
                for parameter in self.model.parameters
            }
        )
        shifts = [(Symbol(name, mark="late"), Symbol(name), by) for name, by in self.model.delays]
        shifts += [(Symbol(name, mark="late"), Symbol(name, mark="read"), by) for name, by in self.model.latencies]
        return [Equation(late, Call(SHIFTED, (early, self.read(by(p))))) for late, early, by in shifts]

    def recorded(self, name: str, value: Casadi) -> Casadi:
        """Record a quantity's equation and return its symbol, which later equations use."""
        right = self.read(value)
        if is_plain(right):
            return value
        self.made.append(Equation(Symbol(name), right))
        return self.named(Symbol(name))

    def relaxed(self, name: str, value: Casadi, q: Any) -> Casadi:
        """Record a quantity's first-order lag behind its steady value and return its symbol."""
        time_constant = next(
            relaxation.time_constant for relaxation in self.model.relaxations if relaxation.quantity == name
        )
        symbol = self.named(Symbol(name))
        behind = added(self.read(value), Symbol(name), minus=True)
        try:
            lag = self.read(time_constant(q))
        except AttributeError:  # depends on quantities that the dynamics assign later
            lag = Symbol(f"tau_{name}")
        self.made.append(Equation(Symbol(name, dots=1), divided(behind, lag)))
        return symbol


class _Recorded(NamedQuantities):
    """Quantities that record the equations of what they are assigned."""

    def __init__(self, written: _Written, x: Namespace, u: Namespace, p: Namespace) -> None:
        model = written.model
        vars(self)["_written"] = written
        super().__init__(model, x, u, p, written.relaxed, before=_Before(written) if model.passes > 1 else None)
        for item, before in ((self.u, u), (self.p, p)):
            for name, value in vars(before).items():
                altered = getattr(item, name)
                if altered is not value:
                    symbol = Symbol(name, mark="′")
                    written.made.append(Equation(symbol, written.read(altered)))
                    setattr(item, name, written.named(symbol))

    def __setattr__(self, name: str, value: Casadi) -> None:
        super().__setattr__(name, value)
        if name in self._written.model.quantities and name not in self._relaxed:
            vars(self)[name] = self._written.recorded(name, vars(self)[name])


class _Before:
    """Quantities of the previous pass; at convergence, the quantities themselves."""

    def __init__(self, written: _Written) -> None:
        self._written = written

    def __getattr__(self, name: str) -> Casadi:
        return self._written.named(Symbol(name))
