"""Step 3: check; a light per channel, the rows it is about, repairs as buttons. The fit is locked until it was seen."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

import greybox_id as gb

from . import charts
from .beneath import counted
from .mapping import repairs_of
from .traces import Shown

if TYPE_CHECKING:
    from .page import Page

LIGHTS = {
    "distrust": ("■ do not trust", "red"),
    "warning": ("▲ mind", "amber"),
    "note": ("● good", "green"),
    "": ("● good", "green"),
}
"""Severity -> words with a shape, and the colour's class."""
ORDER = ("distrust", "warning", "note", "")


async def prepare(page: Page) -> dict[str, Any]:
    """The check of the recordings as they are now; started where there is none."""
    job = page.work.checked()
    if job is None or (job.failure and not page.picked.get("checked again")):
        page.picked["checked again"] = job is not None
        job = page.work.check()
    answer = job.answer if not job.running else None
    data: dict[str, Any] = {"job": job, "answer": answer, "strip": None}
    if answer is not None:
        finding = page.picked.get("finding")
        every = [(file, each) for file in answer["files"] for each in file["findings"]]
        if finding is None or finding >= len(every):
            finding = 0 if every else None
        page.picked["finding"] = finding
        data["every"] = every
        if finding is not None:
            data["strip"] = await page.off(_strip, page, *every[finding])
    return data


def _strip(
    page: Page, file: dict[str, Any], finding: dict[str, Any]
) -> tuple[Shown, charts.Strip, list[tuple[float, float]]] | None:
    """The channel of a finding, with the rows it is about."""
    name = next((each for each in page.session.files() if Path(each).name == Path(file["path"]).name), None)
    if name is None:
        return None
    shown = Shown(page.work.recording(name))
    recording = shown.recording
    channel = finding["channel"] if finding["channel"] in recording else next(iter(recording.signals))
    marks = []
    wide = 0.004 * (shown.span[1] - shown.span[0])
    rows = [row for row in finding["rows"] if 0 <= row < len(recording)]
    if not rows and finding["run"]:
        start, stop = recording.runs[min(finding["run"], len(recording.runs)) - 1]
        marks = [(float(shown.time[start]), float(shown.time[stop - 1]))]
    marks += [(float(shown.time[row]) - wide, float(shown.time[row]) + wide) for row in rows]
    curve = charts.Curve(channel, shown.points(np.asarray(recording[channel])))
    return shown, charts.Strip(channel, recording.unit(channel), [curve]), marks


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    from .page import heading, title, verdict

    session = page.session
    heading(
        "Can it be trusted?",
        "Channels are checked against each other: units, signs, clocks, delays. A fit follows once you have looked.",
    )
    job, answer = data["job"], data["answer"]
    if answer is None:
        if job.failure:
            verdict("The check did not come to its end.", job.failure, bad=True)
        else:
            ui.label("Checking …").classes("sentence")
        return
    trusted = all(file["trusted"] for file in answer["files"])
    worst = [each["sentence"] for _, each in data["every"] if each["severity"] == "distrust"]
    if trusted:
        count = sum(each["severity"] == "warning" for _, each in data["every"])
        verdict("Can be used." if not count else f"Can be used; mind {counted(count, 'warning')}.")
    else:
        verdict(
            "Not to be trusted as it is: repair the map, or fit at your own risk.", worst[0] if worst else "", bad=True
        )
    for words in session["repairs"]:
        ui.label(f"✓ {words}").classes("quiet")

    async def onward() -> None:
        session.change(looked=session.key)
        await page.go(3)

    ui.button(
        "I have looked: choose a model" if trusted else "I have looked: go on all the same", on_click=onward
    ).props(f"no-caps {'' if trusted else 'outline'}").mark("looked")
    with ui.element("div").classes("left"):
        with ui.column():
            title("Channels")
            _lights(page, data)
        with ui.column():
            _findings(page, data)


def _lights(page: Page, data: dict[str, Any]) -> None:
    worst: dict[str, str] = {}
    channels = ["time"]
    for file in page.session.files():
        try:
            channels += [
                name
                for name in page.work.recording(file).signals
                if name not in channels and not name.startswith("sd_")
            ]
        except gb.GreyboxError:
            continue
    for _, each in data["every"]:
        name = each["channel"]
        worst[name] = min(worst.get(name, ""), each["severity"], key=ORDER.index)
    with ui.element("div").style(
        "display: grid; grid-template-columns: minmax(0, 1fr) 8.5rem; gap: .15rem .8rem; width: 100%"
    ):
        for name in [*channels, *(other for other in worst if other not in channels)]:
            words, colour = LIGHTS[worst.get(name, "")]
            first = next((k for k, (_, each) in enumerate(data["every"]) if each["channel"] == name), None)
            if first is None:
                ui.label(name).style("padding: .25rem .4rem")
            else:
                ui.button(name, on_click=partial(_pick, page, first)).props("flat dense no-caps align=left").mark(
                    f"light-{name}"
                )
            ui.label(words).classes(f"light {colour}").style("align-self: center")


async def _pick(page: Page, k: int) -> None:
    page.picked["finding"] = k
    await page.draw()


def _findings(page: Page, data: dict[str, Any]) -> None:
    from .page import guarded, title

    if not data["every"]:
        ui.label("Nothing noteworthy.").classes("sentence")
        return
    picked = page.picked["finding"]
    if data["strip"] is not None:
        shown, strip, marks = data["strip"]
        options = charts.strips([strip], shown.span, height=120, marks=marks, cursor=page.session["cursor"])
        charts.chart(options, charts.height_of(1, 120), f"{strip.name} over time, with the rows of the finding").mark(
            "finding-strip"
        )
    title("Findings")
    several = len({file["path"] for file, _ in data["every"]}) > 1
    for k, (file, each) in enumerate(data["every"]):
        words, colour = LIGHTS[each["severity"]] if each["severity"] != "note" else ("● note", "green")
        with ui.column().classes("card").style("border-left: .3rem solid var(--lead)" if k == picked else ""):
            with ui.row(align_items="center").classes("w-full"):
                ui.label(words).classes(f"light {colour}")
                ui.label(each["channel"]).style("font-weight: bold")
                if several:
                    ui.label(Path(file["path"]).name).classes("quiet")
                ui.space()
                if k != picked:
                    ui.button("Show where", on_click=partial(_pick, page, k)).props("flat dense no-caps")
            ui.label(each["sentence"])
            if each["severity"] == "distrust":
                with ui.row():
                    for repair in repairs_of(each["sentence"], each["channel"]):
                        act = guarded(page, partial(page.work.repair, repair))
                        ui.button(repair.words, on_click=act).props("dense no-caps").mark("repair")
