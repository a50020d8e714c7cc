"""Charts as ECharts takes them: strips with one cursor, a map, a waterfall; the report's colours and letters.

Every curve differs from the others in its dashes too, so that it is told on a grey printer and by every eye.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from nicegui import ui

from .beneath import BLUE, FAINT, INK, ORANGE, PALE, PURPLE, RUST, SKY, percent, pretty_unit
from .traces import Array

SERIF = '"Libertinus Serif", "STIX Two Text", "Times New Roman", Times, serif'
BASE = {"animation": False, "textStyle": {"fontFamily": SERIF, "color": INK}}
LOOKS: dict[str, dict[str, Any]] = {
    "measured": {"color": INK, "width": 1.2, "type": "solid"},
    "before": {"color": PALE, "width": 1.2, "type": [2, 3]},
    "simulated": {"color": BLUE, "width": 1.6, "type": [7, 3]},
    "cause": {"color": RUST, "width": 1.8, "type": [10, 3, 2, 3]},
    "other": {"color": ORANGE, "width": 1.4, "type": [3, 3]},
    "third": {"color": PURPLE, "width": 1.4, "type": [8, 2, 2, 2]},
}
TOP, BETWEEN, BOTTOM = 30, 26, 64
"""Pixels above the first strip, between strips, and below the last, where the zoom's handle is."""


@dataclass(frozen=True)
class PlottedTrace:
    """One curve of a strip: its name in the legend, its points, its look."""

    name: str
    points: Array
    look: str = "measured"


@dataclass(frozen=True)
class StripChart:
    """One strip: the quantity with its unit, and its curves."""

    name: str
    unit: str
    curves: Sequence[PlottedTrace]
    span: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True)
class Step:
    """One step of the waterfall: a share with its interval, the share left before it, whether it is applied."""

    name: str
    share: float
    low: float
    high: float
    start: float
    applied: bool


def strips(
    rows: Sequence[StripChart], span: tuple[float, float], *, height: int = 92, zoom: bool = True, legend: bool = False,
    marks: Sequence[tuple[float, float]] = (), cursor: float | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Strips under each other over one axis of time, with one cursor and one zoom through all."""
    top = TOP if legend else 12
    grids, x, y, series = [], [], [], []
    for k, row in enumerate(rows):
        last = k == len(rows) - 1
        grids.append({"left": 78, "right": 18, "top": top + k * (height + BETWEEN), "height": height})
        pointer = {"show": True, "label": {"show": last, "precision": 2}}
        ticks = {"min": span[0], "max": span[1], "axisTick": {"show": last}, "axisPointer": pointer}
        along = _axis("time [s]" if last else "", 24, gridIndex=k, **ticks)
        along["axisLabel"]["show"] = last
        x.append(along)
        name = {"fontSize": 12, "color": INK, "width": height + 18, "overflow": "truncate"}
        up = _axis(f"{row.name} [{pretty_unit(row.unit)}]", 56, gridIndex=k, scale=True, splitNumber=3)
        up["axisLabel"] |= {"showMinLabel": None, "showMaxLabel": None, "fontSize": 11}
        y.append(up | {"nameTextStyle": name})
        for curve in row.curves:
            line = dict(LOOKS[curve.look])
            entry: dict[str, Any] = {
                "type": "line", "id": f"{row.name}/{curve.name}", "name": curve.name, "xAxisIndex": k, "yAxisIndex": k,
                "data": curve.points, "dimensions": ["t", "value"], "showSymbol": False, "animation": False,
                "lineStyle": line, "itemStyle": {"color": line["color"]}, "emphasis": {"disabled": True},
            }  # fmt: skip
            if curve is row.curves[0] and marks:
                areas = [[{"xAxis": low}, {"xAxis": high}] for low, high in marks]
                entry["markArea"] = {"silent": True, "itemStyle": {"color": ORANGE, "opacity": 0.22}, "data": areas}
            if curve is row.curves[0] and cursor is not None:
                entry["markLine"] = {
                    "silent": True, "symbol": "none", "label": {"show": False}, "animation": False,
                    "lineStyle": {"color": RUST, "type": "solid", "width": 1}, "data": [{"xAxis": cursor}],
                }  # fmt: skip
            series.append(entry)
    words = {"fontSize": 12, "fontFamily": SERIF}
    options: dict[str, Any] = {
        **BASE, "grid": grids, "xAxis": x, "yAxis": y, "series": series,
        "axisPointer": {"link": [{"xAxisIndex": "all"}], "lineStyle": {"color": INK}},
        "tooltip": {"trigger": "axis", "confine": True, "transitionDuration": 0, "textStyle": words, "padding": 6},
    }  # fmt: skip
    if legend:
        options["legend"] = {
            "top": 0, "left": 70, "itemWidth": 34, "itemStyle": {"opacity": 0},
            "textStyle": {"fontFamily": SERIF, "fontSize": 13},
            "data": list(dict.fromkeys(curve.name for row in rows for curve in row.curves)),
        }  # fmt: skip
    if zoom:
        options["dataZoom"] = [
            {"type": "inside", "xAxisIndex": "all", "filterMode": "none", "throttle": 60},
            {"type": "slider", "xAxisIndex": "all", "filterMode": "none", "height": 18, "bottom": 6, "throttle": 60,
             "showDataShadow": False, "brushSelect": True, "labelPrecision": 1, "handleLabel": {"show": False}},
        ]  # fmt: skip
    return options


def height_of(count: int, height: int = 92, legend: bool = False, zoom: bool = True) -> int:
    """Pixels that so many strips take."""
    return (TOP if legend else 12) + count * (height + BETWEEN) - BETWEEN + (BOTTOM if zoom else 44)


def chart(options: dict[str, Any], height: int, about: str) -> ui.echart:
    """A chart of so many pixels, with words for those who cannot see it."""
    element = ui.echart(options).classes("w-full").style(f"height: {height}px; min-width: 0")
    words = about.replace("\\", "").replace('"', "'")
    return element.props(f'role=img tabindex=0 aria-label="{words}"')


def on_zoom(element: ui.echart, span: tuple[float, float], zoomed: Callable[[float, float], Any]) -> None:
    """Call with the window, s, after the reader has zoomed."""

    async def handle(event: Any) -> None:
        part = (event.args.get("batch") or [event.args])[0]
        if part.get("startValue") is not None and part.get("endValue") is not None and part.get("start") is None:
            low, high = float(part["startValue"]), float(part["endValue"])
        elif part.get("start") is not None:
            width = span[1] - span[0]
            low, high = span[0] + width * part["start"] / 100, span[0] + width * part["end"] / 100
        else:
            return
        result = zoomed(low, high)
        if hasattr(result, "__await__"):
            await result

    element.on("chart:datazoom", handle, ["start", "end", "startValue", "endValue", "batch"], throttle=0.08)


def on_cursor(element: ui.echart, moved: Callable[[Any], Awaitable[None]]) -> None:
    """Call with the instant under the reader's cursor, as `event.args["t"]`."""
    listen = (
        f"() => {{ const one = getElement({element.id}); if (!one || !one.chart || one.chart.follows) return; "
        "one.chart.follows = true; one.chart.on('updateAxisPointer', e => "
        "{ if (e.axesInfo && e.axesInfo.length) one.$emit('cursor', {t: e.axesInfo[0].value}); }); }"
    )
    element.on("cursor", moved, throttle=0.06)
    element.on("chart:rendered", js_handler=listen)


DRAW = """
const element = getElement(%d), curves = %s;
function floats(text) {
  const letters = atob(text), bytes = new Uint8Array(letters.length);
  for (let k = 0; k < letters.length; k++) bytes[k] = letters.charCodeAt(k);
  return new Float64Array(bytes.buffer);
}
const series = Object.entries(curves).map(([id, text]) => ({id, data: floats(text)}));
if (element && element.chart) element.chart.setOption({series}, {silent: true});
return null;
"""
"""Numbers come as they lie in memory: a browser takes them ten times as fast as lists of lists."""


async def with_curves(element: ui.echart, points: Mapping[str, Array]) -> None:
    """Draw other (k, 2) points of some curves, by id "strip/curve", and nothing else anew; returns once it is done."""
    curves = {name: b64encode(np.ascontiguousarray(data).data).decode() for name, data in points.items()}
    with suppress(TimeoutError):
        await element.client.run_javascript(DRAW % (element.id, json.dumps(curves)))


def plane(across: str, up: str, points: Array, *, equal: bool = False, dots: bool = False) -> dict[str, Any]:
    """Points of one quantity over another: the drive from above, speed against a_y; a dot follows the cursor."""
    ink = {"color": BLUE, "opacity": 0.45} if dots else {"color": INK}
    every = {
        "type": "scatter" if dots else "line", "id": "all", "data": points, "showSymbol": dots, "symbolSize": 3,
        "animation": False, "lineStyle": LOOKS["measured"], "itemStyle": ink, "silent": True,
    }  # fmt: skip
    here = {
        "type": "scatter", "id": "here", "data": [], "symbol": "diamond", "symbolSize": 14, "animation": False,
        "itemStyle": {"color": RUST, "borderColor": "#fff", "borderWidth": 1}, "silent": True, "z": 5,
    }  # fmt: skip
    x, y = (_axis(name, gap, scale=True) for name, gap in ((across, 26), (up, 44)))
    if equal and len(points):
        low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        half = 0.55 * max(float(np.max(high - low)), 1e-9)
        for axis, middle in zip((x, y), (low + high) / 2, strict=True):
            axis["min"], axis["max"] = float(f"{middle - half:.3g}"), float(f"{middle + half:.3g}")
    return {**BASE, "grid": {"left": 66, "right": 16, "top": 14, "bottom": 46}, "xAxis": x, "yAxis": y,
            "series": [every, here]}  # fmt: skip


STRIPED = {"symbol": "rect", "dashArrayX": [1, 0], "dashArrayY": [3, 4], "rotation": 0.7, "color": "rgba(0,0,0,.25)"}
GREY, UNNAMED = "#b9b9b9", "unexplained"


def waterfall(steps: Sequence[Step]) -> dict[str, Any]:
    """The budget: from the whole excess down, cause by cause, to what nothing explains."""
    base, whiskers = [0.0], []
    bars: list[dict[str, Any]] = [{"value": 100.0, "itemStyle": {"color": INK}}]
    words: list[dict[str, Any]] = [{"value": 0.0, "label": _label("100 %")}]
    for k, step in enumerate(steps, 1):
        low, high = sorted(round(100 * end, 6) for end in (step.start, step.start - step.share))
        named = step.name != UNNAMED
        look: dict[str, Any] = {"color": BLUE if step.applied else SKY if named else GREY}
        if named and not step.applied:
            look["decal"] = STRIPED
        base.append(low)
        bars.append({"value": high - low, "itemStyle": look})
        ends = [min(100 * (step.start - share), 100.0) for share in (step.high, step.low)]  # beyond, none is drawn
        words.append({"value": max(0.0, named * (ends[1] - high)), "label": _label(percent(step.share))})
        if named:
            whiskers.append([{"coord": [end, k], "symbol": "none"} for end in ends])
    line = {"color": INK, "type": "solid", "width": 1.4}
    marks = {"silent": True, "symbol": "none", "animation": False, "label": {"show": False}, "lineStyle": line}
    percent_axis = _axis("share of the excess error [%]", 26, min="dataMin" if min(base) < 0 else 0)
    percent_axis["axisLabel"] |= {"showMinLabel": True, "showMaxLabel": True}
    names = {"fontSize": 14, "width": 160, "overflow": "truncate", "color": INK}
    stacked = {"type": "bar", "stack": "all", "stackStrategy": "all"}
    clear = {"itemStyle": {"color": "transparent"}, "silent": True}
    return {
        **BASE, "grid": {"left": 176, "right": 70, "top": 8, "bottom": 42},
        "xAxis": percent_axis,
        "yAxis": {"type": "category", "inverse": True, "data": ["whole gap", *(step.name for step in steps)],
                  "axisTick": {"show": False}, "axisLabel": names, "axisLine": {"lineStyle": {"color": PALE}}},
        "series": [
            {**stacked, **clear, "data": base, "barWidth": "62%"},
            {**stacked, "id": "shares", "data": bars, "cursor": "pointer", "markLine": {**marks, "data": whiskers}},
            {**stacked, **clear, "data": words},
        ],
    }  # fmt: skip


def _axis(name: str, gap: int, **more: Any) -> dict[str, Any]:
    """An axis of values with its name and unit."""
    label = {"color": INK, "fontSize": 12, "hideOverlap": True, "showMinLabel": False, "showMaxLabel": False}
    line = {"show": True, "lineStyle": {"color": PALE}, "onZero": False}
    return {
        "type": "value", "name": name, "nameLocation": "middle", "nameGap": gap, "axisLabel": label, "axisLine": line,
        "splitLine": {"lineStyle": {"color": FAINT}}, **more,
    }  # fmt: skip


def _label(text: str) -> dict[str, Any]:
    return {"show": True, "position": "right", "formatter": text, "color": INK, "fontSize": 13}
