"""Step 6: why not better; the budget as a waterfall, a cause alone under the cursor, what could not have been seen."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

import greybox_id as gb

from . import charts
from .beneath import cause_words, change_parts, gap_parts, quantity, read_gap, sentence
from .charts import Step
from .model import alone, diagnosed_model, longest, steps
from .traces import Shown
from .widgets import button, choose, heading, quiet, title, verdict

if TYPE_CHECKING:
    from greybox_id.gap.gap import Gap

    from .page import Page

ARENAS = ("disc:10", "disc:30", "disc:60", "straight:120x8")
ALONE, POINT = "with this cause alone", "Point at a cause to see it alone."
MOST_CAUSES = 8
NOTHING = np.empty((0, 2))
Show = Callable[[str], Awaitable[None]]


async def prepare(page: Page) -> dict[str, Any]:
    """The diagnosis that is shown, and the trace where the gap is largest."""
    job, answer = page.work.result("gap")
    data: dict[str, Any] = {"job": job, "answer": answer}
    if answer is not None and job is not None:
        data |= await page.off(_traces, page, job.words, job.words[1])
    return data


def _traces(page: Page, words: tuple[str, ...], file: str) -> dict[str, Any]:
    """What is diagnosed, and its free run on the longest run."""
    folder = page.session.folder
    base, gap = diagnosed_model(folder, words), read_gap(folder / page.session["gap"] / "gap.json")
    recording = longest(page.work.recording(file))
    outputs = list(filter(recording.has, base.outputs))
    channel = gap.where.channel if gap.where.channel in outputs else outputs[0]
    trace = np.asarray(gb.simulate(base, recording)[channel])
    drawn = {"recording": recording, "over": Shown(recording), "channel": channel, "trace": trace}
    return {"gap": gap, "said": gap_parts(gap), "base": base, **drawn}


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    heading("Why not better?", "The gap between simulation and recording is attributed to its causes.")
    _diagnose(page, data["answer"] is not None)
    job, answer = data["job"], data["answer"]
    if answer is None:
        if job is not None and job.failure:
            verdict("There is no diagnosis.", job.failure, bad=True)
        elif job is not None:
            ui.label("Each effect is fitted to the error of the simulation. This takes a minute.").classes("sentence")
        return
    gap, (first, silent) = data["gap"], data["said"]
    ui.html(first, sanitize=False).classes("w-full").mark("verdict")
    if answer.get("changed") is not None:
        ui.html(change_parts(gap, answer), sanitize=False).classes("w-full").mark("changed")
    budget = steps(gap)
    with ui.element("div").classes("two"):
        left = ui.column()
        with ui.column():
            element, words = _overlay(page, data)
            _next(page)
    show = _shower(page, data, element, words)
    with left:
        picture = _waterfall(budget)
        _causes(gap, show)
    names = ["", *(step.name for step in budget)]
    if picture is not None:

        async def hovered(event: Any) -> None:
            await show(names[int(event.args["dataIndex"])])

        for event in ("chart:mouseover", "chart:click"):
            picture.on(event, hovered, ["dataIndex"])
    if silent:
        ui.html(silent, sanitize=False).classes("unseen").mark("unseen")


def _diagnose(page: Page, done: bool) -> None:
    session, work = page.session, page.work
    vehicle, before = session["model"]["vehicle"], session.files("before")
    with ui.row(align_items="center").classes("w-full"):
        if session["fit"]:
            button("Diagnose the fit", partial(work.gap, True), "diagnose-fit", "outline" if done else "")
        if vehicle:
            button(f"Diagnose {vehicle} as it is stated", partial(work.gap, False), "diagnose-vehicle", "outline")
            since = button("What changed since BEFORE?", partial(work.gap, False, True), "since", "outline")
            since.set_enabled(bool(before))
            if not before:
                since.tooltip("Give a drive the role 'before' in step 1.")
        if done:
            button("Take it away", partial(page.go, 6), "onward")
    if before:
        roles = (("BEFORE", before), ("AFTER", session.files("train")), ("held out", session.files("validate")))
        names = [(words, ", ".join(file.removeprefix("recordings/") for file in files)) for words, files in roles]
        quiet(" · ".join(f"{words}: {listed}" for words, listed in names if listed))


def _waterfall(budget: list[Step]) -> ui.echart | None:
    if not budget:
        ui.label("No cause was found whose share could be measured.").classes("sentence")
        return None
    words = ", ".join(f"{step.name} {100 * step.share:.0f} %" for step in budget)
    height = 70 + 44 * (len(budget) + 1)
    picture = charts.chart(charts.waterfall(budget), height, f"shares of the gap by cause: {words}").mark("waterfall")
    quiet(
        "Filled bars: effects in the closed model. Striped bars: likely causes, too uncertain to apply. Grey: "
        "unexplained. Lines: "
        "95 % intervals."
    )
    return picture


def _overlay(page: Page, data: dict[str, Any]) -> tuple[ui.echart, ui.label]:
    over, channel, recording = data["over"], data["channel"], data["recording"]
    curves = [
        charts.PlottedTrace("measured", over.points(np.asarray(recording[channel]))),
        charts.PlottedTrace("simulation", over.points(data["trace"]), "before"),
        charts.PlottedTrace(ALONE, NOTHING, "cause"),
    ]
    strip = charts.StripChart(channel, recording.unit(channel), curves)
    options = charts.strips([strip], over.span, height=250, legend=True, cursor=page.session["cursor"])
    words = f"{channel}: measured, simulated, and with one cause alone"
    element = charts.chart(options, charts.height_of(1, 250, True), words).mark("overlay")
    return element, ui.label(POINT).classes("sentence").mark("alone")


def _shower(page: Page, data: dict[str, Any], element: ui.echart, words: ui.label) -> Show:
    """What shows one cause alone over the trace."""
    ranking, over, channel, recording = data["gap"].ranking, data["over"], data["channel"], data["recording"]
    known, measured = {each.effect for each in ranking}, np.asarray(recording[channel])
    kept: dict[str, Any] = {}

    def simulated(name: str) -> Any:
        return np.asarray(gb.simulate(alone(data["base"], ranking, name), recording)[channel])

    async def show(name: str) -> None:
        if name not in known:
            await charts.with_curves(element, {f"{channel}/{ALONE}": NOTHING})
            words.set_text("This is the share that no known effect explains." if name == charts.UNNAMED else POINT)
            return
        try:
            if name not in kept:
                kept[name] = await page.off(simulated, name)
        except gb.GreyboxError as error:
            words.set_text(f"{name} cannot be simulated alone: {sentence(error)}")
            return
        await charts.with_curves(element, {f"{channel}/{ALONE}": over.points(kept[name])})
        without, beside = (
            quantity(float(np.sqrt(np.nanmean((trace - measured) ** 2))), recording.unit(channel))
            for trace in (data["trace"], kept[name])
        )
        words.set_text(f"{name} alone: {channel} is off by {beside} in free run, {without} without it.")

    return show


def _causes(gap: Gap, show: Show) -> None:
    title("Causes")
    if not gap.ranking:
        quiet("None.")
    for each in gap.ranking[:MOST_CAUSES]:
        act = partial(show, each.effect)
        applied = " · in the closed model" if each.effect in gap.applied else ""
        words = f"{each.effect}: {cause_words(each)}{applied}"
        line = button(words, act, f"cause-{each.effect}", "flat").classes("cause")
        for event in ("mouseenter", "focus"):
            line.on(event, act, [])
        if each.reason:
            quiet(each.reason).classes("under")
        if each.indistinguishable_from:
            quiet(f"cannot be distinguished from {', '.join(each.indistinguishable_from)} here").classes("under")


def _next(page: Page) -> None:
    session = page.session
    title("Drive this next")
    with ui.row(align_items="center"):
        arena = choose(
            ARENAS, session["arena"], "arena [m]", 11, lambda event: session.change(quietly=True, arena=event.value)
        )
        words = ["design", f"{session['gap']}/gap.json", "--out", f"{session['gap']}/next", "--arena"]
        act = lambda: session.start("design", [*words, arena.value], session["gap"])  # noqa: E731
        button("Design the most informative manoeuvre", act, "design", "outline")
    job = session.latest("design", session["gap"])
    if job is None or job.running:
        return
    answer = job.answer or {}
    for words in (job.failure, answer.get("sentence"), *answer.get("said", []), *answer.get("impossible", [])):
        if words:
            ui.label(words)
    plan = f"{session['gap']}/next/plan.svg"
    if job.answer and (session.folder / plan).is_file():
        picture = ui.element("img").classes("plan").mark("plan")
        picture.props(f'src="/session/{plan}?{job.pid}" alt="the manoeuvre in its arena, with its commands"')
