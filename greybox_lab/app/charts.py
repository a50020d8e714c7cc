"""Charts as ECharts takes them: strips with one cursor, a map, a waterfall; the report's colours and letters.

Every curve differs from the others in its dashes too, so that it is told on a grey printer and by every eye.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import ui

from .beneath import BLUE, FAINT, INK, ORANGE, PALE, PURPLE, RUST, SKY, number, percent, pretty_unit
from .traces import Points
from .why import UNNAMED, Step

SERIF = '"Libertinus Serif", "STIX Two Text", "Times New Roman", Times, serif'
LOOKS: dict[str, dict[str, Any]] = {
    "measured": {"color": INK, "width": 1.2, "type": "solid"},
    "before": {"color": PALE, "width": 1.2, "type": [2, 3]},
    "simulated": {"color": BLUE, "width": 1.6, "type": [7, 3]},
    "cause": {"color": RUST, "width": 1.8, "type": [10, 3, 2, 3]},
    "other": {"color": ORANGE, "width": 1.4, "type": [3, 3]},
    "third": {"color": PURPLE, "width": 1.4, "type": [8, 2, 2, 2]},
    "sky": {"color": SKY, "width": 1.4, "type": "solid"},
}
TOP, BETWEEN, BOTTOM = 30, 26, 64
"""Pixels above the first strip, between strips, and below the last, where the zoom's handle is."""


@dataclass(frozen=True)
class Curve:
    """One curve of a strip: its name in the legend, its points, its look."""

    name: str
    points: Points
    look: str = "measured"


@dataclass(frozen=True)
class Strip:
    """One strip: the quantity with its unit, and its curves."""

    name: str
    unit: str
    curves: Sequence[Curve]


def strips(
    rows: Sequence[Strip], span: tuple[float, float], *, height: int = 92, zoom: bool = True, legend: bool = False,
    marks: Sequence[tuple[float, float]] = (), cursor: float | None = None, axis: str = "s",
) -> dict[str, Any]:  # fmt: skip
    """Strips under each other over one axis of time, with one cursor and one zoom through all."""
    count = len(rows)
    top = TOP if legend else 12
    grids, x, y, series = [], [], [], []
    for k, row in enumerate(rows):
        grids.append({"left": 78, "right": 18, "top": top + k * (height + BETWEEN), "height": height})
        last = k == count - 1
        x.append({
            "type": "value", "gridIndex": k, "min": span[0], "max": span[1],
            "axisLabel": {"show": last, "color": INK, "fontSize": 12, "hideOverlap": True, "showMinLabel": False, "showMaxLabel": False},
            "axisTick": {"show": last}, "axisLine": {"lineStyle": {"color": PALE}, "onZero": False},
            "splitLine": {"show": True, "lineStyle": {"color": FAINT}},
            "name": f"time [{axis}]" if last else "", "nameLocation": "middle", "nameGap": 24,
            "axisPointer": {"show": True, "label": {"show": last, "precision": 2}},
        })  # fmt: skip
        y.append({
            "type": "value", "gridIndex": k, "scale": True, "splitNumber": 3,
            "name": f"{row.name} [{pretty_unit(row.unit)}]", "nameLocation": "middle", "nameGap": 56,
            "nameTextStyle": {"fontSize": 12, "color": INK, "width": height + 18, "overflow": "truncate"},
            "axisLabel": {"color": INK, "fontSize": 11, "hideOverlap": True},
            "axisLine": {"show": True, "lineStyle": {"color": PALE}},
            "splitLine": {"lineStyle": {"color": FAINT}},
        })  # fmt: skip
        for curve in row.curves:
            line = dict(LOOKS[curve.look])
            entry: dict[str, Any] = {
                "type": "line", "id": f"{row.name}/{curve.name}", "name": curve.name, "xAxisIndex": k, "yAxisIndex": k,
                "data": curve.points, "showSymbol": False, "animation": False, "lineStyle": line,
                "itemStyle": {"color": line["color"]}, "connectNulls": False, "emphasis": {"disabled": True},
            }  # fmt: skip
            if curve is row.curves[0] and (marks or cursor is not None):
                if marks:
                    areas = [[{"xAxis": low}, {"xAxis": high}] for low, high in marks]
                    entry["markArea"] = {"silent": True, "itemStyle": {"color": ORANGE, "opacity": 0.22}, "data": areas}
                if cursor is not None:
                    entry["markLine"] = {
                        "silent": True, "symbol": "none", "label": {"show": False}, "animation": False,
                        "lineStyle": {"color": RUST, "type": "solid", "width": 1}, "data": [{"xAxis": cursor}],
                    }  # fmt: skip
            series.append(entry)
    every = list(range(count))
    options: dict[str, Any] = {
        "animation": False, "textStyle": {"fontFamily": SERIF, "color": INK},
        "grid": grids, "xAxis": x, "yAxis": y, "series": series,
        "axisPointer": {"link": [{"xAxisIndex": "all"}], "lineStyle": {"color": INK}},
        "tooltip": {
            "trigger": "axis", "confine": True, "transitionDuration": 0, "textStyle": {"fontSize": 12, "fontFamily": SERIF},
            "padding": 6,
        },
        "aria": {"enabled": True},
    }  # fmt: skip
    if legend:
        options["legend"] = {
            "top": 0, "left": 70, "itemWidth": 34, "itemStyle": {"opacity": 0}, "textStyle": {"fontFamily": SERIF, "fontSize": 13},
            "data": list(dict.fromkeys(curve.name for row in rows for curve in row.curves)),
        }  # fmt: skip
    if zoom:
        options["dataZoom"] = [
            {"type": "inside", "xAxisIndex": every, "filterMode": "none", "throttle": 60},
            {"type": "slider", "xAxisIndex": every, "filterMode": "none", "height": 18, "bottom": 6, "throttle": 60,
             "showDataShadow": False, "brushSelect": True, "labelPrecision": 1, "handleLabel": {"show": False}},
        ]  # fmt: skip
    return options


def height_of(count: int, height: int = 92, legend: bool = False, zoom: bool = True) -> int:
    """Pixels that so many strips take."""
    return (TOP if legend else 12) + count * (height + BETWEEN) - BETWEEN + (BOTTOM if zoom else 44)


def chart(options: dict[str, Any], height: int, about: str) -> ui.echart:
    """A chart of so many pixels, with words for those who cannot see it."""
    element = ui.echart(options).classes("w-full").style(f"height: {height}px; min-width: 0")
    return element.props(f'role=img tabindex=0 aria-label="{_attribute(about)}"')


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


def on_cursor(element: ui.echart, moved: Callable[[Any], None]) -> None:
    """Call with the instant under the reader's cursor, as `event.args["t"]`."""
    listen = (
        f"() => {{ const one = getElement({element.id}); if (!one || !one.chart || one.chart.follows) return; "
        "one.chart.follows = true; one.chart.on('updateAxisPointer', e => "
        "{ if (e.axesInfo && e.axesInfo.length) one.$emit('cursor', {t: e.axesInfo[0].value}); }); }"
    )
    element.on("cursor", moved, throttle=0.06)
    element.on("chart:rendered", js_handler=listen)


def with_curves(element: ui.echart, points: Mapping[str, Points]) -> None:
    """Draw other points of some curves, by id "strip/curve", and nothing else anew."""
    series = [{"id": name, "data": data} for name, data in points.items()]
    element.run_chart_method("setOption", {"series": series})


def plane(name: str, across: str, up: str, points: Points, *, equal: bool, dots: bool = False) -> dict[str, Any]:
    """Points of one quantity over another: the drive from above, speed against a_y; a dot follows the cursor."""
    line = {
        "type": "scatter" if dots else "line", "id": "all", "name": name, "data": points, "showSymbol": dots, "symbolSize": 3,
        "animation": False, "lineStyle": LOOKS["measured"], "itemStyle": {"color": BLUE if dots else INK, "opacity": 0.45 if dots else 1},
        "silent": True,
    }  # fmt: skip
    here = {
        "type": "scatter", "id": "here", "name": "cursor", "data": [], "symbol": "diamond", "symbolSize": 14,
        "itemStyle": {"color": RUST, "borderColor": "#fff", "borderWidth": 1}, "animation": False, "silent": True,
    }  # fmt: skip
    x_axis, y_axis = (
        {"type": "value", "scale": True, "name": label, "nameLocation": "middle", "nameGap": gap,
         "axisLabel": {"color": INK, "hideOverlap": True, "showMinLabel": False, "showMaxLabel": False},
         "axisLine": {"lineStyle": {"color": PALE}, "onZero": False}, "splitLine": {"lineStyle": {"color": FAINT}}}
        for label, gap in ((across, 26), (up, 44))
    )  # fmt: skip
    if equal and points:
        known = [point for point in points if point is not None]
        xs, ys = [point[0] for point in known], [point[1] for point in known]
        half = max(max(xs) - min(xs), max(ys) - min(ys), 1e-9) * 0.55
        for axis, values in ((x_axis, xs), (y_axis, ys)):
            middle = (max(values) + min(values)) / 2
            axis["min"], axis["max"] = float(f"{middle - half:.3g}"), float(f"{middle + half:.3g}")
    return {
        "animation": False, "textStyle": {"fontFamily": SERIF, "color": INK},
        "grid": {"left": 66, "right": 16, "top": 14, "bottom": 46}, "xAxis": x_axis, "yAxis": y_axis, "series": [line, here],
        "aria": {"enabled": True},
    }  # fmt: skip


def waterfall(steps: Sequence[Step]) -> dict[str, Any]:
    """The budget: from the whole excess down, cause by cause, to what nothing explains."""
    names = ["whole gap", *(step.name for step in steps)]
    base, bars, whiskers = [0.0], [{"value": 100.0, "itemStyle": {"color": INK}, "label": _label("100 %")}], []
    for k, step in enumerate(steps, 1):
        end = step.start - step.share
        low, high = sorted((100 * step.start, 100 * end))
        base.append(low)
        named = step.name != UNNAMED
        colour = BLUE if step.applied else SKY if named else "#b9b9b9"
        bars.append({
            "value": high - low, "label": _label(percent(step.share)),
            "itemStyle": {"color": colour, "decal": None if step.applied or not named else {"symbol": "rect", "dashArrayX": [1, 0], "dashArrayY": [3, 4], "rotation": 0.7, "color": "rgba(0,0,0,.25)"}},
        })  # fmt: skip
        if named:
            whiskers.append([100 * (step.start - step.high), k, 100 * (step.start - step.low), k])
    lines = [[{"coord": [a, y], "symbol": "none"}, {"coord": [b, z], "symbol": "none"}] for a, y, b, z in whiskers]
    return {
        "animation": False, "textStyle": {"fontFamily": SERIF, "color": INK},
        "grid": {"left": 176, "right": 70, "top": 8, "bottom": 42},
        "xAxis": {"type": "value", "name": "share of the excess error [%]", "nameLocation": "middle", "nameGap": 26,
                  "min": "dataMin" if min([0.0, *base]) < 0 else 0, "axisLabel": {"color": INK}, "splitLine": {"lineStyle": {"color": FAINT}}},
        "yAxis": {"type": "category", "inverse": True, "data": names, "axisTick": {"show": False},
                  "axisLabel": {"color": INK, "fontSize": 14, "width": 160, "overflow": "truncate"}, "axisLine": {"lineStyle": {"color": PALE}}},
        "series": [
            {"type": "bar", "stack": "all", "data": base, "itemStyle": {"color": "transparent"}, "silent": True, "barWidth": "62%"},
            {"type": "bar", "stack": "all", "id": "shares", "name": "share", "data": bars, "cursor": "pointer",
             "markLine": {"silent": True, "symbol": "none", "animation": False, "label": {"show": False}, "lineStyle": {"color": INK, "type": "solid", "width": 1.4}, "data": lines}},
        ],
        "tooltip": {"show": False}, "aria": {"enabled": True},
    }  # fmt: skip


def objective(history: Sequence[float]) -> dict[str, Any]:
    """How far above its end the objective was, step by step."""
    end = min(history)
    points = [[k, float(f"{max(value - end, 1e-12):.4g}")] for k, value in enumerate(history)]
    return {
        "animation": False, "textStyle": {"fontFamily": SERIF, "color": INK},
        "grid": {"left": 66, "right": 16, "top": 12, "bottom": 44},
        "xAxis": {"type": "value", "name": "step", "nameLocation": "middle", "nameGap": 24, "axisLabel": {"color": INK}, "splitLine": {"show": False}},
        "yAxis": {"type": "log", "name": "above its end", "nameLocation": "middle", "nameGap": 48, "axisLabel": {"color": INK, "hideOverlap": True}, "splitLine": {"lineStyle": {"color": FAINT}}},
        "series": [{"type": "line", "data": points, "showSymbol": False, "lineStyle": LOOKS["simulated"], "animation": False, "silent": True}],
        "aria": {"enabled": True},
    }  # fmt: skip


def _label(text: str) -> dict[str, Any]:
    return {"show": True, "position": "right", "formatter": text, "color": INK, "fontSize": 13}


def _attribute(text: str) -> str:
    return text.replace("\\", "").replace('"', "'")


__all__ = [
    "Curve",
    "Strip",
    "chart",
    "height_of",
    "number",
    "objective",
    "on_cursor",
    "on_zoom",
    "plane",
    "strips",
    "waterfall",
    "with_curves",
]
