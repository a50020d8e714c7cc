"""Step 5: the fit; its verdict first, the held-out drive beside, then parameters with intervals."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

import greybox_id as gb

from . import charts
from .beneath import number, percent, pretty_unit, unit_of, with_interval
from .model import MOST_ROWS
from .table import table
from .takeaway import request_of
from .traces import Shown

if TYPE_CHECKING:
    from .page import Page


async def prepare(page: Page) -> dict[str, Any]:
    """The fit that is shown, over what it was fitted to and over what was held out."""
    job, answer = page.work.fit_result()
    data: dict[str, Any] = {"job": job, "answer": answer, "drives": []}
    if answer is None:
        return data
    folder = page.session.folder
    result = await page.off(gb.load, folder / page.session["fit"] / "fit.json")
    request = request_of(page.session, page.session["fit"])
    for role, words in (("train", "fitted to"), ("validate", "held out")):
        files = getattr(request, role) if request is not None else page.session.files(role)
        if files:
            data["drives"].append((words, *await page.off(_drive, page, files[0], result, request)))
    return data


def _drive(page: Page, file: str, result: gb.Fit, request: Any) -> tuple[str, Shown, list[charts.Strip]]:
    """A recording with the fit's free run, and with that of the model before it."""
    from .model import nominal

    recording = page.work.recording(file)
    start, stop = max(recording.runs, key=lambda run: run[1] - run[0])
    recording = recording.rows(start, min(stop, start + MOST_ROWS))
    shown = Shown(recording)
    runs = {"fit": gb.simulate(result, recording)}
    try:
        chosen = {"name": request.name, "vehicle": request.vehicle, "settings": request.settings, "effects": []}
        runs["before the fit"] = gb.simulate(nominal(chosen), recording)
    except (gb.GreyboxError, AttributeError):
        pass
    strips = []
    for name in result.model.outputs:
        if not recording.has(name):
            continue
        curves = [charts.Curve("measured", shown.points(np.asarray(recording[name])), "measured")]
        for words, look in (("before the fit", "before"), ("fit", "simulated")):
            if words in runs:
                curves.append(charts.Curve(words, shown.points(np.asarray(runs[words][name])), look))
        strips.append(charts.Strip(name, recording.unit(name), curves))
    return file.removeprefix("recordings/"), shown, strips


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    from .page import guarded, heading, verdict

    session = page.session
    heading("Fit", "Parameters are moved until the simulation follows what was recorded; what was held out judges it.")
    with ui.row(align_items="center").classes("w-full"):
        horizons = {0.0: "whole runs", 0.2: "0.2 s ahead", 0.5: "0.5 s ahead", 1.0: "1 s ahead", 2.0: "2 s ahead"}
        ui.select(horizons, value=session["horizon"] or 0.0, label="horizon", on_change=partial(_horizon, page)).props(
            "dense outlined"
        ).style("width: 10rem")
        again = "Fit again" if session["fit"] else "Fit"
        ui.button(again, on_click=guarded(page, page.work.fit)).props(
            "no-caps outline" if session["fit"] else "no-caps"
        ).mark("fit")
        targets = [
            folder.parent.name
            for folder in sorted(
                session.folder.glob("fits/*/fit.json"),
                key=lambda path: int(path.parent.name) if path.parent.name.isdecimal() else 0,
            )
        ]
        if len(targets) > 1:
            names = {f"fits/{name}": f"fit {name}" for name in targets} | (
                {session["fit"]: session["fit"].replace("fits/", "fit ")} if session["fit"] else {}
            )
            ui.select(
                names, value=session["fit"], label="shown", on_change=lambda event: session.change(fit=event.value)
            ).props("dense outlined").style("width: 8rem")
        if data["answer"] is not None:

            async def onward() -> None:
                await page.go(5)

            ui.button("Why not better?", on_click=onward).props("no-caps").mark("why")
    job, answer = data["job"], data["answer"]
    if answer is None:
        if job is not None and job.failure:
            verdict("There is no fit.", job.failure, bad=True)
        elif job is not None:
            lines = ui.html("", sanitize=True).classes("w-full")

            def tick() -> None:
                lines.set_content("<pre class=card>" + "\n".join(_escape(line) for line in job.lines[-14:]) + "</pre>")

            tick()
            page.every_tick(tick)
        return
    stage = answer["stages"][-1] if answer["stages"] else None
    doubt = " ".join(answer["reasons"])
    verdict(_capital(answer["verdict"]) + ".", doubt, bad=answer["verdict"] == "not usable")
    with ui.element("div").classes("two"):
        for words, file, shown, strips in data["drives"]:
            with ui.column():
                ui.label(f"{_capital(words)}: {file}").style("font-weight: bold")
                options = charts.strips(strips, shown.span, height=130, legend=True)
                charts.chart(
                    options, charts.height_of(len(strips), 130, True), f"{words}: measured, before the fit and fitted"
                ).mark(f"drive-{words.replace(' ', '-')}")
    with ui.element("div").classes("two"):
        with ui.column():
            _parameters(answer)
        with ui.column():
            _errors(answer)
            _combinations(answer)
            if stage is not None and len(stage["history"]) > 2:
                ui.label(f"{_capital(stage['status'])} after {stage['steps']} steps").style("font-weight: bold")
                charts.chart(charts.objective(stage["history"]), 190, "the objective step by step")


def _parameters(answer: dict[str, Any]) -> None:
    rows = []
    for name in answer.get("free", []):
        each = answer["parameters"].get(name)
        if each is None:
            continue
        low, high = each["interval"] or (float("nan"), float("nan"))
        value = (
            with_interval(each["value"], low, high, each["sd"])
            if each["interval"] and each["sd"]
            else number(each["value"])
        )
        prior = each["prior"]
        believed = (
            f"{number(prior['mean'])} ± {number(prior['sd'], 2)}" if prior and prior.get("mean") is not None else ""
        )
        rows.append((name, value, pretty_unit(each["unit"]), believed, answer["notes"].get(name) or each["about"]))
    table(("parameter", "estimate, 95 % interval", "unit", "prior", "note"), rows)


def _errors(answer: dict[str, Any]) -> None:
    role = "validate" if "validate" in answer["comparison"] else "train"
    rows = []
    for protocol, outputs in answer["comparison"][role].items():
        if protocol not in ("0.5 s ahead", "2 s ahead", "free run"):
            continue
        for name, each in outputs.items():
            rows.append(
                (
                    f"{name} [{pretty_unit(unit_of(name))}], {protocol}",
                    _number(each["rmse"]),
                    _share(each.get("fit_percent")),
                    _number(each.get("persistence")),
                    _number(each.get("unfitted")),
                )
            )
    ui.label("Errors on what was held out" if role == "validate" else "Errors on what it was fitted to").style(
        "font-weight: bold"
    )
    table(("output", "RMSE", "fit", "last reading held", "before the fit"), rows, right=(1, 2, 3, 4))


def _combinations(answer: dict[str, Any]) -> None:
    rows = [
        (
            each["name"],
            with_interval(each["value"], each["low"], each["high"], each["sd"]),
            pretty_unit(each["unit"]),
            each["about"],
        )
        for each in answer.get("combinations", [])
        if each["sd"]
    ]
    if rows:
        ui.label("What is known in combination").style("font-weight: bold")
        table(("combination", "estimate, 95 % interval", "unit", "what it is"), rows)
    for words in answer.get("together", []):
        ui.label(words).classes("quiet")


def _number(value: float | None) -> str:
    return "" if value is None else number(value)


def _share(value: float | None) -> str:
    return "" if value is None else percent(value / 100)


def _horizon(page: Page, event: Any) -> None:
    page.session.keep_quietly(horizon=event.value or None)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _escape(line: str) -> str:
    return line.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
