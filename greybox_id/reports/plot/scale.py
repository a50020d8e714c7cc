"""Axes: where ticks stand, what they are called, and where a value lies between two ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...parameter import Array
from ..numbers import number

PAD = 0.04
"""What an axis reaches beyond its values, of their range."""
ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Axis:
    """An axis of a panel.

    Attributes
    ----------
    label : with its unit.
    low, high : ends; None where the values say.
    log : logarithmic.
    ticks : (value, words); None where they are chosen.
    grid : whether lines cross the panel at the ticks.
    downwards : whether the low end lies above (or right).
    upright : ticks' words are turned by a quarter.
    """

    label: str = ""
    low: float | None = None
    high: float | None = None
    log: bool = False
    ticks: tuple[tuple[float, str], ...] | None = None
    grid: bool = True
    downwards: bool = False
    upright: bool = False


@dataclass(frozen=True)
class Scale:
    """An axis with known ends, laid over a length of paper, with ticks about so far apart, points."""

    axis: Axis
    low: float
    high: float
    length: float
    spacing: float = 38.0

    def __call__(self, values: Array) -> Array:
        """Where values lie, points from the left or from above."""
        own = np.asarray(values, dtype=float)
        low, high = self.low, self.high
        if self.axis.log:
            with np.errstate(divide="ignore", invalid="ignore"):
                own = np.log10(np.where(own > 0, own, np.nan))
            low, high = math.log10(low), math.log10(high)
        share = (own - low) / (high - low)
        return np.asarray(self.length * (1.0 - share if self.axis.downwards else share))

    @property
    def ticks(self) -> tuple[tuple[float, str], ...]:
        """Values and words, those within the ends."""
        found = self.axis.ticks
        if found is None:
            found = (
                _decades(self.low, self.high)
                if self.axis.log
                else _steps(self.low, self.high, self.length / self.spacing)
            )
        room = 1e-9 * abs(self.high - self.low)
        return tuple(tick for tick in found if self.low - room <= tick[0] <= self.high + room)


def scaled(axis: Axis, values: Sequence[Array], length: float, spacing: float = 38.0) -> Scale:
    """An axis over some values: its stated ends, else a little beyond the values."""
    parts = [np.ravel(own) for own in values]
    known = np.concatenate([np.empty(0), *parts])
    known = known[np.isfinite(known) & ((known > 0) | (not axis.log))]
    low, high = (float(known.min()), float(known.max())) if known.size else ((0.1, 10.0) if axis.log else (0.0, 1.0))
    if axis.log:
        room = (high / low) ** PAD if high > low else 2.0
        ends = low / room, high * room
    else:
        lowest, highest = low if axis.low is None else axis.low, high if axis.high is None else axis.high
        room = PAD * (highest - lowest) if highest > lowest else max(0.05 * abs(low), 1e-12)
        ends = low - room, high + room
    low = ends[0] if axis.low is None else axis.low
    high = ends[1] if axis.high is None else axis.high
    return Scale(axis, low, high if high > low else low + 1.0, length, spacing)


def _steps(low: float, high: float, room: float) -> tuple[tuple[float, str], ...]:
    """Round values, as many as there is room for."""
    rough = (high - low) / min(max(2.0, room), 7.0)
    power = 10.0 ** math.floor(math.log10(rough))
    steps = [power * own for own in ROUND if power * own >= rough * (1 - 1e-9)]
    step = steps[0] if _count(low, high, steps[0]) > 1 else max(power * own for own in ROUND if power * own <= rough)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9) + (1 if round(step / power, 3) == 2.5 else 0))
    values = [k * step for k in range(first, last + 1)]
    if max(abs(low), abs(high)) >= 1e5 or step < 1e-4:
        return tuple((value, number(value, 2)) for value in values)
    return tuple((value, f"{value + 0.0:.{decimals}f}".replace("-", "−")) for value in values)


def _count(low: float, high: float, step: float) -> int:
    return math.floor(high / step + 1e-9) - math.ceil(low / step - 1e-9) + 1


def _decades(low: float, high: float) -> tuple[tuple[float, str], ...]:
    """Powers of ten, and round values between where these are few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    few = high < 200.0 * low
    stride = max(1, round((last - first) / 6))
    values = [
        m * 10.0**k for k in range(first, last + 1) for m in ((1, 2, 5) if few else (1,)) if few or k % stride == 0
    ]
    return tuple((value, _decade(value)) for value in values)


def _decade(value: float) -> str:
    power = math.log10(value)
    if 0.1 <= value < 1e3 or (0.001 <= value < 1e4 and abs(power - round(power)) > 1e-9):
        return f"{value:g}"
    if abs(power - round(power)) > 1e-9:
        return number(value, 1)
    return "10" + str(round(power)).translate(str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"))
