"""Step 7: take away; report, model for elsewhere, and the commands and the notebook that made all this.

What is taken away: the commands that made everything, a notebook that does the same, all of it in one file.
"""

from __future__ import annotations

import json
import zipfile
from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from .beneath import write_atomically
from .jobs import PageJob
from .session import MAP, Session
from .widgets import button, choose, heading, quiet, title

if TYPE_CHECKING:
    from .page import Page

COMMANDS, NOTEBOOK = "commands.sh", "notebook.ipynb"
ORDER = ("join", "check", "fit", "gap", "since", "design", "report", "export")
"""Kinds of jobs that are handed over, in the order in which they are run."""


def kept_jobs(session: Session) -> list[PageJob]:
    """The jobs that made what the session shows now: the last of a kind, the chosen fit and gap."""
    chosen = {session["fit"], session["gap"]}
    last: dict[str, PageJob] = {}
    for job in session.jobs.all():
        made = job.answer is not None and (job.kind not in ("fit", "gap", "since") or job.target in chosen)
        if made and job.kind in ORDER:
            last[f"export {job.target}" if job.kind == "export" else job.kind] = job
    return sorted(last.values(), key=lambda job: ORDER.index(job.kind))


def commands(session: Session) -> str:
    """A shell script, to be run where the recordings and the map lie as in the session."""
    lines = ["#!/bin/sh", f"# What greybox app did in the session {session.folder.name}; run in this folder."]
    if session["columns"] == MAP:
        lines.append(f"# {MAP} is the proposal of greybox data map with your answers to its questions.")
    return "\n".join([*lines, *(job.command for job in kept_jobs(session))]) + "\n"


def cells(session: Session) -> list[str]:
    """The same commands for a notebook, and what they made as the library's objects."""
    jobs = kept_jobs(session)
    fit = f'import greybox_id as gb\n\nfit = gb.load("{session["fit"]}/fit.json")\nprint(fit.summary())\nfit.params'
    return [*(f"!{job.command}" for job in jobs), *([fit] if any(job.kind == "fit" for job in jobs) else [])]


def notebook(session: Session) -> dict[str, Any]:
    """The same as a notebook of Jupyter's format 4."""
    words = f"# {session.folder.name}\n\nMade by greybox app. The column map and the recordings are in the same folder."
    made: list[dict[str, Any]] = [{"cell_type": "markdown", "metadata": {}, "source": words}]
    for source in cells(session):
        made.append({"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": source})
    about = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    numbered = [{**cell, "id": f"cell-{k}"} for k, cell in enumerate(made)]
    return {"cells": numbered, "metadata": about, "nbformat": 4, "nbformat_minor": 5}


def write(session: Session) -> None:
    """Write both into the session's folder."""
    write_atomically(session.folder / COMMANDS, commands(session))
    write_atomically(session.folder / NOTEBOOK, json.dumps(notebook(session), indent=1, ensure_ascii=False) + "\n")


def pack(session: Session) -> str:
    """Everything in one file: recordings, map, commands, notebook, results. Returns its name."""
    write(session)
    name = f"{session.folder.name}.zip"
    with zipfile.ZipFile(session.folder / f".{name}", "w", zipfile.ZIP_DEFLATED) as packed:
        for place in sorted(session.folder.rglob("*")):
            part = place.relative_to(session.folder)
            if place.is_file() and not part.name.startswith(".") and part.parts[0] not in ("jobs", name):
                packed.write(place, part)
    (session.folder / f".{name}").replace(session.folder / name)
    return name


REPORT = "report.html"
TARGETS = ("c", "casadi", "fmu", "acados", "simulink", "f1tenth", "ros2", "autoware")
OF_GAP = {"gap.pdf": "The diagnosis as PDF", "closed.toml": "The vehicle file with the applied effects"}


async def prepare(page: Page) -> dict[str, Any]:
    """Commands and notebook, written anew."""
    await page.off(write, page.session)
    return {"commands": commands(page.session), "cells": "\n".join(cells(page.session))}


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    session = page.session
    heading(
        "Take it away",
        ("Every step was a command. On another machine, these commands make the same fit from the same files."),
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
            quiet(f"Its files are in {session.folder}; the command line can read them.")


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
