"""The variables of a functional mock-up unit: names, value references, units, starts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

from ..equations import Equations, Named
from ..subject import Subject
from .steps import Steps

REFERENCES = 1000
"""A value reference is this times the kind, plus the place; as the C has it."""
KINDS = ("time", "input", "output", "state", "rate", "parameter", "setting")


@dataclass(frozen=True)
class Variable:
    """A variable.

    Attributes
    ----------
    name : unique, in FMI's structured notation.
    kind : one of `KINDS`.
    place : among its kind.
    unit, about : SI; for people.
    start : None where it is computed.
    low, high : bounds, where there are any.
    interval : 95 % interval of an estimate.
    """

    name: str
    kind: str
    place: int
    unit: str
    about: str = ""
    start: float | None = None
    low: float | None = None
    high: float | None = None
    interval: tuple[float, float] | None = None

    @property
    def reference(self) -> int:
        """The value reference."""
        return REFERENCES * KINDS.index(self.kind) + self.place


def continuous(equations: Equations) -> bool:
    """Whether the model is a differential equation and nothing besides, so that any integrator may have it."""
    model = equations.model
    return not (model.actuators or model.relaxations or equations.delayed or equations.late)


def starts(entries: tuple[Named, ...]) -> list[float]:
    """Where states and inputs start unless somebody says otherwise: at rest."""
    return [0.0] * len(entries)


def variables_of(subject: Subject, steps: Steps) -> list[Variable]:
    """All variables, in the order in which they stand in the description."""
    e = subject.equations
    inputs = {own.name for own in e.inputs}
    found = [Variable("time", "time", 0, "s", "simulation time")]
    found += [Variable(i.name, "input", k, i.unit, i.about, 0.0) for k, i in enumerate(e.inputs)]
    for k, own in enumerate(e.outputs):
        name = f"reading.{own.name}" if own.name in inputs else own.name
        found.append(Variable(name, "output", k, own.unit, own.about or "as its sensor reads it"))
    for k, own in enumerate(e.states):
        found.append(Variable(f"state.{own.name}", "state", k, own.unit, own.about, 0.0))
    if continuous(e):
        found += [
            Variable(f"der(state.{own.name})", "rate", k, f"{own.unit} s^-1", f"derivative of {own.name}")
            for k, own in enumerate(e.states)
        ]
    found += _parameters(subject)
    about = "longest inner step of the Runge-Kutta method; near standstill shorter ones are taken where it is stiff"
    return [*found, Variable("settings.longest_step", "setting", 0, "s", about, steps.longest, 0.0)]


def _parameters(subject: Subject) -> Iterator[Variable]:
    e = subject.equations
    told = {p.name: p for p in subject.model.parameters}
    intervals = subject.described()["parameters"]
    for k, (own, value) in enumerate(zip(e.parameters, e.values.tolist(), strict=True)):
        parameter = told.get(own.name)
        low, high = (None, None) if parameter is None else _bounds(parameter.bounds, value)
        interval = None if parameter is None else intervals[own.name]["interval"]
        yield Variable(
            f"parameters.{own.name}", "parameter", k, own.unit, own.about, value, low, high,
            None if interval is None else (float(interval[0]), float(interval[1])),
        )  # fmt: skip


def _bounds(bounds: tuple[float, float], value: float) -> tuple[float | None, float | None]:
    """Finite ones that the value keeps to."""
    low, high = bounds
    return low if isfinite(low) and low <= value else None, high if isfinite(high) and value <= high else None
