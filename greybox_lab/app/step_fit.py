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
from .beneath import number, pretty_unit, unit_of, with_interval
from .model import Request, longest, nominal
from .takeaway import request_of
from .traces import Shown
from .widgets import button, choose, heading, quiet, share, shown, table, title, verdict

if TYPE_CHECKING:
    from .page import Page

HORIZONS = {0.0: "whole runs", 0.2: "0.2 s ahead", 0.5: "0.5 s ahead", 1.0: "1 s ahead", 2.0: "2 s ahead"}
PROTOCOLS = ("0.5 s ahead", "2 s ahead", "free run")


async def prepare(page: Page) -> dict[str, Any]:
    """The fit that is shown, over what it was fitted to and over what was held out."""
    session = page.session
    job, answer = page.work.result("fit")
    data: dict[str, Any] = {"job": job, "answer": answer, "drives": []}
    request = request_of(session, session["fit"])
    if answer is None or request is None:
        return data
    fit = await page.off(gb.load, session.folder / session["fit"] / "fit.json")
    for words, files in (("Fitted to", request.train), ("Held out", request.validate)):
        if files:
            over, strips = await page.off(_drive, page, files[0], fit, request)
            data["drives"].append((words, files[0].removeprefix("recordings/"), over, strips))
    return data


def _drive(page: Page, file: str, fit: gb.Fit, request: Request) -> tuple[Shown, list[charts.Strip]]:
    """A recording with the fit's free run, and with that of the model before it."""
    recording = longest(page.work.recording(file))
    over, runs = Shown(recording), {}
    with suppress(gb.GreyboxError):  # a model that runs away before it is fitted
        before = {"name": request.name, "vehicle": request.vehicle, "settings": request.settings, "effects": []}
        runs["before the fit"] = gb.simulate(nominal(before), recording)
    runs["fit"] = gb.simulate(fit, recording)
    strips = []
    for name in filter(recording.has, fit.model.outputs):
        curves = [charts.Curve("measured", over.points(np.asarray(recording[name])))]
        for words, run in runs.items():
            look = "simulated" if words == "fit" else "before"
            curves.append(charts.Curve(words, over.points(np.asarray(run[name])), look))
        strips.append(charts.Strip(name, recording.unit(name), curves))
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
    with ui.element("div").classes("two"):
        with ui.column():
            _parameters(answer)
        with ui.column():
            _errors(answer)
            _combinations(answer)
            for stage in answer["stages"][-1:]:
                quiet(f"{stage['status'].capitalize()} after {stage['steps']} steps.")


def _parameters(answer: dict[str, Any]) -> None:
    rows = []
    for name in answer.get("free", []):
        each = answer["parameters"].get(name)
        if each is None:
            continue
        sure = bool(each["interval"] and each["sd"])
        low, high = each["interval"] or (0.0, 0.0)
        value = with_interval(each["value"], low, high, each["sd"]) if sure else number(each["value"])
        prior = each["prior"] or {}
        prior_words = f"{number(prior['mean'])} ± {number(prior['sd'], 2)}" if prior.get("mean") is not None else ""
        rows.append((name, value, pretty_unit(each["unit"]), prior_words, answer["notes"].get(name) or each["about"]))
    title("Parameters")
    table(("parameter", "estimate, 95 % interval", "unit", "prior", "note"), rows)


def _errors(answer: dict[str, Any]) -> None:
    role = "validate" if "validate" in answer["comparison"] else "train"
    rows = [
        (
            f"{name}, {protocol}", shown(each["rmse"], unit_of(name)), share(each.get("fit_percent")),
            *(shown(each.get(key), unit_of(name)) for key in ("persistence", "unfitted")),
        )
        for protocol in PROTOCOLS
        for name, each in answer["comparison"][role].get(protocol, {}).items()
    ]  # fmt: skip
    title("Errors on what was held out" if role == "validate" else "Errors on what it was fitted to")
    table(("output", "RMSE", "fit", "persistence", "before the fit"), rows, right=(1, 2, 3, 4))


def _combinations(answer: dict[str, Any]) -> None:
    rows = [
        (each["name"], with_interval(each["value"], each["low"], each["high"], each["sd"]), pretty_unit(each["unit"]),
         each["about"])
        for each in answer.get("combinations", [])
        if each["sd"]
    ]  # fmt: skip
    if rows:
        title("What is known in combination")
        table(("combination", "estimate, 95 % interval", "unit", "what it is"), rows)
    for words in answer.get("together", []):
        quiet(words)
