"""Step 2: see; strips with one cursor, the drive from above, speed against a_y; crop to what matters."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from . import charts
from .beneath import number, pretty_unit
from .traces import Shown

if TYPE_CHECKING:
    from .page import Page

MOST_STRIPS = 12


async def prepare(page: Page) -> Shown:
    """The recording that is looked at, and its curves."""
    files = page.session.files()
    file = page.picked.get("file")
    file = file if file in files else files[0]
    page.picked["file"] = file
    shown = Shown(await page.off(page.work.recording, file))
    page.picked["strips"] = await page.off(_strips, shown)
    return shown


def _strips(shown: Shown) -> list[charts.Strip]:
    recording = shown.recording
    names = [name for name in recording.signals if recording.has(name) and not name.startswith("sd_")]
    return [
        charts.Strip(name, recording.unit(name), [charts.Curve(name, shown.points(np.asarray(recording[name])))])
        for name in names[:MOST_STRIPS]
    ]


def draw(page: Page, shown: Shown) -> None:
    """The step."""
    from .page import guarded, heading, title

    session, recording = page.session, shown.recording
    rate = f" at {number(1 / recording.sample_time)} Hz" if recording.sample_time > 0 else ""
    heading(
        "See what was recorded",
        f"{len(recording)} rows in {len(recording.runs)} runs, {number(recording.duration)} s{rate}. One cursor goes through all; turn the wheel or drag the bar to zoom.",
    )
    strips: list[charts.Strip] = page.picked["strips"]
    height = 66 if len(strips) > 6 else 92
    with ui.row(align_items="center").classes("w-full"):
        files = session.files()
        if len(files) > 1:
            labels = {file: file.removeprefix("recordings/") for file in files}
            ui.select(labels, value=page.picked["file"], on_change=partial(_other, page), label="recording").props(
                "dense outlined"
            ).style("min-width: 14rem")
        if not shown.laid:
            ui.button("Crop to what is seen", on_click=guarded(page, lambda: _crop(page, shown))).props(
                "outline dense no-caps"
            ).mark("crop")
        if session["between"]:
            ui.button(
                f"Undo the crop {session['between']} s", on_click=lambda: session.change(between="", looked="")
            ).props("outline dense no-caps")

        async def onward() -> None:
            await page.go(2)

        ui.button("Check it", on_click=onward).props("no-caps").mark("onward")
    with ui.element("div").classes("side"):
        with ui.column():
            options = charts.strips(strips, shown.span, height=height, cursor=session["cursor"])
            element = charts.chart(
                options,
                charts.height_of(len(strips), height),
                f"strips of {', '.join(strip.name for strip in strips)} over time",
            ).mark("strips")
            if shown.laid:
                ui.label("Clocks begin anew in this recording: runs are laid one behind the other.").classes("quiet")
        planes = []
        with ui.column():
            if recording.has("x", "y"):
                title("From above")
                points = shown.along(recording["x"], recording["y"])
                plane = charts.plane("path", "x [m]", "y [m]", points, equal=True)
                planes.append((charts.chart(plane, 378, "the drive from above"), "x", "y"))
            if recording.has("v_x", "a_y"):
                title("Speed against lateral acceleration")
                points = shown.along(recording["a_y"], recording["v_x"])
                plane = charts.plane(
                    "speed", f"a_y [{pretty_unit('m/s^2')}]", "v_x [m/s]", points, equal=False, dots=True
                )
                planes.append((charts.chart(plane, 290, "speed against lateral acceleration"), "a_y", "v_x"))
            here = ui.label("").classes("quiet").mark("cursor")
    _connect(page, shown, element, planes, strips, here)


def _connect(
    page: Page,
    shown: Shown,
    element: ui.echart,
    planes: list[tuple[ui.echart, str, str]],
    strips: list[charts.Strip],
    here: ui.label,
) -> None:
    """Zoom asks for finer curves; the cursor moves a dot through the other pictures."""
    recording = shown.recording

    async def zoomed(low: float, high: float) -> None:
        page.window = (low, high)
        fine = await page.off(
            lambda: {
                f"{strip.name}/{strip.name}": shown.points(np.asarray(recording[strip.name]), (low, high))
                for strip in strips
            }
        )
        charts.with_curves(element, fine)

    def cursor(event: Any) -> None:
        instant = event.args.get("t") if isinstance(event.args, dict) else None
        if instant is None:
            return
        row = shown.row(float(instant))
        page.session.state["cursor"] = round(float(shown.time[row]), 4)
        for chart, across, up in planes:
            point = [float(recording[across][row]), float(recording[up][row])]
            data = [point] if all(np.isfinite(point)) else []
            chart.run_chart_method("setOption", {"series": [{"id": "here", "data": data}]})
        here.set_text(f"cursor at {shown.time[row]:.2f} s")

    charts.on_zoom(element, shown.span, zoomed)
    charts.on_cursor(element, cursor)


async def _other(page: Page, event: Any) -> None:
    page.picked["file"], page.window = event.value, None
    await page.draw()


def _crop(page: Page, shown: Shown) -> None:
    low, high = page.window or shown.span
    page.window = None
    page.session.change(between=f"{low:.6g}:{high:.6g}", looked="")
