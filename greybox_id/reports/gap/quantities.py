"""Magnitudes of effects for people: in a unit of handy size, to as many digits as their intervals allow."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from ...gap import Ranked
from ...models.effects import EFFECTS
from ..numbers import interval, number, pretty_unit, short_with_sd, together

NORMAL = 1.959964
"""Half of a 95 % interval, in standard deviations."""
LOPSIDED = 1.3
"""An interval whose arms differ by more than this factor is printed, not its standard deviation."""
SMALLER = {"s": (1.0, "ms"), "rad": (0.1, "mrad"), "rad/s": (0.1, "mrad/s"), "m": (0.1, "mm")}
"""Unit -> below which size its thousandth is handier, and what that is called."""


@dataclass(frozen=True)
class Handy:
    """A unit of handy size.

    Attributes
    ----------
    factor : by which numbers in the SI unit are multiplied.
    unit : as it is printed; "" for pure numbers.
    """

    factor: float
    unit: str


def handy(unit: str, size: float) -> Handy:
    """The unit in which a number of that size is best read: ms for s below one."""
    below, smaller = SMALLER.get(unit, (0.0, ""))
    if smaller and isfinite(size) and 0.0 < abs(size) < below:
        return Handy(1000.0, smaller)
    return Handy(1.0, "" if unit in ("", "1") else pretty_unit(unit))


def handy_of(ranked: Ranked) -> Handy:
    """The unit in which an effect's magnitude is best read."""
    return handy(ranked.unit, ranked.magnitude)


def is_factor(effect: str) -> bool:
    """Whether an effect's magnitude is a factor on something, one at its null."""
    known = EFFECTS.get(effect)
    return known is not None and known.parameter.unit == "1" and float(known.parameter.array) == 1.0


def magnitude_words(ranked: Ranked) -> str:
    """31 ± 3 ms with its standard deviation, × 0.84 ± 0.02, or 18 ms [5, 60] where the interval is lopsided."""
    own, (low, high) = handy_of(ranked), ranked.interval
    value = own.factor * ranked.magnitude
    before, behind = ("× " if is_factor(ranked.effect) else ""), (f" {own.unit}" if own.unit else "")
    arms = (high - ranked.magnitude, ranked.magnitude - low)
    if not any(isfinite(arm) for arm in arms):
        return f"{before}{number(value)}{behind}"  # nothing is known of its spread
    if not all(isfinite(arm) for arm in arms) or high <= low:
        return f"{before}{number(value)}{behind} {interval_words(ranked, unit=False)}"
    if min(arms) <= 0.0 or max(arms) > LOPSIDED * min(arms):
        digits = together(value, by=own.factor * (high - low) / 4)
        shown = digits.words[0] if not digits.power else number(value)
        return f"{before}{shown}{behind} {interval_words(ranked, unit=False)}"
    return f"{before}{short_with_sd(value, own.factor * sum(arms) / (2 * NORMAL))}{behind}"


def interval_words(ranked: Ranked, unit: bool = True) -> str:
    """[25, 37] ms, to the digits of its width; an end that is not finite as ∞."""
    own = handy_of(ranked)
    low, high = (own.factor * end for end in ranked.interval)
    behind = f" {own.unit}" if own.unit and unit else ""
    if not (isfinite(low) and isfinite(high) and high > low):
        return f"[{number(low)}, {number(high)}]{behind}"
    return f"{interval(low, high, (high - low) / 4)}{behind}"


def error_words(value: float, unit: str, digits: int = 2) -> str:
    """An error with its unit of handy size: 52 mrad/s."""
    own = handy(unit, value)
    return f"{number(own.factor * value, digits)} {own.unit}".strip()
