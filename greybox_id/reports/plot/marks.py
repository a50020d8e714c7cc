"""What a panel holds: curves, bands, rules and words, each of which knows how it is drawn."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ...parameter import Array
from .letters import SMALL, text
from .palette import BLUE, INK, Line
from .scale import Scale

COLUMNS = 2.0
"""Points of a curve that are kept per point of paper: its least and its largest in each column."""


class Mark(Protocol):
    """Something drawn in a panel."""

    @property
    def words(self) -> str:
        """In the legend; "" for none."""

    @property
    def reach(self) -> tuple[Array, Array]:
        """Values that the axes are to hold, along x and y."""

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG."""

    def key(self) -> str:
        """Its sample in the legend, 18 points wide about a line at zero."""


def _attributes(line: Line) -> str:
    dashes = f' stroke-dasharray="{line.dashes}"' if line.dashes else ""
    return f'class="s-{line.colour}" stroke-width="{line.width:g}"{dashes} fill="none"'


def _path(x: Array, y: Array, close: bool = False) -> str:
    """A path that breaks where a value is missing."""
    known = np.isfinite(x) & np.isfinite(y)
    parts, pen = [], "M"
    for a, b, there in zip(np.clip(x, -1e4, 1e4).tolist(), np.clip(y, -1e4, 1e4).tolist(), known.tolist(), strict=True):
        if there:
            parts.append(f"{pen}{a:.1f} {b:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(parts) + ("Z" if close and parts else "")


def _thinned(x: Array, y: Array, length: float) -> tuple[Array, Array]:
    """Of many points, the lowest and the highest in each narrow column, in order."""
    columns = max(1, int(COLUMNS * length / 2))
    if len(x) <= 4 * columns or not np.all(np.diff(x[np.isfinite(x)]) >= 0):
        return x, y
    number = np.clip(np.nan_to_num(x / length * columns, nan=-1), -1, columns).astype(int)
    starts = np.concatenate(([0], np.flatnonzero(np.diff(number)) + 1))
    part = np.zeros(len(x), dtype=int)
    part[starts[1:]] = 1
    part = np.cumsum(part)
    missing = np.isnan(y)
    lowest, highest = (np.lexsort((np.where(missing, np.inf, own), part))[starts] for own in (y, -y))
    kept = np.unique(np.concatenate([starts, lowest, highest]))
    return x[kept], y[kept]


@dataclass(frozen=True)
class Curve:
    """A line through points, and dots on them.

    Attributes
    ----------
    x, y : values; the line breaks where one is missing.
    line : its look; `dots` : their size, points, 0 for none.
    whiskers : standard errors drawn above and below each point; joined : whether there is a line at all.
    counts : whether the axes are to hold it.
    """

    x: Array
    y: Array
    line: Line
    dots: float = 0.0
    whiskers: Array | None = None
    joined: bool = True
    counts: bool = True

    @property
    def words(self) -> str:
        """In the legend."""
        return self.line.words

    @property
    def reach(self) -> tuple[Array, Array]:
        """Where it goes."""
        if not self.counts:
            return np.empty(0), np.empty(0)
        y = np.asarray(self.y, dtype=float)
        ends = [y] if self.whiskers is None else [y - self.whiskers, y + self.whiskers]
        return np.asarray(self.x, dtype=float), np.concatenate(ends)

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG."""
        a, b = x(self.x), y(self.y)
        parts = []
        if self.joined:
            parts.append(f'<path d="{_path(*_thinned(a, b, x.length))}" {_attributes(self.line)}/>')
        if self.whiskers is not None:
            low, high = y(np.asarray(self.y) - self.whiskers), y(np.asarray(self.y) + self.whiskers)
            low = np.where(np.isfinite(low), low, y.length)
            bars = "".join(f"M{u:.1f} {p:.1f}V{q:.1f}" for u, p, q in zip(a, low, high, strict=True) if np.isfinite(q))
            parts.append(f'<path d="{bars}" class="s-{self.line.colour}" stroke-width="0.7"/>')
        if self.dots:
            spots = "".join(
                f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{self.dots:g}"/>'
                for u, v in zip(a, b, strict=True)
                if np.isfinite(u) and np.isfinite(v)
            )
            parts.append(f'<g class="f-{self.line.colour}">{spots}</g>')
        return "".join(parts)

    def key(self) -> str:
        """Its sample."""
        line = f'<path d="M0 0H18" {_attributes(self.line)}/>' if self.joined else ""
        spot = f'<circle cx="9" cy="0" r="{self.dots:g}" class="f-{self.line.colour}"/>' if self.dots else ""
        return line + spot


@dataclass(frozen=True)
class Band:
    """What lies between two curves."""

    x: Array
    low: Array
    high: Array
    colour: str = BLUE
    words: str = ""
    shade: float = 0.25
    counts: bool = True

    @property
    def reach(self) -> tuple[Array, Array]:
        """Where it goes."""
        if not self.counts:
            return np.empty(0), np.empty(0)
        return np.asarray(self.x), np.concatenate([self.low, self.high])

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG, a shape for each unbroken stretch."""
        a, low, high = x(self.x), y(self.low), y(self.high)
        known = np.isfinite(a) & np.isfinite(low) & np.isfinite(high)
        parts = np.split(np.arange(len(a)), np.flatnonzero(np.diff(known.astype(int))) + 1)
        shapes = [
            _path(np.concatenate([a[p], a[p][::-1]]), np.concatenate([low[p], high[p][::-1]]), close=True)
            for p in parts
            if len(p) > 1 and known[p[0]]
        ]
        return f'<path d="{"".join(shapes)}" class="f-{self.colour}" fill-opacity="{self.shade:g}"/>'

    def key(self) -> str:
        """Its sample."""
        return f'<rect x="0" y="-4" width="18" height="8" class="f-{self.colour}" fill-opacity="{self.shade:g}"/>'


@dataclass(frozen=True)
class Rule:
    """A straight line across the panel, level or upright."""

    at: float
    line: Line = field(default_factory=lambda: Line(INK, width=0.6))
    upright: bool = False
    counts: bool = False

    @property
    def words(self) -> str:
        """In the legend."""
        return self.line.words

    @property
    def reach(self) -> tuple[Array, Array]:
        """Its place, if it counts."""
        own, none = np.array([self.at] if self.counts else []), np.empty(0)
        return (own, none) if self.upright else (none, own)

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG."""
        along = x if self.upright else y
        at = float(along(np.array([self.at]))[0])
        d = f"M{at:.1f} 0V{y.length:.1f}" if self.upright else f"M0 {at:.1f}H{x.length:.1f}"
        return f'<path d="{d}" {_attributes(self.line)}/>'

    def key(self) -> str:
        """Its sample."""
        return f'<path d="M0 0H18" {_attributes(self.line)}/>'


@dataclass(frozen=True)
class Letters:
    """Words at a place of a panel."""

    x: float
    y: float
    said: str
    anchor: str = "middle"
    colour: str = INK
    size: float = SMALL
    words: str = ""

    @property
    def reach(self) -> tuple[Array, Array]:
        """Nothing: the axes are those of what is drawn."""
        return np.empty(0), np.empty(0)

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG."""
        at = float(x(np.array([self.x]))[0]), float(y(np.array([self.y]))[0])
        return text(at[0], at[1] + 0.33 * self.size, self.said, size=self.size, anchor=self.anchor, colour=self.colour)

    def key(self) -> str:
        """None."""
        return ""


@dataclass(frozen=True)
class Notice:
    """Words in the middle of a panel, in as many lines as they need."""

    said: str
    words: str = ""

    @property
    def reach(self) -> tuple[Array, Array]:
        """Nothing."""
        return np.empty(0), np.empty(0)

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG."""
        lines = textwrap.wrap(self.said, max(8, int(1.8 * x.length / SMALL)))
        top = y.length / 2 - 0.6 * SMALL * (len(lines) - 1) + 0.33 * SMALL
        return "".join(
            text(x.length / 2, top + 1.2 * SMALL * k, line, size=SMALL, anchor="middle") for k, line in enumerate(lines)
        )

    def key(self) -> str:
        """None."""
        return ""
