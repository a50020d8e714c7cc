"""Named quantities on the way from states to derivatives: where effects take hold, and lags relax, in a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import factorial
from types import SimpleNamespace
from typing import Any

import casadi as cs

from ...models.model import Namespace, Symbol
from ...models.motion_model import MotionModel
from ...models.transient import SERIES, mean_and_slope

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
            for item in (self.p, self.u):
                if hasattr(item, name) and name not in model.quantities:
                    setattr(item, name, change(getattr(item, name), self))

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


JUST_AFTER = 1e-5
"""Row k's measurements are taken just after its commands, s."""
TINY_TIME = 1e-15
"""Added to time constants, s: the limit of no lag without a division by zero."""
TINY_RATIO = 1e-9
"""Added to a step over the time constant: segments that only fill up have no length."""

TimeConstants = Mapping[str, Callable[[NamedQuantities], Symbol]]
"""Relaxed quantity -> q -> s."""


def without_lag(name: str, value: Symbol, q: NamedQuantities) -> Symbol:
    """No lag at all."""
    del name, q
    return value


def just_after(standing: Mapping[str, Symbol], time_constants: TimeConstants) -> Relax:
    """What is seen `JUST_AFTER` the quantities stood where they are `standing`."""

    def relax(name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        T = time_constants[name](q) + TINY_TIME
        return value + (standing[name] - value) * cs.exp(-JUST_AFTER / T)

    return relax


def moves_just_after(standing: Mapping[str, Symbol], time_constants: TimeConstants, moves: dict[str, Symbol]) -> Relax:
    """As `just_after`; by how much each quantity has moved is left in `moves`, without cancelling digits."""
    seen = just_after(standing, time_constants)

    def relax(name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        moves[name] = (standing[name] - value) * cs.expm1(-JUST_AFTER / (time_constants[name](q) + TINY_TIME))
        return seen(name, value, q)

    return relax


def following(paths: Mapping[str, Path], stage: Callable[[Path, Symbol, NamedQuantities], Symbol]) -> Relax:
    """What a stage of a Runge-Kutta step makes of each relaxed quantity."""
    return lambda name, value, q: stage(paths[name], value, q)


class Path:
    """A quantity that follows its instantaneous value w with a first-order lag T, over one Runge-Kutta step.

    Over a step of h seconds w runs straight, by a, from where it starts; what follows is a steady lag and a transient:

        w - a T / h + (y - w_0 + a T / h) exp(-t / T)

    T may be much shorter than a step. A transient sampled at the stages alone would then weigh h / 6 instead of T, so
    stages see the straight line of its mean and first moment in its place, as actuators do with commands. The first
    stage does not know a yet; what it lacks the later ones make up for, so that mean and first moment over the step are
    exact again. Where the quantity stands at the end follows from a parabola through w at the stages (Cox & Matthews,
    J. Comput. Phys. 176 (2002), treat such exponential formulas in general).

    Parameters
    ----------
    standing : where it is at the beginning.
    time_constant : T, s.
    h : the step, s.
    """

    def __init__(self, standing: Symbol, time_constant: Callable[[NamedQuantities], Symbol], h: Symbol) -> None:
        self.standing, self.time_constant, self.h = standing, time_constant, h

    def first(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """The first stage."""
        self.w_0, self.off = value, self.standing - value
        self.ratio = r = self._ratio(q)
        self.mean, self.slope = mean_and_slope(r)
        return value + self.off * self._transient(0.0)

    def second(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """The second stage, halfway."""
        del q
        self.w_second = value
        return self._halfway(value)

    def third(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """The third stage, halfway."""
        self.w_third, self.ratio_half = value, self._ratio(q)
        return self._halfway(value)

    def fourth(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """The fourth stage."""
        del q
        return value + self._lag(value - self.w_0, 1.0) - self._lacking(value - self.w_0)

    def end(self, value: Symbol, q: NamedQuantities) -> Symbol:
        """Where the quantity stands at the end."""
        del q
        r = self.ratio_half
        weights = [_weight(r, power) for power in range(3)]
        w_half = (self.w_second + self.w_third) / 2  # their errors are opposite
        rise = 4 * w_half - 3 * self.w_0 - value
        bend = 2 * self.w_0 - 4 * w_half + 2 * value
        return cs.exp(-r) * self.standing + weights[0] * self.w_0 + weights[1] * rise + weights[2] * bend

    def _halfway(self, value: Symbol) -> Symbol:
        a = 2 * (value - self.w_0)
        return value + self._lag(a, 0.5) + self._lacking(a) / 2

    def _ratio(self, q: NamedQuantities) -> Symbol:
        return self.h / (self.time_constant(q) + TINY_TIME) + TINY_RATIO

    def _lag(self, a: Symbol, share: float) -> Symbol:
        """What the quantity differs from its instantaneous value by."""
        behind = a / self.ratio
        return (self.off + behind) * self._transient(share) - behind

    def _lacking(self, a: Symbol) -> Symbol:
        """What the first stage lacks for not knowing a."""
        return a / self.ratio * (self._transient(0.0) - 1)

    def _transient(self, share: float) -> Symbol:
        """The line of the mean and first moment of exp(-t / T), at a share of the step."""
        return self.mean + self.slope * (share - 0.5)


def _weight(r: Symbol, power: int) -> Symbol:
    """Integral of r exp(-r (1 - s)) s^power over s from 0 to 1."""
    if power == 0:
        return -cs.expm1(-r)
    series = sum((-r) ** n * factorial(power) / factorial(power + 1 + n) for n in range(6))
    return cs.if_else(r < SERIES, r * series, 1 - power / r * _weight(r, power - 1))
