"""Figures of a report: matplotlib figures of page width, laid out by the size of their text, written as SVG.

Text in the SVG is set in the font of the page that contains it; matplotlib measures it in a font of similar width.

Shared elements of figures: colours, line styles, and labels with units.

Colours are from Okabe and Ito's palette and differ in lightness as well as in hue, and each curve has its own line
style, so that figures are readable for all and in greyscale. A look is a dictionary of matplotlib's keywords of a line;
its label appears in the legend.
"""

from __future__ import annotations

import io
import math
import re
import textwrap
from collections.abc import Sequence
from contextlib import AbstractContextManager
from functools import cached_property
from html import escape, unescape
from typing import Any, cast

import numpy as np
from matplotlib import rc_context, rcParamsDefault
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from matplotlib.transforms import Bbox, BboxTransformTo, ScaledTranslation, blended_transform_factory

from ...base.guard import MARK
from ...base.numbers import number, pretty_unit, raised
from ...base.shorthands import Array
from ...base.signals import SIGNALS
from ...datasets.recording import Recording
from ..words import is_symbol_index, named, spans

INK = "#1a1a1a"
PALE = "#8f8f8f"
FAINT = "#e4e4e4"
BLUE = "#0072b2"
SKY = "#56b4e9"
ORANGE = "#e69f00"
RUST = "#c4682f"
PURPLE = "#7b3f8c"
NIGHT = "#1a1a3d"
LIGHT = {
    "ink": INK, "pale": PALE, "faint": FAINT, "blue": BLUE, "sky": SKY, "orange": ORANGE, "rust": RUST,
    "purple": PURPLE, "night": NIGHT,
}  # fmt: skip
DARK = {
    "ink": "#ececec", "pale": "#9a9a9a", "faint": "#3a3d42", "blue": "#4a9fd8", "sky": "#2f86bd", "orange": "#f0b429",
    "rust": "#e08a5a", "purple": "#c99bd8", "night": "#d9e6ff",
}  # fmt: skip
"""The same colours on a dark background."""
SIZE, SMALL = 8.6, 7.8
"""Font size of labels and of ticks, points."""
DASHED: Any = (0.0, (5.0, 2.0))
DOTTED: Any = (0.0, (1.0, 2.0))
CHAIN: Any = (0.0, (6.0, 2.0, 1.2, 2.0))

Look = dict[str, Any]


def look(colour: str, width: float = 1.1, label: str | None = None, *, dashes: Any = "-", dots: float = 0.0) -> Look:
    """Keywords of a line: colour, width and radius of its dots in points, dashes, and label in the legend."""
    look: Look = {"color": colour, "linewidth": width, "linestyle": dashes, "label": label}
    return look | ({"marker": "o", "markersize": 2 * dots, "markeredgewidth": 0.0} if dots else {})


MEASURED = look(INK, 1.2, "measured")
NOISE = look(PALE, 1.3, "noise", dashes=CHAIN)
ZERO = look(INK, 0.6)
"""Zero line of the axes."""
LEVELS = (look(SKY), look(BLUE, dashes=DASHED), look(NIGHT, dashes=CHAIN))
"""Lines for levels of an ordered quantity, low to high."""


def symbol(name: str) -> str:
    """Name of a signal or parameter in a figure: yaw_rate as words, a_x unchanged, to be typeset as a symbol."""
    if name in SIGNALS and not spans(name)[0].symbol:
        return name.replace("_", " ")
    return name if spans(name)[0].symbol or len(name) == 1 else name.replace("_", " ")


def label(name: str, unit: str) -> str:
    """An axis label: a name and its unit in brackets."""
    return f"{symbol(name)} [{pretty_unit(unit)}]"


def signal_label(recording: Recording, name: str) -> str:
    """Axis label for a signal of a recording."""
    return label(name, recording.unit(name))


WIDE = 497.0
"""Width of a figure, points: the text width of the report, so that text is not scaled."""
GUTTER, EDGE = 9.0, 5.0
"""Space between axes and at the edges, points."""
SPACING = {"x": 38.0, "y": 21.0}
"""Least distance between ticks, points."""
FEW = 200.0
"""Ratio of the ends of a logarithmic axis below which it has ticks between the powers of ten."""
SHADES = 12
"""Number of shades of a map; cells of one shade are drawn as one path."""
FAMILY = "'Libertinus Serif','STIX Two Text','Times New Roman',Times,serif"
ADJUSTED = 0.43
"""x-height of the first font in relation to its size; a substitute is scaled to the same, since the layout is based on
the widths of this font."""
WIDER = 1.055
"""Largest ratio of the width of words in the first font to that in the font that measures them: at most 1.054 for
effects' names, less than one for numbers, measured with Typst."""
LOWERED, INDEX = 0.22, 0.72
"""Depth of an index below the baseline and its size, relative to the font size."""
STYLE: dict[Any, Any] = {
    **{name: value for name, value in rcParamsDefault.items() if not name.startswith(("backend", "interactive"))},
    "axes.axisbelow": True, "axes.edgecolor": PALE, "axes.grid": True, "axes.labelcolor": INK, "axes.labelpad": 2.0,
    "axes.labelsize": SIZE, "axes.linewidth": 0.6, "axes.spines.right": False, "axes.spines.top": False,
    "axes.titlecolor": INK, "axes.xmargin": 0.04, "axes.ymargin": 0.04,
    "axes.formatter.limits": (-4, 5), "axes.formatter.useoffset": False,
    "font.family": ["STIXGeneral", "DejaVu Sans"], "font.size": SMALL, "grid.color": FAINT, "grid.linewidth": 0.5,
    "legend.borderaxespad": 0.3, "legend.borderpad": 0.0, "legend.columnspacing": 1.9, "legend.fontsize": SIZE,
    "legend.frameon": False, "legend.handlelength": 2.1, "legend.handletextpad": 0.6, "legend.labelcolor": INK,
    "legend.labelspacing": 0.2, "svg.fonttype": "none", "text.hinting": "none",
    "svg.hashsalt": MARK, "text.color": INK, "text.parse_math": False,
    **{f"{axis}tick.{name}": value for axis in "xy" for name, value in (
        ("color", PALE), ("labelcolor", INK), ("labelsize", SMALL), ("major.pad", 2.0), ("major.size", 2.5),
        ("major.width", 0.6), ("minor.size", 0.0),
    )},
}  # fmt: skip
"""Replaces matplotlib's settings, including the user's, so that figures are reproducible."""
_NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
_TEXT = re.compile(r'<text style="font-size: ([\d.]+)px;(.*?)"(.*?)>(.*?)</text>', re.DOTALL)


def _renderer(figure: Figure | SubFigure | None) -> RendererAgg:
    """The renderer that measures text; figures are drawn by Agg."""
    assert figure is not None
    return cast(RendererAgg, cast(Any, figure.canvas).get_renderer())


def _style() -> AbstractContextManager[None]:
    return rc_context(STYLE)


class Sheet(Figure):
    """A figure with axes in rows and columns.

    Parameters
    ----------
    heights : of the axes in each row, points, without labels.
    columns : number of columns.
    widths : of the columns, relative to each other; equal by default.
    joined : whether axes in a column share their x axis, with labels below the last only.

    Removed axes leave an empty place in the grid.
    """

    def __init__(
        self, heights: Sequence[float], columns: int = 1, *, widths: Sequence[float] | None = None, joined: bool = False
    ) -> None:
        self.heights, self.shares, self.joined = tuple(heights), tuple(widths or (1.0,) * columns), joined
        with _style():
            super().__init__(figsize=(WIDE / 72, sum(heights) / 72 + 1.0), dpi=72)
            FigureCanvasAgg(self)  # measures text
            axes = self.subplots(len(heights), columns, squeeze=False, sharex="col" if joined else False)
            self._rows: list[list[Axes]] = axes.tolist()  # an array in a reference cycle cannot be garbage-collected
            for (row, column), ax in np.ndenumerate(self.grid):
                wide = 0.85 * WIDE * self.shares[column] / sum(self.shares)
                for axis, length in ((ax.xaxis, wide), (ax.yaxis, heights[row])):
                    most = min(max(math.ceil(length / SPACING[axis.axis_name]), 2), 7)
                    axis.set_major_locator(MaxNLocator(most, steps=(1, 2, 2.5, 5, 10)))

    @property
    def grid(self) -> Any:
        """(rows, columns) of Axes."""
        return np.array(self._rows, dtype=object)

    def first(self) -> Axes:
        """The axes at the upper left."""
        axes: Axes = self.grid[0, 0]
        return axes

    def lay_out(self) -> None:
        """Place the axes with space for their labels, and set the height of the figure accordingly."""
        kept = self.grid.copy()
        for place, ax in np.ndenumerate(self.grid):
            kept[place] = ax if ax in self.axes else None
        rows, columns = kept.shape
        wide = 0.85 * WIDE * np.array(self.shares) / sum(self.shares)
        self._place(kept, np.cumsum(wide) - wide, wide, np.cumsum(self.heights) - self.heights, sum(self.heights))
        margins = np.zeros((rows, columns, 4))
        for place, ax in np.ndenumerate(kept):
            margins[place] = self._margins(ax) if ax is not None else 0.0
        left, right = margins[:, :, 0].max(axis=0), margins[:, :, 1].max(axis=0)
        above, below = margins[:, :, 2].max(axis=1), margins[:, :, 3].max(axis=1)
        free = WIDE - left.sum() - right.sum() - GUTTER * (columns - 1)
        wide = free * np.array(self.shares) / sum(self.shares)
        x = np.cumsum(left + wide + right + GUTTER) - wide - right - GUTTER
        y = self._legend() + np.cumsum(above + self.heights + below) - self.heights - below
        self._place(kept, x, wide, y, float(y[-1] + self.heights[-1] + below[-1]))

    def svg(self, alt: str = "", *, colours: bool = True) -> str:
        """The figure as one SVG element; with `colours` false, colours are CSS variables of the page."""
        body = self._body
        if not colours:
            for name, item in LIGHT.items():
                body = body.replace(item, f"var(--{name})")
        width, height = (72 * inches for inches in self.get_size_inches())
        title = f"<title>{escape(alt)}</title>" if alt else ""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="{MARK}" viewBox="0 0 {width:g} {height:.1f}" '
            f'width="{width:g}pt" height="{height:.1f}pt" font-family="{FAMILY}" style="font-size-adjust:{ADJUSTED}" '
            f'stroke-linejoin="round" role="img">'
            f"{title}{body}</svg>"
        )

    def _repr_html_(self) -> str:
        """The figure in a notebook and in the gallery."""
        return self.svg()

    @cached_property
    def _body(self) -> str:
        """Content of the SVG element."""
        drawn = io.StringIO()
        with _style():
            self.lay_out()
            self.savefig(drawn, format="svg", transparent=True, metadata=_NO_METADATA)
        inside = drawn.getvalue().partition("</style>\n </defs>")[2].rpartition("</svg>")[0]
        inside = re.sub(r'<g id=".*?">', "<g>", inside).replace("xlink:href", "href")
        parts = re.split("(<text.*?</text>)", re.sub(r"\n\s*", "\n", inside), flags=re.DOTALL)
        parts[::2] = [re.sub(r"(\.\d\d)\d+", r"\1", part) for part in parts[::2]]  # hundredths of a point
        parts[1::2] = [_TEXT.sub(_text, part) for part in parts[1::2]]
        return "".join(parts)

    def _place(self, axes: Any, x: Array, wide: Array, y: Array, height: float) -> None:
        self.set_size_inches(WIDE / 72, height / 72)
        for (row, column), ax in np.ndenumerate(axes):
            if ax is not None:
                bottom = 1.0 - (y[row] + self.heights[row]) / height
                ax.set_position((x[column] / WIDE, bottom, wide[column] / WIDE, self.heights[row] / height))
                ax.apply_aspect()

    def _margins(self, ax: Axes) -> tuple[float, float, float, float]:
        """Space for the labels of axes, in points: left, right, above and below."""
        renderer = _renderer(self)
        boxes = [ax.bbox]
        if ax.axison:
            for axis in (ax.xaxis, ax.yaxis):
                if axis.get_scale() == "log":
                    _label_powers(axis)
            _fit_letters(ax)
            text_boxes = [axis.get_tightbbox(renderer) for axis in (ax.xaxis, ax.yaxis)]
            text_boxes += [ax.title.get_window_extent(renderer)] if ax.get_title() else []
            boxes += [
                box
                for box in (*text_boxes, *(child_axis.get_tightbbox(renderer) for child_axis in ax.child_axes))
                if box
            ]
        around, inner, last = Bbox.union(boxes), ax.bbox, not self.joined or ax in self.grid[-1]
        left, right, above, below = (
            inner.x0 - around.x0,
            around.x1 - inner.x1,
            around.y1 - inner.y1,
            inner.y0 - around.y0,
        )
        return WIDER * left + 1.0, max(right, EDGE), max(above, EDGE), below + (3.0 if last else 1.0)

    def _legend(self) -> float:
        """Draw the legend above all axes, in as many lines as necessary; returns its height."""
        for old in self.legends:
            old.remove()
        handles: dict[str, Any] = {}
        for ax in self.axes:
            for handle, words in zip(*ax.get_legend_handles_labels(), strict=True):
                handles.setdefault(words, handle)
        for columns in range(len(handles), 0, -1):
            legend = self.legend(
                list(handles.values()), list(handles), ncols=columns, loc="upper center", bbox_to_anchor=(0.5, 1.0)
            )
            box = legend.get_window_extent(_renderer(self))
            if box.width < WIDE or columns == 1:
                return float(box.height) + EDGE + 2.0
            legend.remove()
        return 0.0


def sheet_of(count: int, columns: int, height: float) -> tuple[Sheet, list[Axes]]:
    """A sheet with `count` axes in at most this many columns, row by row."""
    columns = min(columns, max(1, count))
    sheet = Sheet((height,) * (-(-count // columns)), columns)
    axes = list(sheet.grid.flat)
    for ax in axes[count:]:
        ax.remove()
    return sheet, axes[:count]


def notice(ax: Axes, words: str) -> None:
    """Text in the middle of empty axes that explains why they are empty."""
    ax.axis("off")
    width = ax.get_position().width * WIDE
    lines = "\n".join(textwrap.wrap(words, max(8, int(1.8 * width / SMALL))))
    ax.text(0.5, 0.5, lines, transform=ax.transAxes, ha="center", va="center", size=SMALL, color=INK)


def notice_sheet(words: str) -> Sheet:
    """A figure without data, with an explanation."""
    sheet = Sheet((40.0,))
    notice(sheet.first(), words)
    return sheet


def band(ax: Axes, x: Array, low: Array, high: Array, colour: str = BLUE, label: str | None = None,
         opacity: float = 0.25) -> None:  # fmt: skip
    """Shade the area between two curves."""
    ax.fill_between(x, low, high, color=colour, alpha=opacity, linewidth=0.0, label=label)


QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Quantiles of lower whisker, lower end of the box, median, upper end and upper whisker."""


def boxes(ax: Axes, at: Sequence[float], samples: Sequence[Array], colour: str, wide: float, label: str = "") -> None:
    """Draw a box per sample: it contains half of the values, its whiskers 95 %; NaN are left out."""
    ends = (np.nanquantile(values, QUANTILES) for values in samples)
    stats = [dict(zip(("whislo", "q1", "med", "q3", "whishi"), item, strict=True)) for item in ends]
    line = {"color": colour, "linewidth": 0.9}
    ax.bxp(stats, at, widths=wide, showfliers=False, patch_artist=True, manage_ticks=False, whiskerprops=line,
           capprops=line, medianprops={"color": INK, "linewidth": 1.2}, label=label or None,
           boxprops={"facecolor": f"{colour}4d", "edgecolor": colour, "linewidth": 0.9})  # fmt: skip


def cells(
    ax: Axes, x: Array, y: Array, share: Array, colour: str = INK, below: str = BLUE, *,
    opacity: tuple[float, float] = (0.06, 0.6), gap: float = 0.0, label: str | None = None,
) -> None:  # fmt: skip
    """Draw a map of shaded cells; all cells of one shade are one path.

    Parameters
    ----------
    ax : axes.
    x, y : (cells + 1,) edges.
    share : (x cells, y cells), 0 to 1, or negative for the colour `below`; cells with NaN are left out.
    opacity : of the lightest and the darkest shade.
    gap : between cells, relative to their size.
    label : in the legend.
    """
    finite, negative = np.isfinite(share), share < 0
    level = np.round(SHADES * np.clip(np.abs(np.where(finite, share, 0.0)), 0.0, 1.0))
    for item, is_negative in sorted(set(zip(level[finite].tolist(), negative[finite].tolist(), strict=True))):
        i, j = np.nonzero(finite & (level == item) & (negative == is_negative))
        (left, right), (low, high) = ((e[k] + gap / 2 * np.diff(e)[k], e[k + 1] - gap / 2 * np.diff(e)[k])
                                      for e, k in ((x, i), (y, j)))  # fmt: skip
        around = np.array([[left, low], [right, low], [right, high], [left, high], [left, low]])
        codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY] * len(i)
        path = Path(np.moveaxis(around, 2, 0).reshape(-1, 2), codes)
        shade = opacity[0] + (opacity[1] - opacity[0]) * item / SHADES
        ax.add_artist(  # not add_patch, which would search every path for its extent, known from the cells
            PathPatch(path, facecolor=below if is_negative else colour, alpha=shade, linewidth=0.0, label=label)
        )
        label = None
    ax.update_datalim(np.stack([x[[0, -1]], y[[0, -1]]], axis=-1))
    ax.autoscale_view()


def shades(
    ax: Axes, ticks: Sequence[tuple[float, str]], label: str, colour: str = INK, below: str | None = None, *,
    opacity: tuple[float, float] = (0.06, 0.6),
) -> Axes:  # fmt: skip
    """Draw the scale of a map to its right: from light to dark, or from one colour through nothing to the other.

    Parameters
    ----------
    ax : axes of the map.
    ticks : (relative position on the scale, label).
    label, colour, below, opacity : as in `cells`.
    """
    figure = ax.get_figure()
    assert figure is not None
    beside = figure.dpi_scale_trans + ScaledTranslation(1.0, 0.0, cast(BboxTransformTo, ax.transAxes))
    with _style():
        scale = ax.inset_axes((9 / 72, 0, 7 / 72, 1), transform=blended_transform_factory(beside, ax.transAxes))
    edges = np.linspace(0.0, 1.0, 2 * SHADES + 1)
    middle = (edges[:-1] + edges[1:]) / 2
    cells(scale, np.array([0.0, 1.0]), edges, (2 * middle - 1 if below else middle)[None], colour, below or BLUE,
          opacity=opacity)  # fmt: skip
    scale.set(xlim=(0, 1), ylim=(0, 1), ylabel=label)
    scale.set_yticks([at for at, _ in ticks], [words for _, words in ticks])
    scale.grid(visible=False)
    scale.yaxis.tick_right()
    scale.yaxis.set_label_position("right")
    scale.xaxis.set_visible(False)
    scale.tick_params(length=0.0)
    scale.spines[:].set_visible(False)
    return scale


def _label_powers(axis: Axis) -> None:
    """Ticks of a logarithmic axis: powers of ten, and round values between them if these are few."""
    low, high = sorted(axis.get_view_interval())
    few = bool(high < FEW * low)
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _power_words(value, few)))
    axis.set_minor_locator(NullLocator())


def _power_words(value: float, few: bool) -> str:
    power = round(np.log10(value))
    if 0.1 <= value < 1e3 or (few and 1e-3 <= value < 1e4):
        return f"{value:g}"
    return raised(f"10^{power}") if np.isclose(value, 10.0**power, rtol=1e-9) else number(value, 1)


def _fit_letters(ax: Axes) -> None:
    """Hide tick labels below axes that would overlap; shrink labels beside axes to the height of the axes."""
    ax.title.set_fontsize(SIZE)
    renderer = _renderer(ax.get_figure())
    low, high = sorted(ax.get_xlim())
    below = [words for words in ax.get_xticklabels() if words.get_text() and low <= words.get_position()[0] <= high]
    boxes = [(words.get_window_extent(renderer), words) for words in below if not words.get_rotation()]
    end = -np.inf
    for box, words in sorted(boxes, key=lambda item: item[0].x0):
        words.set_visible(box.x0 > end + 1.5)
        end = box.x1 if words.get_visible() else end
    for child_axis in (ax, *ax.child_axes):
        long = child_axis.yaxis.label.get_window_extent(renderer).height
        child_axis.yaxis.label.set_fontsize(round(SIZE * min(1.0, (ax.bbox.height + 2 * GUTTER) / max(long, 1.0)), 1))


def _text(result: re.Match[str]) -> str:
    """A text element without the font that measured it, with symbols and indices."""
    size, style, place, words = result.groups()
    style = re.sub(r" font-family: [^;]*;?", "", style)
    place = re.sub(r' transform="rotate\(-0 .*?\)"', "", place)
    return f'<text style="font-size: {size}px;{style}"{place}>{_spans(unescape(words), float(size))}</text>'


def _spans(words: str, size: float) -> str:
    down, back, parts = f"{LOWERED * size:.2f}", "", []
    for span in named(words):
        shift = f' dy="{back}"' if back else ""
        if not span.symbol:
            parts.append(f"<tspan{shift}>{escape(span.words)}</tspan>" if shift else escape(span.words))
            back = ""
            continue
        parts.append(f'<tspan font-style="italic"{shift}>{escape(span.words)}</tspan>')
        for k, index in enumerate(span.index):
            first = f' dy="{down}"' if k == 0 else ""
            slanted = ' font-style="italic"' if is_symbol_index(index) else ""
            comma = "," if k else ""
            parts.append(f'<tspan font-size="{INDEX * size:.2f}"{first}{slanted}>{comma}{escape(index)}</tspan>')
        back = f"-{down}" if span.index else ""
    return "".join(parts)


CELLS = (60, 34)
"""Number of cells along each axis."""
OPACITY = (0.14, 0.85)

Ends = tuple[float, float]


def density(ax: Axes, x: Array, y: Array, x_ends: Ends, y_ends: Ends, count: tuple[int, int] = CELLS) -> float:
    """Draw numbers of samples per cell, shaded by their logarithm; empty cells are left out. Returns the largest."""
    across, along = (np.linspace(*apart(ends), n + 1) for ends, n in zip((x_ends, y_ends), count, strict=True))
    counts = np.histogram2d(x, y, (across, along))[0]
    most = max(float(counts.max(initial=0.0)), 2.0)
    share = np.where(counts > 0, np.log(np.maximum(counts, 1.0)) / np.log(most), np.nan)
    cells(ax, across, along, share, PALE, opacity=OPACITY)
    return most


def scale_of_counts(ax: Axes, most: float) -> None:
    """Draw the scale of a density to its right: samples per cell, up to the largest number."""
    round_ones = [m * 10**k for k in range(6) for m in (1, 2, 5) if m * 10**k <= most]
    kept = round_ones[:: max(1, round(len(round_ones) / 5))]
    ticks = [(float(np.log(item) / np.log(most)), f"{item:g}") for item in kept]
    shades(ax, ticks, "samples per cell [1]", PALE, opacity=OPACITY)


def apart(ends: Ends) -> Ends:
    """Ends of an axis, moved apart if they are equal."""
    low, high = ends
    return (low, high) if high > low else (low - 1.0, low + 1.0)
