"""Step 5: the fit; its verdict first, the held-out drive beside, then parameters with intervals."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

import greybox_id as gb

from . import charts
from .beneath import report_parts
from .model import longest, nominal
from .traces import Shown
from .widgets import button, choose, heading, title, verdict

if TYPE_CHECKING:
    from .page import Page

HORIZONS = {0.0: "whole runs", 0.2: "0.2 s ahead", 0.5: "0.5 s ahead", 1.0: "1 s ahead", 2.0: "2 s ahead"}


async def prepare(page: Page) -> dict[str, Any]:
    """The fit that is shown, over what it was fitted to and over what was held out."""
    session = page.session
    job, answer = page.work.result("fit")
    data: dict[str, Any] = {"job": job, "answer": answer, "drives": []}
    request = session["requests"].get(session["fit"])
    if answer is None or request is None:
        return data
    fit = await page.off(gb.load, session.folder / session["fit"] / "fit.json")
    data["parts"] = await page.off(report_parts, fit)
    for words, files in (("Fitted to", request["train"]), ("Held out", request["validate"])):
        if files:
            over, strips = await page.off(_drive, page, files[0], fit, request)
            data["drives"].append((words, files[0].removeprefix("recordings/"), over, strips))
    return data


def _drive(page: Page, file: str, fit: gb.Fit, request: dict[str, Any]) -> tuple[Shown, list[charts.StripChart]]:
    """A recording with the fit's free run, and with that of the model before it."""
    recording = longest(page.work.recording(file))
    over, runs = Shown(recording), {}
    with suppress(gb.GreyboxError):  # a model that runs away before it is fitted
        runs["before the fit"] = gb.simulate(nominal({**request["model"], "effects": []}), recording)
    runs["fit"] = gb.simulate(fit, recording)
    strips = []
    for name in filter(recording.has, fit.model.outputs):
        curves = [charts.PlottedTrace("measured", over.points(np.asarray(recording[name])))]
        for words, run in runs.items():
            look = "simulated" if words == "fit" else "before"
            curves.append(charts.PlottedTrace(words, over.points(np.asarray(run[name])), look))
        strips.append(charts.StripChart(name, recording.unit(name), curves))
    return over, strips


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    session, job, answer = page.session, data["job"], data["answer"]
    heading("Fit", "Parameters are moved until the simulation follows what was recorded; what was held out judges it.")
    with ui.row(align_items="center").classes("w-full"):

        def change(event: Any) -> None:
            session.change(quietly=True, horizon=event.value or None)

        choose(HORIZONS, session["horizon"] or 0.0, "horizon", 10, change)
        button("Fit again" if session["fit"] else "Fit", page.work.fit, "fit", "outline" if session["fit"] else "")
        made = {f"fits/{each.parent.name}" for each in session.folder.glob("fits/*/fit.json")} | {session["fit"]} - {""}
        if len(made) > 1:
            names = {name: name.replace("s/", " ") for name in sorted(made)}
            choose(names, session["fit"], "shown", 8, lambda event: session.change(fit=event.value))
        if answer is not None:
            button("Why not better?", partial(page.go, 5), "why")
    if answer is None:
        if job is not None and job.failure:
            verdict("There is no fit.", job.failure, bad=True)
        elif job is not None:
            lines = ui.html("", sanitize=False).classes("w-full")

            def tick() -> None:
                lines.set_content(f"<pre class=card>{escape(chr(10).join(job.lines[-14:]))}</pre>")

            page.every_tick(tick)
        return
    usability = answer["verdict"]
    verdict(usability.capitalize() + ".", " ".join(answer["reasons"]), bad=usability == "not usable")
    with ui.element("div").classes("two"):
        for words, file, over, strips in data["drives"]:
            with ui.column():
                title(f"{words}: {file}")
                options = charts.strips(strips, over.span, height=130, legend=True, cursor=session["cursor"])
                what = f"{words}: measured, before the fit and fitted"
                charts.chart(options, charts.height_of(len(strips), 130, True), what).mark(f"drive-{words}")
    ui.html(data["parts"], sanitize=False).classes("w-full")
