"""Step 3: check; a light per channel, the rows it is about, repairs as buttons. The fit is locked until it was seen."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from . import charts
from .beneath import counted
from .traces import Shown
from .widgets import button, heading, quiet, title, verdict

if TYPE_CHECKING:
    from .page import Page

GOOD = ("● good", "green")
LIGHTS = {"distrust": ("■ do not trust", "red"), "warning": ("▲ mind", "amber"), "note": ("● note", "green")}
"""Severity -> words with a shape, and the colour's class."""
ORDER = ("distrust", "warning", "note", "")


async def prepare(page: Page) -> dict[str, Any]:
    """The check of the recordings as they are now; started where there is none."""
    job = page.session.latest("check", page.session.key) or page.work.check()
    answer = job.answer if not job.running else None
    data: dict[str, Any] = {"job": job, "answer": answer, "every": [], "strip": None, "channels": []}
    if answer is None:
        return data
    every = [(Path(file["path"]).name, each) for file in answer["files"] for each in file["findings"]]
    data["every"] = every = sorted(every, key=lambda pair: ORDER.index(pair[1]["severity"]))
    read = [await page.off(page.work.recording, file) for file in page.session.files()]
    names = [name for recording in read for name in recording.signals if not name.startswith("sd_")]
    data["channels"] = list(dict.fromkeys(("time", *names)))
    page.picked["finding"] = min(page.picked.get("finding", 0), max(len(every) - 1, 0))
    if every:
        data["strip"] = await page.off(_strip, page, *every[page.picked["finding"]])
    return data


def _strip(
    page: Page, file: str, finding: dict[str, Any]
) -> tuple[Shown, charts.StripChart, list[tuple[float, float]]]:
    """The channel of a finding, with the rows it is about."""
    name = next(each for each in page.session.files() if Path(each).name == file)
    over = Shown(page.work.recording(name))
    recording = over.recording
    channel = finding["channel"] if finding["channel"] in recording else next(iter(recording.signals))
    wide = 0.004 * (over.span[1] - over.span[0])
    marks = [(over.time[row] - wide, over.time[row] + wide) for row in finding["rows"] if row < len(recording)]
    if not marks and finding["run"]:
        start, stop = recording.runs[min(finding["run"], len(recording.runs)) - 1]
        marks = [(over.time[start], over.time[stop - 1])]
    curve = charts.PlottedTrace(channel, over.points(np.asarray(recording[channel])))
    places = [(float(low), float(high)) for low, high in marks]
    return over, charts.StripChart(channel, recording.unit(channel), [curve]), places


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    session, job, answer = page.session, data["job"], data["answer"]
    heading("Can it be trusted?", "Channels are checked against each other: units, signs, clocks, delays.")
    if answer is None:
        if job.failure:
            verdict("The check did not finish.", job.failure, bad=True)
            button("Check again", page.work.check)
        else:
            ui.label("Checking …").classes("sentence")
        return
    severities = [each["severity"] for _, each in data["every"]]
    trusted, warnings = "distrust" not in severities, severities.count("warning")
    if trusted:
        verdict(f"Can be used; mind {counted(warnings, 'warning')}." if warnings else "Can be used.")
    else:
        verdict("Not to be trusted as it is: repair the map, or fit at your own risk.", bad=True)
    for words in session["repairs"]:
        quiet(f"✓ {words}")

    async def onward() -> None:
        session.change(looked=session.key)
        await page.go(3)

    words = "I have looked: choose a model" if trusted else "Continue despite the findings"
    button(words, onward, "looked", "" if trusted else "outline")
    with ui.element("div").classes("left"):
        with ui.column():
            _lights(page, data)
        with ui.column():
            _findings(page, data)


def _lights(page: Page, data: dict[str, Any]) -> None:
    title("Channels")
    worst: dict[str, int] = {}
    for k, (_, each) in enumerate(data["every"]):  # the gravest first
        worst.setdefault(each["channel"], k)
    with ui.element("div").classes("lights"):
        for name in dict.fromkeys((*data["channels"], *worst)):
            if name in worst:
                button(name, partial(_pick, page, worst[name]), f"light-{name}", "flat").classes("cause")
            else:
                ui.label(name).style("padding: .25rem .7rem")
            severity = data["every"][worst[name]][1]["severity"] if name in worst else "note"
            words, colour = GOOD if severity == "note" else LIGHTS[severity]
            ui.label(words).classes(f"light {colour}")


async def _pick(page: Page, k: int) -> None:
    page.picked["finding"] = k
    await page.draw()


def _findings(page: Page, data: dict[str, Any]) -> None:
    if not data["every"]:
        ui.label("Nothing noteworthy.").classes("sentence")
        return
    over, strip, marks = data["strip"]
    options = charts.strips([strip], over.span, height=120, marks=marks, cursor=page.session["cursor"])
    words = f"{strip.name} over time, with the rows of the finding"
    with ui.element("div").classes("pinned"):
        charts.chart(options, charts.height_of(1, 120), words).mark("finding-strip")
    title("Findings")
    several = len({file for file, _ in data["every"]}) > 1
    for k, (file, each) in enumerate(data["every"]):
        _finding(page, each, file if several else "", k, each["channel"] in data["channels"])


def _finding(page: Page, finding: dict[str, Any], file: str, k: int, shows: bool) -> None:
    words, colour = LIGHTS[finding["severity"]]
    with ui.column().classes("card picked" if k == page.picked["finding"] else "card"):
        with ui.row(align_items="center").classes("w-full"):
            ui.label(words).classes(f"light {colour}")
            ui.label(finding["channel"]).style("font-weight: bold")
            quiet(file)
            ui.space()
            if shows:
                button("Show where", partial(_pick, page, k), f"show-{k}", "flat")
        ui.label(finding["sentence"])
        if finding["repair"]:
            button("Repair the map", page.work.repair, f"repair-{k}")
