"""A figure: panels in rows and columns with a legend above, laid out so that no letters meet, drawn as SVG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from xml.sax.saxutils import escape

from .letters import FAMILY, SIZE, SMALL, text, width
from .marks import Mark, Notice
from .palette import FAINT, INK, LIGHT, PALE, style
from .scale import Axis, Scale, scaled

WIDE = 497.0
"""Width of a figure, points: the text width of the report, so that letters keep their size."""
LINE, TICK, GUTTER, EDGE = 11.5, 2.5, 9.0, 5.0
"""Height of a line of letters, length of a tick, room between panels and at the edges, points."""
UPRIGHT = 21.0
"""Between ticks of an upright axis."""
SAMPLE = 18.0
"""Width of a sample in the legend."""


@dataclass(frozen=True)
class Shades:
    """The scale of a map, beside its panel: (share of the darkest, words) and its label."""

    ticks: tuple[tuple[float, str], ...]
    label: str
    colour: str = INK
    lightest: float = 0.06
    darkest: float = 0.6
    below: str = ""


@dataclass(frozen=True)
class Panel:
    """Marks over two axes.

    Attributes
    ----------
    marks : drawn in order, the later ones above.
    x, y : axes.
    title : above it.
    shades : the scale of a map.
    bare : without axes, for words that say why there is nothing.
    equal : a unit is as long along x as along y.
    """

    marks: tuple[Mark, ...]
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    title: str = ""
    shades: Shades | None = None
    bare: bool = False
    equal: bool = False


@dataclass(frozen=True)
class Figure:
    """Panels in rows and columns.

    Attributes
    ----------
    rows : of panels; None leaves a place empty.
    heights : of each row's panels, points, without their letters.
    widths : of the columns, relative to one another; all alike unless given.
    joined : panels below one another share their x axis, which is written once.
    """

    rows: tuple[tuple[Panel | None, ...], ...]
    heights: tuple[float, ...]
    widths: tuple[float, ...] | None = None
    joined: bool = False

    @cached_property
    def panels(self) -> tuple[Panel, ...]:
        """All of them."""
        return tuple(panel for row in self.rows for panel in row if panel is not None)

    @cached_property
    def body(self) -> tuple[float, str]:
        """Height, points, and what is inside the SVG element."""
        legend, top = self._legend()
        columns = len(self.rows[0])
        lefts = [max((self._left(p, h) for p, h in self._column(k)), default=0.0) for k in range(columns)]
        rights = [max((_right(p) for p, _ in self._column(k)), default=0.0) for k in range(columns)]
        free = WIDE - sum(lefts) - sum(rights) - GUTTER * (columns - 1)
        shares = self.widths or (1.0,) * columns
        parts, y = [legend], top
        for number, (row, height) in enumerate(zip(self.rows, self.heights, strict=True)):
            last = not self.joined or number == len(self.rows) - 1
            y += LINE + 2.0 if any(p is not None and p.title for p in row) else EDGE
            x = 0.0
            for k, panel in enumerate(row):
                x += lefts[k]
                wide = free * shares[k] / sum(shares)
                if panel is not None:
                    parts.append(_drawn(panel, x, y, wide, height, lettered=last))
                x += wide + rights[k] + GUTTER
            y += height + max(_below(p) if last else 1.0 for p in row if p is not None)
        return y, "".join(parts)

    def svg(self, alt: str = "", palette: dict[str, str] | None = LIGHT) -> str:
        """The figure as one SVG element; without a palette its colours are left to the page."""
        height, body = self.body
        colours = f"<style>{style(palette)}</style>" if palette is not None else ""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE:g} {height:.1f}" width="{WIDE:g}pt" '
            f'height="{height:.1f}pt" font-family="{FAMILY}" role="img">{_titled(alt)}{colours}{body}</svg>'
        )

    def _column(self, k: int) -> Iterator[tuple[Panel, float]]:
        for row, height in zip(self.rows, self.heights, strict=True):
            panel = row[k]
            if panel is not None:
                yield panel, height

    def _left(self, panel: Panel, height: float) -> float:
        if panel.bare:
            return 0.0
        scale = _scales(panel, 100.0, height)[1]
        words = max((width(words, SMALL) for _, words in scale.ticks), default=0.0)
        return words + TICK + 3.0 + (LINE * (panel.y.label.count("\n") + 1) + 1.0 if panel.y.label else 2.0)

    def _legend(self) -> tuple[str, float]:
        """Its lines, centred, and their height."""
        keys = {mark.words: mark for panel in self.panels for mark in panel.marks if mark.words}
        lines: list[list[Mark]] = [[]]
        used = 0.0
        for mark in keys.values():
            own = SAMPLE + 5.0 + width(mark.words) + 16.0
            if lines[-1] and used + own > WIDE:
                lines.append([])
                used = 0.0
            lines[-1].append(mark)
            used += own
        parts, y = [], EDGE
        for line in lines if keys else []:
            x = (WIDE - sum(SAMPLE + 5.0 + width(mark.words) + 16.0 for mark in line) + 16.0) / 2
            for mark in line:
                parts.append(f'<g transform="translate({x:.1f} {y + 3.2:.1f})">{mark.key()}</g>')
                parts.append(text(x + SAMPLE + 5.0, y + 6.0, mark.words))
                x += SAMPLE + 5.0 + width(mark.words) + 16.0
            y += LINE + 1.0
        return "".join(parts), y if keys else 0.0


def grid(panels: Sequence[Panel], columns: int, height: float) -> Figure:
    """Panels in so many columns, row by row."""
    width = min(columns, max(1, len(panels)))
    padded = [*panels, *[None] * (-len(panels) % width)]
    rows = tuple(tuple(padded[k : k + width]) for k in range(0, len(padded), width))
    return Figure(rows, (height,) * len(rows))


def _titled(alt: str) -> str:
    return f"<title>{escape(alt)}</title>" if alt else ""


def _scales(panel: Panel, wide: float, height: float) -> tuple[Scale, Scale]:
    reaches = [mark.reach for mark in panel.marks]
    y = replace(panel.y, downwards=not panel.y.downwards)  # paper counts from above
    across = scaled(panel.x, [r[0] for r in reaches], wide)
    along = scaled(y, [r[1] for r in reaches], height, UPRIGHT)
    if not panel.equal:
        return across, along
    unit = max((own.high - own.low) / own.length for own in (across, along))
    return _stretched(across, unit), _stretched(along, unit)


def _stretched(scale: Scale, unit: float) -> Scale:
    """A scale about the same middle, so many units to a point."""
    middle, half = (scale.low + scale.high) / 2, unit * scale.length / 2
    return replace(scale, low=middle - half, high=middle + half)


def nothing(words: str) -> Panel:
    """An empty panel that says why."""
    return Panel((Notice(words),), bare=True)


def _right(panel: Panel) -> float:
    if panel.shades is None:
        return EDGE + 3.0
    return 26.0 + max(width(words, SMALL) for _, words in panel.shades.ticks) + (LINE if panel.shades.label else 0.0)


def _below(panel: Panel) -> float:
    if panel.bare:
        return EDGE
    words = LINE
    if panel.x.upright and panel.x.ticks:
        words = max(width(said, SMALL) for _, said in panel.x.ticks) + 3.0
    elif panel.x.ticks and any("\n" in said for _, said in panel.x.ticks):
        words = 2 * LINE
    return TICK + words + (LINE + 1.0 if panel.x.label else 0.0) + 3.0


def _drawn(panel: Panel, left: float, top: float, wide: float, height: float, lettered: bool) -> str:
    x, y = _scales(panel, wide, height)
    marks = "".join(mark.drawn(x, y) for mark in panel.marks)
    inside = f'<svg x="{left:.1f}" y="{top:.1f}" width="{wide:.1f}" height="{height:.1f}">{marks}</svg>'
    if panel.bare:
        return inside
    lines = "".join(f"M{left + at:.1f} {top:.1f}v{height:.1f}" for at in _at(x) if panel.x.grid)
    lines += "".join(f"M{left:.1f} {top + at:.1f}h{wide:.1f}" for at in _at(y) if panel.y.grid)
    grid = f'<path d="{lines}" class="s-{FAINT}" stroke-width="0.5"/>'
    parts = [grid, inside, _frame(x, y, left, top, lettered)]
    if panel.title:
        parts.append(text(left + wide / 2, top - 4.0, panel.title, anchor="middle"))
    parts += _letters_left(y, left, top)
    if lettered:
        parts += _letters_below(x, left, top + height)
    if panel.shades is not None:
        parts.append(_shades(panel.shades, left + wide + 9.0, top, height))
    return "".join(parts)


def _at(scale: Scale) -> list[float]:
    return [float(scale(value)) for value, _ in scale.ticks]  # type: ignore[arg-type]


def _frame(x: Scale, y: Scale, left: float, top: float, lettered: bool) -> str:
    """The axes' lines and ticks."""
    bottom = top + y.length
    lines = f"M{left:.1f} {top:.1f}V{bottom:.1f}H{left + x.length:.1f}"
    lines += "".join(f"M{left:.1f} {top + at:.1f}h-{TICK}" for at in _at(y))
    if lettered:
        lines += "".join(f"M{left + at:.1f} {bottom:.1f}v{TICK}" for at in _at(x))
    return f'<path d="{lines}" class="s-{PALE}" stroke-width="0.6" fill="none"/>'


def _letters_left(y: Scale, left: float, top: float) -> list[str]:
    found, widest = [], 0.0
    for (_, words), at in zip(y.ticks, _at(y), strict=True):
        found.append(text(left - TICK - 2.0, top + at + 2.6, words, size=SMALL, anchor="end"))
        widest = max(widest, width(words, SMALL))
    lines = y.axis.label.split("\n") if y.axis.label else []
    for k, line in enumerate(reversed(lines)):
        at = left - TICK - 4.0 - widest - 2.0 - LINE * k
        size = SIZE * min(1.0, (y.length + 2 * GUTTER) / max(width(line), 1.0))
        found.append(text(at, top + y.length / 2, line, size=round(size, 1), anchor="middle", turned=True))
    return found


def _letters_below(x: Scale, left: float, bottom: float) -> list[str]:
    found, deep = [], LINE
    end = float("-inf")
    for at, (_, words) in sorted(zip(_at(x), x.ticks, strict=True)):
        place = left + at
        if x.axis.upright:
            found.append(text(place + 2.6, bottom + TICK + 3.0, words, size=SMALL, anchor="end", turned=True))
            deep = max(deep, width(words, SMALL) + 3.0)
            continue
        lines = words.split("\n")
        half = max(width(line, SMALL) for line in lines) / 2
        if place - half < end + 1.5:
            continue
        end = place + half
        for k, line in enumerate(lines):
            found.append(text(place, bottom + TICK + 7.5 + k * LINE, line, size=SMALL, anchor="middle"))
        deep = max(deep, len(lines) * LINE)
    if x.axis.label:
        found.append(text(left + x.length / 2, bottom + TICK + deep + 8.0, x.axis.label, anchor="middle"))
    return found


def _shades(shades: Shades, left: float, top: float, height: float) -> str:
    """A column from light to dark, or from one colour over nothing to the other."""
    count = 24
    parts = []
    for k in range(count):
        share = (k + 0.5) / count
        size = 2.0 * share - 1.0 if shades.below else share
        colour = shades.colour if size >= 0 else shades.below
        shade = shades.lightest + (shades.darkest - shades.lightest) * abs(size)
        y = top + height * (1.0 - (k + 1) / count)
        parts.append(
            f'<rect x="{left:.1f}" y="{y:.2f}" width="7" height="{height / count:.2f}" class="f-{colour}" '
            f'fill-opacity="{shade:.3f}" shape-rendering="crispEdges"/>'
        )
    widest = 0.0
    for share, words in shades.ticks:
        parts.append(text(left + 10.0, top + height * (1.0 - share) + 2.6, words, size=SMALL))
        widest = max(widest, width(words, SMALL))
    if shades.label:
        at = left + 10.0 + widest + 9.0
        size = SIZE * min(1.0, (height + GUTTER) / max(width(shades.label), 1.0))
        parts.append(text(at, top + height / 2, shades.label, size=round(size, 1), anchor="middle", turned=True))
    return "".join(parts)
