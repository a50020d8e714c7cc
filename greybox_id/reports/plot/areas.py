"""Marks that fill areas: bars, cells of maps, boxes, and dots shaded by a value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...parameter import Array
from .palette import BLUE, INK, PALE
from .scale import Scale

SHADES = 12
"""Shades of a map: cells of one shade are one path."""


@dataclass(frozen=True)
class Bars:
    """Upright bars from a base, or lying ones."""

    left: Array
    right: Array
    top: Array
    colour: str = PALE
    words: str = ""
    base: float = 0.0
    lying: bool = False
    edged: bool = False

    @property
    def reach(self) -> tuple[Array, Array]:
        """Where they go."""
        along = np.concatenate([self.left, self.right])
        across = np.concatenate([np.asarray(self.top, dtype=float), [self.base]])
        return (across, along) if self.lying else (along, across)

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG."""
        along, across = (y, x) if self.lying else (x, y)
        a, b, ends = along(self.left), along(self.right), across(self.top)
        base = float(across(np.array([self.base]))[0])
        base = base if np.isfinite(base) else y.length
        shapes = []
        for one, other, end in zip(a.tolist(), b.tolist(), ends.tolist(), strict=True):
            if not np.isfinite(end):
                continue
            if self.lying:
                shapes.append(f"M{base:.1f} {one:.1f}H{end:.1f}V{other:.1f}H{base:.1f}Z")
            else:
                shapes.append(f"M{one:.1f} {base:.1f}V{end:.1f}H{other:.1f}V{base:.1f}Z")
        edge = f' stroke-width="0.4" class="f-{self.colour} s-{INK}"' if self.edged else f' class="f-{self.colour}"'
        return f'<path d="{"".join(shapes)}"{edge}/>'

    def key(self) -> str:
        """Its sample."""
        return f'<rect x="3" y="-4" width="12" height="8" class="f-{self.colour}"/>'


@dataclass(frozen=True)
class Cells:
    """A map: cells shaded by their share of a largest value.

    Attributes
    ----------
    x, y : (cells + 1,) edges.
    share : (x cells, y cells), 0 to 1, negative in the colour `below`; NaN leaves a cell out.
    """

    x: Array
    y: Array
    share: Array
    colour: str = INK
    below: str = BLUE
    lightest: float = 0.06
    darkest: float = 0.6
    gap: float = 0.0
    words: str = ""

    @property
    def reach(self) -> tuple[Array, Array]:
        """Its edges."""
        return self.x, self.y

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG, a path for each shade."""
        a, b = x(self.x), y(self.y)
        shapes: dict[tuple[str, int], list[str]] = {}
        for (i, j), share in np.ndenumerate(self.share):
            if np.isfinite(share):
                left, right = sorted((a[i], a[i + 1]))
                top, bottom = sorted((b[j], b[j + 1]))
                colour = self.colour if share >= 0 else self.below
                shape = (
                    f"M{left + self.gap:.1f} {top + self.gap:.1f}H{right - self.gap:.1f}V{bottom - self.gap:.1f}"
                    f"H{left + self.gap:.1f}Z"
                )
                shapes.setdefault((colour, round(SHADES * min(abs(share), 1.0))), []).append(shape)
        return "".join(
            f'<path d="{"".join(own)}" class="f-{colour}" fill-opacity="{self._shade(level):.2f}"/>'
            for (colour, level), own in sorted(shapes.items())
        )

    def key(self) -> str:
        """Its sample."""
        return f'<rect x="3" y="-4" width="12" height="8" class="f-{self.colour}" fill-opacity="{self.darkest / 2:g}"/>'

    def _shade(self, level: int) -> float:
        return self.lightest + (self.darkest - self.lightest) * level / SHADES


@dataclass(frozen=True)
class Boxes:
    """Boxes of the middle half of values, whiskers of the middle 95 %, bars at the medians."""

    at: Sequence[float]
    values: Sequence[Array]
    wide: float
    colour: str
    words: str = ""

    @property
    def reach(self) -> tuple[Array, Array]:
        """Where they go."""
        return np.asarray(self.at), self._ends.ravel()

    @property
    def _ends(self) -> Array:
        return np.array([np.nanquantile(own, (0.025, 0.25, 0.5, 0.75, 0.975)) for own in self.values])

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG."""
        shapes = []
        for at, ends in zip(self.at, self._ends, strict=True):
            left, middle, right = x(np.array([at - self.wide / 2, at, at + self.wide / 2]))
            low, first, median, third, high = y(ends)
            box = f"M{left:.1f} {third:.1f}H{right:.1f}V{first:.1f}H{left:.1f}Z"
            arms = f"M{middle:.1f} {first:.1f}V{low:.1f}M{middle:.1f} {third:.1f}V{high:.1f}"
            caps = "".join(f"M{left + 2:.1f} {end:.1f}H{right - 2:.1f}" for end in (low, high))
            shapes.append(
                f'<path d="{box}" class="f-{self.colour} s-{self.colour}" fill-opacity="0.3" stroke-width="0.9"/>'
                f'<path d="{arms}{caps}" class="s-{self.colour}" stroke-width="0.9"/>'
                f'<path d="M{left:.1f} {median:.1f}H{right:.1f}" class="s-ink" stroke-width="1.2"/>'
            )
        return "".join(shapes)

    def key(self) -> str:
        """Its sample."""
        return (
            f'<rect x="3" y="-4" width="12" height="8" class="f-{self.colour} s-{self.colour}" fill-opacity="0.3" '
            'stroke-width="0.9"/>'
        )


@dataclass(frozen=True)
class Spots:
    """Dots shaded by a share, 0 to 1, the darkest on top."""

    x: Array
    y: Array
    share: Array
    colour: str
    size: float = 2.2
    words: str = ""

    @property
    def reach(self) -> tuple[Array, Array]:
        """Where they are."""
        return self.x, self.y

    def drawn(self, x: Scale, y: Scale) -> str:
        """As SVG, a group for each shade."""
        a, b = x(self.x), y(self.y)
        known = np.isfinite(a) & np.isfinite(b) & np.isfinite(self.share)
        levels = np.round(SHADES * np.clip(np.where(known, self.share, 0.0), 0.0, 1.0)).astype(int)
        groups = []
        for level in sorted(set(levels[known].tolist())):
            spots = "".join(
                f'<circle cx="{a[k]:.1f}" cy="{b[k]:.1f}" r="{self.size:g}"/>'
                for k in np.flatnonzero(known & (levels == level))
            )
            shade = 0.12 + 0.88 * level / SHADES
            groups.append(
                f'<g class="f-{self.colour} s-{PALE}" fill-opacity="{shade:.2f}" stroke-width="0.25">{spots}</g>'
            )
        return "".join(groups)

    def key(self) -> str:
        """Its sample."""
        return f'<circle cx="9" cy="0" r="{self.size:g}" class="f-{self.colour}"/>'
