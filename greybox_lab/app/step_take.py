"""Step 7: take away; report, model for elsewhere, and the commands and the notebook that made all this."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from .takeaway import COMMANDS, NOTEBOOK, cells, commands, pack, write
from .widgets import button, choose, heading, quiet, title

if TYPE_CHECKING:
    from .page import Page

REPORT = "report.html"
TARGETS = ("c", "casadi", "fmu", "acados", "simulink", "f1tenth", "ros2", "autoware")
OF_GAP = {"gap.pdf": "The diagnosis as PDF", "closed.toml": "The vehicle with the gap closed"}


async def prepare(page: Page) -> dict[str, Any]:
    """Commands and notebook, written anew."""
    await page.off(write, page.session)
    return {"commands": commands(page.session), "cells": "\n".join(cells(page.session))}


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    session = page.session
    heading(
        "Take it away", ("Every step was a command. Run elsewhere, the commands make the same fit from the same files.")
    )
    with ui.element("div").classes("two"):
        with ui.column():
            title("Commands")
            ui.code(data["commands"], language="bash").classes("w-full").mark("commands")
            title("Notebook")
            ui.code(data["cells"], language="text").classes("w-full").mark("notebook")
        with ui.column():
            title("Everything in one file")

            async def packed() -> None:
                ui.download.file(session.folder / await page.off(pack, session))

            button("Pack it", packed, "pack")
            with ui.row():
                for name in (COMMANDS, NOTEBOOK):
                    ui.link(name, f"/session/{name}", new_tab=True)
            title("Report")
            _report(page)
            if session["fit"]:
                title("Model for elsewhere")
                with ui.row(align_items="center"):
                    target = choose(TARGETS, "c", "target", 9)
                    words = ["export", f"{session['fit']}/fit.json", "--target"]

                    def export() -> None:
                        out = f"export_{target.value}"
                        session.start("export", [*words, target.value, "--out", out], out)

                    button("Export", export, "export", "outline")
            for job in session.jobs.all():
                if job.kind == "export" and not job.running:
                    quiet(job.failure or f"Written: {session.folder.name}/{job.target}")
            title("This session")
            quiet(f"It lies in {session.folder}; the command line reads it.")


def _report(page: Page) -> None:
    session = page.session
    if not session["fit"]:
        quiet("There is no fit yet.")
        return
    words = ["report", f"{session['fit']}/fit.json", "--out", REPORT]
    button("Write the report", partial(session.start, "report", words, REPORT), "report")
    job = session.latest("report")
    if job is not None and job.failure:
        quiet(job.failure)
    if job is not None and job.answer is not None:
        ui.link("Open the report", f"/session/{REPORT}?{job.pid}", new_tab=True).mark("open-report")
    for name, called in OF_GAP.items():
        if session["gap"] and (session.folder / session["gap"] / name).is_file():
            ui.link(called, f"/session/{session['gap']}/{name}", new_tab=True)
