"""Step 2: see; strips with one cursor, the drive from above, speed against a_y; crop to what matters."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from . import charts
from .beneath import counted, number, pretty_unit
from .traces import ASIDE, Shown
from .widgets import button, choose, heading, quiet, title

if TYPE_CHECKING:
    from .page import Page

MOST_STRIPS = 12
Planes = list[tuple[ui.echart, str, str]]


async def prepare(page: Page) -> tuple[Shown, list[charts.StripChart]]:
    """The recording that is looked at, and its curves."""
    files = page.session.files()
    page.picked["file"] = page.picked["file"] if page.picked.get("file") in files else files[0]
    over = Shown(await page.off(page.work.recording, page.picked["file"]))
    return over, await page.off(_strips, over)


def _strips(over: Shown) -> list[charts.StripChart]:
    recording = over.recording
    names = [name for name in recording.signals if recording.has(name) and not name.startswith("sd_")]
    curves = {name: charts.PlottedTrace(name, over.points(np.asarray(recording[name]))) for name in names[:MOST_STRIPS]}
    return [charts.StripChart(name, recording.unit(name), [curve]) for name, curve in curves.items()]


def draw(page: Page, data: tuple[Shown, list[charts.StripChart]]) -> None:
    """The step."""
    (over, strips), session = data, page.session
    recording, files = over.recording, session.files()
    rate = f" at {number(1 / recording.sample_time)} Hz" if recording.sample_time > 0 else ""
    runs = counted(len(recording.runs), "run")
    heading(
        "See what was recorded",
        f"{len(recording)} rows in {runs}, {number(recording.duration)} s{rate}. One cursor runs through all charts; "
        "turn the mouse wheel or drag the bar to zoom.",
    )
    with ui.row(align_items="center").classes("w-full"):
        if len(files) > 1:
            labels = {file: file.removeprefix("recordings/") for file in files}
            choose(labels, page.picked["file"], "recording", 14, partial(_other, page))
        if not over.laid:
            button("Crop to the visible part", partial(_crop, page, over), "crop", "outline")
        if session["between"]:
            undo = partial(session.change, between="", looked="")
            button(f"Undo the crop {session['between']} s", undo, "uncrop", "outline")
        button("Check it", partial(page.go, 2), "onward")
    height = 66 if len(strips) > 6 else 92
    planes: Planes = []
    with ui.element("div").classes("side"):
        with ui.column():
            options = charts.strips(strips, over.span, height=height, cursor=session["cursor"])
            words = f"{', '.join(strip.name for strip in strips)} over time"
            element = charts.chart(options, charts.height_of(len(strips), height), words).mark("strips")
            if over.laid:
                quiet("Clocks start again in this recording: runs are drawn one after the other.")
        with ui.column():
            if recording.has("x", "y"):
                title("From above")
                plane = charts.plane("x [m]", "y [m]", over.along(recording["x"], recording["y"]), equal=True)
                planes.append((charts.chart(plane, 378, "the drive from above"), "x", "y"))
            if recording.has("v_x", "a_y"):
                title("Speed against lateral acceleration")
                points = over.along(recording["a_y"], recording["v_x"])
                plane = charts.plane(f"a_y [{pretty_unit('m/s^2')}]", "v_x [m/s]", points, dots=True)
                planes.append((charts.chart(plane, 290, "speed against lateral acceleration"), "a_y", "v_x"))
            here = quiet("").mark("cursor")
    _connect(page, over, element, planes, strips, here)


def _connect(
    page: Page, over: Shown, element: ui.echart, planes: Planes, strips: list[charts.StripChart], here: ui.label
) -> None:
    """Zoom asks for finer curves; the cursor moves a dot through the other pictures."""
    recording = over.recording
    signals = {strip.name: np.asarray(recording[strip.name]) for strip in strips}
    coarse = {name: over.points(values, ASIDE) for name, values in signals.items()}

    async def zoomed(low: float, high: float) -> None:
        page.window = (low, high)  # a few ms: a thread would take longer to wake
        fine = {f"{name}/{name}": over.closer(values, page.window, coarse[name]) for name, values in signals.items()}
        await charts.with_curves(element, fine)

    async def cursor(event: Any) -> None:
        row = over.row(float(event.args["t"]))
        page.session.state["cursor"] = round(float(over.time[row]), 4)
        for chart, across, up in planes:
            await charts.with_curves(chart, {"here": np.array([[recording[across][row], recording[up][row]]])})
        here.set_text(f"cursor at {over.time[row]:.2f} s")

    charts.on_zoom(element, over.span, zoomed)
    charts.on_cursor(element, cursor)


async def _other(page: Page, event: Any) -> None:
    page.picked["file"], page.window = event.value, None
    await page.draw()


def _crop(page: Page, over: Shown) -> None:
    low, high = page.window or over.span
    page.window = None
    page.session.change(between=f"{low:.6g}:{high:.6g}", looked="")
