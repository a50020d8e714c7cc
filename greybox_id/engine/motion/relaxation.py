"""Quantities that follow their instantaneous value w with a first-order lag T, over the stages of one Runge-Kutta step.

Over a step of h seconds w runs straight, by a, from where it starts; what follows it is a steady lag and a transient:

    w - a T / h + (y - w_0 + a T / h) exp(-t / T)

T may be much shorter than a step. A transient sampled at the stages alone would then weigh h / 6 instead of T, so
stages see the straight line of its mean and first moment in its place, as actuators do with commands. The first stage
does not know a yet; what it lacks the later ones make up for, so that mean and first moment over the step are exact
again. Where the quantity stands at the end follows from a parabola through w at the stages (Cox & Matthews,
J. Comput. Phys. 176 (2002), treat such exponential formulas in general).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import factorial

import casadi as cs

from ...model import Symbol
from ...transient import SERIES, mean_and_slope
from .quantities import NamedQuantities, Relax

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


class Following:
    """The relaxed quantities of one step.

    Parameters
    ----------
    standing : where they are at its beginning.
    time_constants : theirs.
    h : the step, s.
    """

    def __init__(self, standing: Mapping[str, Symbol], time_constants: TimeConstants, h: Symbol) -> None:
        self._paths = {name: _Path(y, time_constants[name], h) for name, y in standing.items()}

    def first(self, name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        """The first stage."""
        return self._paths[name].first(value, q)

    def second(self, name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        """The second stage, halfway."""
        return self._paths[name].second(value, q)

    def third(self, name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        """The third stage, halfway."""
        return self._paths[name].third(value, q)

    def fourth(self, name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        """The fourth stage."""
        del q
        return self._paths[name].fourth(value)

    def end(self, name: str, value: Symbol, q: NamedQuantities) -> Symbol:
        """Where the quantity stands at the end."""
        del q
        return self._paths[name].end(value)


class _Path:
    """One quantity over one step."""

    def __init__(self, standing: Symbol, time_constant: Callable[[NamedQuantities], Symbol], h: Symbol) -> None:
        self.standing, self.time_constant, self.h = standing, time_constant, h

    def first(self, value: Symbol, q: NamedQuantities) -> Symbol:
        self.w_0, self.off = value, self.standing - value
        self.ratio = r = self._ratio(q)
        self.mean, self.slope = mean_and_slope(r)
        return value + self.off * self._transient(0.0)

    def second(self, value: Symbol, q: NamedQuantities) -> Symbol:
        del q
        self.w_second = value
        return self._halfway(value)

    def third(self, value: Symbol, q: NamedQuantities) -> Symbol:
        self.w_third, self.ratio_half = value, self._ratio(q)
        return self._halfway(value)

    def fourth(self, value: Symbol) -> Symbol:
        return value + self._lag(value - self.w_0, 1.0) - self._lacking(value - self.w_0)

    def end(self, value: Symbol) -> Symbol:
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
