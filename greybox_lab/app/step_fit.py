"""Step 5: the fit; its verdict first, the held-out drive beside, then parameters with intervals."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from nicegui import ui

import greybox_id as gb

from . import charts
from .beneath import Model, report_parts
from .model import Playground, nominal
from .traces import Array
from .widgets import button, choose, heading, title, verdict

if TYPE_CHECKING:
    from .jobs import PageJob
    from .page import Page

HORIZONS = {0.0: "whole runs", 0.2: "0.2 s ahead", 0.5: "0.5 s ahead", 1.0: "1 s ahead", 2.0: "2 s ahead"}


class FittedDrive(NamedTuple):
    """A recording with what was measured, simulated before the fit, and by the fit: what it is, and its strips."""

    words: str
    bench: Playground
    strips: list[charts.StripChart]


async def prepare(page: Page) -> dict[str, Any]:
    """The fit that is shown or that runs, over what it is fitted to and over what is held out."""
    session = page.session
    job, answer = page.work.result("fit")
    data: dict[str, Any] = {"job": job, "answer": answer, "drives": []}
    request = session["requests"].get(session["fit"])
    if request is None or job is None or (answer is None and not job.running):
        return data
    model, at = nominal(request["model"]), {**request["model"]["start"], **job.place}
    if answer is not None:
        fit = await page.off(gb.load, session.folder / session["fit"] / "fit.json")
        data["parts"] = await page.off(report_parts, fit)
        model, at = fit.model, {}
    before = nominal({**request["model"], "effects": []})
    for words, files in (("Fitted to", request["train"]), ("Held out", request["validate"])):
        if files:
            recording = await page.off(page.work.recording, files[0])
            data["drives"].append(
                await page.off(_drive, f"{words}: {Path(files[0]).name}", model, before, recording, at)
            )
    return data


def _drive(words: str, model: Model, before: Model, recording: gb.Recording, at: Mapping[str, float]) -> FittedDrive:
    bench, runs = Playground(model, recording), dict[str, Mapping[str, Array]]()
    with suppress(gb.GreyboxError):  # a model that runs away before it is fitted
        nominal_run = gb.simulate(before, bench.recording)
        runs["before the fit"] = {name: np.asarray(nominal_run[name]) for name in bench.outputs}
    return FittedDrive(words, bench, bench.strips({**runs, "fit": bench.simulate(at)}))


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    session, job, answer = page.session, data["job"], data["answer"]
    heading(
        "Fit",
        "Parameters are estimated so that the simulation follows the recording; the held-out recording judges the fit.",
    )
    with ui.row(align_items="center").classes("w-full"):
        change = lambda event: session.change(quietly=True, horizon=event.value or None)  # noqa: E731
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
            page.every_tick(_live(page, job, _drives(page, data["drives"])))
        return
    usability = answer["verdict"]
    verdict(usability.capitalize() + ".", " ".join(answer["reasons"]), bad=usability == "not usable")
    _drives(page, data["drives"])
    ui.html(data["parts"], sanitize=False).classes("w-full")


def _drives(page: Page, drives: list[FittedDrive]) -> list[tuple[FittedDrive, ui.echart]]:
    """Charts of what was fitted to and of what was held out, beside each other."""
    shown = []
    with ui.element("div").classes("two"):
        for drive in drives:
            with ui.column():
                title(drive.words)
                options = charts.strips(
                    drive.strips, drive.bench.over.span, height=130, legend=True, cursor=page.session["cursor"]
                )
                what = f"{drive.words}: measured, before the fit and fitted"
                element = charts.chart(options, charts.height_of(len(drive.strips), 130, True), what)
                shown.append((drive, element.mark(f"drive-{drive.words.partition(':')[0]}")))
    return shown


def _live(page: Page, job: PageJob, drives: list[tuple[FittedDrive, ui.echart]]) -> Callable[[], Awaitable[None]]:
    """What shows a fit that runs: its steps, and the simulation at each."""
    lines, last = ui.html("", sanitize=False).classes("w-full"), dict[str, float]()

    async def tick() -> None:
        lines.set_content(f"<pre class=card>{escape(chr(10).join(job.lines[-14:]))}</pre>")
        if (place := job.place) and place != last:
            last.clear()
            last.update(place)
            for drive, element in drives:
                traces = await page.off(drive.bench.simulate, place)
                await charts.with_curves(element, drive.bench.curves(traces, "fit"))

    return tick
