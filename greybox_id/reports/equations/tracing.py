"""A model's equations, written down by running them once with CasADi's symbols."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import casadi as cs
import numpy as np

from ...engine.motion.quantities import NamedQuantities
from ...hybrid_model import FeedForwardNetwork, HybridModel
from ...memory_model import MemoryModel
from ...model import Namespace
from ...model import Symbol as Casadi
from ...motion_model import MotionModel
from .expression import (
    SHIFTED,
    Call,
    Cases,
    Comparison,
    Constant,
    Equation,
    Expression,
    Power,
    Quotient,
    Sum,
    Symbol,
    Window,
    added,
    divided,
    multiplied,
    symbols,
)

ONE_ARGUMENT = {
    cs.OP_EXP: "exp", cs.OP_LOG: "ln", cs.OP_SQRT: "sqrt", cs.OP_SIN: "sin", cs.OP_COS: "cos", cs.OP_TAN: "tan",
    cs.OP_ASIN: "arcsin", cs.OP_ACOS: "arccos", cs.OP_ATAN: "arctan", cs.OP_FABS: "abs", cs.OP_SIGN: "sgn",
    cs.OP_SINH: "sinh", cs.OP_COSH: "cosh", cs.OP_TANH: "tanh", cs.OP_ERF: "erf", cs.OP_FLOOR: "floor",
    cs.OP_CEIL: "ceil", cs.OP_NOT: "not", cs.OP_LOG1P: "log1p", cs.OP_EXPM1: "expm1", cs.OP_ASINH: "arsinh",
}  # fmt: skip
TWO_ARGUMENTS = {cs.OP_FMIN: "min", cs.OP_FMAX: "max", cs.OP_ATAN2: "arctan2", cs.OP_HYPOT: "hypot", cs.OP_FMOD: "mod"}
SIGNS = {cs.OP_LT: "<", cs.OP_LE: "≤", cs.OP_EQ: "=", cs.OP_NE: "≠", cs.OP_AND: "and", cs.OP_OR: "or"}

TWO = Constant(2.0)


class Reader:
    """Reads CasADi expressions whose symbols are known.

    Parameters
    ----------
    known : name of a CasADi symbol -> what it stands for.
    """

    def __init__(self, known: Mapping[str, Expression] | None = None) -> None:
        self.known = dict(known or {})
        self._read: dict[int, Expression] = {}
        self._kept: list[Casadi] = []  # hashes are only unique among nodes that live

    def named(self, expression: Expression, name: str = "") -> Casadi:
        """A CasADi symbol that stands for an expression."""
        name = name or repr(expression)
        self.known[name] = expression
        return cs.SX.sym(name)

    def __call__(self, of: Casadi) -> Expression:
        """One scalar expression."""
        node = cs.SX(of)
        key = node.element_hash()
        if key not in self._read:
            self._kept.append(node)
            self._read[key] = self._made(node)
        return self._read[key]

    def _made(self, node: Casadi) -> Expression:
        if node.is_constant():
            return Constant(float(node))
        if node.is_symbolic():
            return self.known[node.name()]
        op = node.op()
        parts = [node.dep(k) for k in range(node.n_dep())]
        if op in (cs.OP_ADD, cs.OP_SUB):
            cases = self._cases(parts) if op == cs.OP_ADD else None
            return cases or added(self(parts[0]), self(parts[1]), minus=op == cs.OP_SUB)
        if op in ONE_ARGUMENT:
            return Call(ONE_ARGUMENT[op], (self(parts[0]),))
        if op in TWO_ARGUMENTS:
            first, second = self(parts[0]), self(parts[1])
            if op == cs.OP_FMAX and isinstance(first, Call) and first.name == "abs" and second == Constant(0.0):
                return first
            return Call(TWO_ARGUMENTS[op], (first, second))
        if op in SIGNS:
            return Comparison(SIGNS[op], self(parts[0]), self(parts[1]))
        return _ELSE[op](*(self(part) for part in parts))

    def _cases(self, parts: list[Casadi]) -> Expression | None:
        """The sum of a value where something holds and one where it does not."""
        if not all(part.op() == cs.OP_IF_ELSE_ZERO for part in parts if not part.is_leaf()):
            return None
        if any(part.is_leaf() for part in parts):
            return None
        first, second = (part.dep(0) for part in parts)
        if second.op() == cs.OP_NOT and second.dep(0).element_hash() == first.element_hash():
            return Cases(self(first), self(parts[0].dep(1)), self(parts[1].dep(1)))
        if first.op() == cs.OP_NOT and first.dep(0).element_hash() == second.element_hash():
            return Cases(self(second), self(parts[1].dep(1)), self(parts[0].dep(1)))
        return None


_ELSE: dict[int, Callable[..., Expression]] = {
    cs.OP_MUL: multiplied,
    cs.OP_DIV: divided,
    cs.OP_NEG: lambda own: multiplied(Constant(-1.0), own),
    cs.OP_SQ: lambda own: Power(own, TWO),
    cs.OP_TWICE: lambda own: multiplied(TWO, own),
    cs.OP_POW: Power,
    cs.OP_CONSTPOW: Power,
    cs.OP_INV: lambda own: Quotient(Constant(1.0), own),
    cs.OP_IF_ELSE_ZERO: lambda where, value: Cases(where, value, Constant(0.0)),
}


def is_plain(of: Expression) -> bool:
    """Whether an expression is a mere number or another quantity's name."""
    return isinstance(of, Constant | Symbol) or (isinstance(of, Sum) and not of.terms)


def motion_equations(model: MotionModel) -> tuple[Equation, ...]:
    """The model's equations with all effects on them, in the order in which it goes through them."""
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
        p = SimpleNamespace(**{own.name: self._parameter(own.name, own.shape, own.size) for own in model.parameters})
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
        """What sensors read where that is not the quantity itself."""
        read = SimpleNamespace(**{name: self.named(Symbol(name)) for name in self.model.outputs})
        for sensor in self.model.sensors:
            for name, value in sensor(read, q).items():
                if name in self.model.outputs:
                    setattr(read, name, value)
        found = [Equation(Symbol(name, mark="read"), self.read(getattr(read, name))) for name in self.model.outputs]
        self.made = [own for own in found if own.right != Symbol(own.left.name)]
        return self.made

    def _needed(self, quantities: list[Equation], *others: list[Equation]) -> list[Equation]:
        """Quantities that lead to a derivative or to something read."""
        wanted = set(self.model.outputs) | {s.name for own in others for e in own for s in symbols(e.right)}
        kept: list[Equation] = []
        for own in reversed(quantities):
            if own.left.name in wanted:
                wanted |= {s.name for s in symbols(own.right)}
                kept.insert(0, own)
        return kept

    def _late(self) -> list[Equation]:
        """Commands and readings that are late."""
        p = SimpleNamespace(
            **{own.name: self._parameter(own.name, own.shape, own.size) for own in self.model.parameters}
        )
        shifts = [(Symbol(name, mark="late"), Symbol(name), by) for name, by in self.model.delays]
        shifts += [(Symbol(name, mark="late"), Symbol(name, mark="read"), by) for name, by in self.model.latencies]
        return [Equation(late, Call(SHIFTED, (early, self.read(by(p))))) for late, early, by in shifts]

    def recorded(self, name: str, value: Casadi) -> Casadi:
        """A quantity's equation is kept; what comes after it sees its name."""
        right = self.read(value)
        if is_plain(right):
            return value
        self.made.append(Equation(Symbol(name), right))
        return self.named(Symbol(name))

    def relaxed(self, name: str, value: Casadi, q: Any) -> Casadi:
        """A quantity that follows its value with a lag."""
        time_constant = next(own.time_constant for own in self.model.relaxations if own.quantity == name)
        symbol = self.named(Symbol(name))
        behind = added(self.read(value), Symbol(name), minus=True)
        try:
            lag = self.read(time_constant(q))
        except AttributeError:  # it depends on what the dynamics assign later
            lag = Symbol(f"tau_{name}")
        self.made.append(Equation(Symbol(name, dots=1), divided(behind, lag)))
        return symbol


class _Recorded(NamedQuantities):
    """Quantities that write down what they are assigned."""

    def __init__(self, written: _Written, x: Namespace, u: Namespace, p: Namespace) -> None:
        model = written.model
        vars(self)["_written"] = written
        super().__init__(model, x, u, p, written.relaxed, before=_Before(written) if model.passes > 1 else None)
        for own, before in ((self.u, u), (self.p, p)):
            for name, value in vars(before).items():
                altered = getattr(own, name)
                if altered is not value:
                    symbol = Symbol(name, mark="′")
                    written.made.append(Equation(symbol, written.read(altered)))
                    setattr(own, name, written.named(symbol))

    def __setattr__(self, name: str, value: Casadi) -> None:
        super().__setattr__(name, value)
        if name in self._written.model.quantities and name not in self._relaxed:
            vars(self)[name] = self._written.recorded(name, vars(self)[name])


class _Before:
    """The quantities of the pass before: in the end, the quantities themselves."""

    def __init__(self, written: _Written) -> None:
        self._written = written

    def __getattr__(self, name: str) -> Casadi:
        return self._written.named(Symbol(name))


NEXT = "next"
"""Mark of an output one sample after the newest input."""


def memory_equations(model: MemoryModel) -> tuple[Equation, ...]:
    """The model's equations, and what follows from its outputs where it runs on its own."""
    read = Reader()

    def past(signal: Casadi, weights: Sequence[Casadi]) -> Casadi:
        window = Window(_weights(weights, read.known), read(cs.SX(signal)), len(weights))
        return read.named(window, f"window {len(read.known)}")

    u = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.inputs})
    p = SimpleNamespace()
    for own in model.parameters:
        if own.shape == ():
            setattr(p, own.name, read.named(Symbol(own.name)))
            continue
        entries = np.empty(own.shape, dtype=object)
        for index in np.ndindex(own.shape):
            entries[index] = read.named(Symbol(own.name, tuple(k + 1 for k in index)))
        setattr(p, own.name, entries)
    outputs = model.equations(u, p, past)
    found = [Equation(Symbol(name, mark=NEXT), read(cs.SX(outputs[name]))) for name in model.outputs]
    if model.feedback is not None:
        y = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.outputs})
        fed = {name: read(cs.SX(value)) for name, value in model.feedback(y, u).items()}
        found += [Equation(Symbol(name), value) for name, value in fed.items() if value != Symbol(name)]
    return tuple(found)


def _weights(weights: Sequence[Casadi], known: dict[str, Expression]) -> Symbol:
    """The parameter whose last entries they are, without those; a letter where they are something else."""
    found = [known.get(cs.SX(own).name()) if cs.SX(own).is_symbolic() else None for own in weights]
    first = found[0]
    if isinstance(first, Symbol) and first.entry:
        expected = [Symbol(first.name, (*first.entry[:-1], k + 1)) for k in range(len(found))]
        if found == expected:
            return Symbol(first.name, first.entry[:-1])
    return Symbol("g")


SAID = "z"
"""What the network says."""


def hybrid_equations(model: HybridModel) -> tuple[Equation, ...]:
    """Outputs and estimates, then the derivatives of the states."""
    read = Reader()
    x = SimpleNamespace(**{state.name: read.named(Symbol(state.name)) for state in model.states})
    u = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.inputs})
    p = SimpleNamespace(**{own.name: read.named(Symbol(own.name)) for own in model.parameters if own.shape == ()})
    z = [read.named(Symbol(SAID, (k + 1,))) for k in range(model.network.outputs)]
    rates, quantities = model.physics(x, u, p, z)
    wanted = [*model.estimates, *(name for name in model.outputs if name not in model.estimates)]
    found = [Equation(Symbol(name), read(quantities[name])) for name in wanted if name in quantities]
    found += [Equation(Symbol(name, dots=1), read(rate)) for name, rate in rates.items()]
    return tuple(own for own in found if own.right != Symbol(own.left.name))


def network_words(model: HybridModel) -> str:
    """What the network reads and how large it is, in a sentence."""
    network = model.network
    if isinstance(network, FeedForwardNetwork):
        units = {"tanh": "hyperbolic tangents", "relu": "rectified linear units"}[network.activation]
        layers = ", ".join(map(str, network.hidden))
        mirrored = (
            " It is odd: what it says of a left turn, mirrored, it says of a right one." if network.mirrored else ""
        )
        return (
            f"z is what a feed-forward network of {layers} {units} says from {network.features} features of states and "
            f"inputs; its last layer is linear.{mirrored}"
        )
    layers = ", ".join(map(str, network.hidden))
    skip = " and straight from what it reads" if network.skip else ""
    return (
        f"z is what a recurrent network of {layers} rectified linear units says at every row from {network.features} "
        f"features of states and inputs and from what its layers said a row before; its last layer is linear{skip}."
    )
