"""Step 6: why not better; the budget as a waterfall, a cause alone under the cursor, what could not have been seen."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

import greybox_id as gb

from . import charts
from .beneath import number, pretty_unit
from .model import MOST_ROWS
from .table import table
from .takeaway import request_of
from .traces import Shown
from .why import UNNAMED, alone, cause_words, diagnosed_model, headline, steps, unseen

if TYPE_CHECKING:
    from .page import Page

ARENAS = ("disc:10", "disc:30", "disc:60", "straight:120x8")


async def prepare(page: Page) -> dict[str, Any]:
    """The diagnosis that is shown, and the trace where the gap is largest."""
    job, answer = page.work.gap_result()
    data: dict[str, Any] = {"job": job, "answer": answer, "base": None}
    if answer is not None and job is not None:
        request = request_of(page.session, page.session["gap"])
        files = request.train if request is not None else page.session.files("train")
        data |= await page.off(_traces, page, job, answer, files[0])
    return data


def _traces(page: Page, job: Any, gap: dict[str, Any], file: str) -> dict[str, Any]:
    """What is diagnosed, and its free run on the run where the gap is."""
    base = diagnosed_model(page.session.folder, job.words)
    recording = page.work.recording(file)
    start, stop = max(recording.runs, key=lambda run: run[1] - run[0])
    recording = recording.rows(start, min(stop, start + MOST_ROWS))
    channel = gap["where"]["channel"]
    channel = (
        channel
        if channel in base.outputs and recording.has(channel)
        else next((name for name in base.outputs if recording.has(name)), "")
    )
    shown = Shown(recording)
    trace = np.asarray(gb.simulate(base, recording)[channel])
    return {"base": base, "recording": recording, "shown": shown, "channel": channel, "trace": trace}


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    from .page import guarded, heading, verdict

    session, work = page.session, page.work
    heading("Why not better?", "The gap between simulation and recording is shared out among its causes.")
    before = session.files("before")
    with ui.row(align_items="center").classes("w-full"):
        again = bool(session["gap"])
        if session["fit"]:
            ui.button("Diagnose the fit", on_click=guarded(page, partial(work.gap, True))).props(
                "no-caps outline" if again else "no-caps"
            ).mark("diagnose-fit")
        if session["model"]["vehicle"]:
            words = f"Diagnose {session['model']['vehicle']} as it is stated"
            ui.button(words, on_click=guarded(page, partial(work.gap, False))).props("no-caps outline").mark(
                "diagnose-vehicle"
            )
        since = (
            ui.button("What changed since BEFORE?", on_click=guarded(page, partial(work.gap, False, True)))
            .props("no-caps outline")
            .mark("since")
        )
        since.set_enabled(bool(before) and bool(session["model"]["vehicle"]))
        since.tooltip(
            "Drives of before and after are compared."
            if before
            else "Give recordings of before the role BEFORE in step 1."
        )
        if data["answer"] is not None:

            async def onward() -> None:
                await page.go(6)

            ui.button("Take it away", on_click=onward).props("no-caps").mark("onward")
    _before_after(page)
    job, gap = data["job"], data["answer"]
    if gap is None:
        if job is not None and job.failure:
            verdict("There is no diagnosis.", job.failure, bad=True)
        elif job is not None:
            ui.label("Each of 44 effects is tried on what the simulation leaves. This takes a minute.").classes(
                "sentence"
            )
        return
    verdict(headline(gap), " ".join([*gap["doubts"], gap["unknown"]]).strip())
    if gap.get("changed") is not None:
        _changed(gap)
    with ui.element("div").classes("two"):
        with ui.column():
            budget = steps(gap)
            picture = _waterfall(budget)
        with ui.column():
            element, alone_words = _overlay(data)
    show = _shower(page, data, element, alone_words)
    if picture is not None:
        names = ["", *(step.name for step in budget)]

        async def hovered(event: Any) -> None:
            await show(names[int(event.args["dataIndex"])])

        picture.on("chart:mouseover", hovered, ["dataIndex"])
        picture.on("chart:click", hovered, ["dataIndex"])
    with ui.element("div").classes("two"):
        with ui.column():
            _causes(gap, show)
        with ui.column():
            _unseen(gap)
            _next(page)


def _before_after(page: Page) -> None:
    """Roles of recordings in two columns, where some are of before."""
    session = page.session
    used = [each for each in session["recordings"] if each["role"] != "unused"]
    if len(used) < 2:
        return
    with ui.row(align_items="center").classes("w-full"):
        for words, role in (("BEFORE", ("before",)), ("AFTER", ("train",)), ("held out", ("validate",))):
            files = [each["file"].removeprefix("recordings/") for each in used if each["role"] in role]
            ui.label(f"{words}: {', '.join(files) or '–'}").classes("quiet")


def _waterfall(budget: list[Any]) -> ui.echart | None:
    if not budget:
        ui.label("No cause was found whose share could be measured.").classes("sentence")
        return None
    height = 70 + 44 * (len(budget) + 1)
    words = ", ".join(f"{step.name} {100 * step.share:.0f} %" for step in budget)
    picture = charts.chart(charts.waterfall(budget), height, f"the gap shared out: {words}").mark("waterfall")
    ui.label(
        "Filled: in the closed model. Striped: nearest names that are not sure enough. Grey: what nothing explains. Lines: 95 % intervals."
    ).classes("quiet")
    return picture


def _overlay(data: dict[str, Any]) -> tuple[ui.echart, ui.label]:
    shown, channel, recording = data["shown"], data["channel"], data["recording"]
    curves = [
        charts.Curve("measured", shown.points(np.asarray(recording[channel])), "measured"),
        charts.Curve("simulation", shown.points(data["trace"]), "before"),
        charts.Curve("with this cause alone", [], "cause"),
    ]
    options = charts.strips(
        [charts.Strip(channel, recording.unit(channel), curves)], shown.span, height=250, legend=True
    )
    element = charts.chart(
        options, charts.height_of(1, 250, True), f"{channel}: measured, simulated, and with one cause alone"
    ).mark("overlay")
    return element, ui.label("Point at a cause to see it alone.").classes("sentence").mark("alone")


def _shower(page: Page, data: dict[str, Any], element: ui.echart, words: ui.label) -> Any:
    gap, kept = data["answer"], {}

    def simulate(name: str) -> np.ndarray[Any, Any]:
        model = alone(data["base"], gap["ranking"], [name])
        return np.asarray(gb.simulate(model, data["recording"])[data["channel"]])

    async def show(name: str) -> None:
        shown, channel = data["shown"], data["channel"]
        measured = np.asarray(data["recording"][channel])
        if name not in {each["effect"] for each in gap["ranking"]}:
            charts.with_curves(element, {f"{channel}/with this cause alone": []})
            words.set_text(
                "This is what no known effect explains." if name == UNNAMED else "Point at a cause to see it alone."
            )
            return
        if name not in kept:
            try:
                kept[name] = await page.off(simulate, name)
            except gb.GreyboxError as error:
                words.set_text(f"{name} cannot be simulated alone: {error}")
                return
        charts.with_curves(element, {f"{channel}/with this cause alone": shown.points(kept[name])})
        errors = [float(np.sqrt(np.nanmean((trace - measured) ** 2))) for trace in (data["trace"], kept[name])]
        unit = pretty_unit(data["recording"].unit(channel))
        words.set_text(
            f"{name} alone: {channel} is off by {number(errors[1])} {unit} in free run, {number(errors[0])} without it."
        )

    return show


def _causes(gap: dict[str, Any], show: Any) -> None:
    from .page import title

    title("Causes")
    if not gap["ranking"]:
        ui.label("None.")
    for each in gap["ranking"][:8]:
        name = each["effect"]
        applied = " · in the closed model" if name in gap["applied"] else ""
        with ui.column().classes("w-full").style("gap: 0"):
            button = (
                ui.button(f"{name}: {cause_words(each)}{applied}", on_click=partial(show, name))
                .props("flat dense no-caps align=left")
                .classes("cause")
                .mark(f"cause-{name}")
            )
            button.on("mouseenter", partial(_entered, show, name), [])
            button.on("focus", partial(_entered, show, name), [])
            if each["reason"]:
                ui.label(each["reason"]).classes("quiet").style("padding-left: .4rem")
            if each["indistinguishable_from"]:
                ui.label(f"cannot be told from {', '.join(each['indistinguishable_from'])} here").classes(
                    "quiet"
                ).style("padding-left: .4rem")


async def _entered(show: Any, name: str, event: Any) -> None:
    del event
    await show(name)


def _changed(gap: dict[str, Any]) -> None:
    from .page import title

    title(f"Changed since {', '.join(gap['since'])}")
    if not gap["changed"]:
        ui.label("Nothing beyond what the drives of before scatter by.")
        return
    rows = [
        (
            each["effect"],
            number(each["before"]) if each["before"] is not None else "",
            f"{number(each['magnitude'])} [{number(each['interval'][0])}, {number(each['interval'][1])}]",
            pretty_unit(each["unit"]),
            f"{each['probability']:.2f}",
        )
        for each in gap["changed"]
    ]
    table(("effect", "before", "after, 95 % interval", "unit", "probability"), rows, right=(4,))


def _unseen(gap: dict[str, Any]) -> None:
    from .page import title

    rows = unseen(gap)
    if rows:
        title("What could not have been seen")
        with ui.element("div").classes("w-full").style("color: var(--quiet); max-height: 18rem; overflow-y: auto"):
            table(("effect", "why"), rows)
    for words in gap["advice"]:
        ui.label(words).classes("quiet")


def _next(page: Page) -> None:
    from .page import guarded, title

    session = page.session
    title("Drive this next")
    with ui.row(align_items="center"):
        arena = (
            ui.select(list(ARENAS), value=session.state.get("arena", ARENAS[0]), label="arena [m]")
            .props("dense outlined")
            .style("width: 11rem")
        )

        def design() -> None:
            session.keep_quietly(arena=arena.value)
            page.work.design(arena.value)

        ui.button("Compute the manoeuvre that tells most", on_click=guarded(page, design)).props(
            "no-caps outline"
        ).mark("design")
    job = session.latest("design", session["gap"])
    if job is None or job.running:
        return
    if job.failure:
        ui.label(job.failure).classes("quiet")
        return
    answer = job.answer or {}
    for words in (answer.get("sentence"), *answer.get("said", []), *answer.get("impossible", [])):
        if words:
            ui.label(words)
    plan = f"{session['gap']}/next/plan.svg"
    if (session.folder / plan).is_file():
        ui.element("img").classes("plan").props(
            f'src="/session/{plan}?{job.pid}" alt="the manoeuvre in its arena, with its commands"'
        )
