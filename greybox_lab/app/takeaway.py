"""What is taken away: the commands that made everything, a notebook that does the same, all of it in one file."""

from __future__ import annotations

import json
import zipfile
from dataclasses import fields
from typing import Any

from .beneath import write_atomically
from .jobs import Job
from .model import Request
from .session import LARGEST, MAP, Session

COMMANDS, NOTEBOOK = "commands.sh", "notebook.ipynb"


def request_of(session: Session, target: str) -> Request | None:
    """The request that a fit or a gap was made of."""
    body = session["requests"].get(target)
    return (
        None
        if body is None
        else Request(**{each.name: body[each.name] for each in fields(Request) if each.name in body})
    )


ORDER = ("join", "check", "fit", "gap", "since", "design", "report", "export")
"""Kinds of jobs that are handed over, in the order in which they are run."""


def kept_jobs(session: Session) -> list[Job]:
    """The jobs that made what the session shows now: the last of a kind, the chosen fit and gap."""
    chosen = {session["fit"], session["gap"]}
    last: dict[str, Job] = {}
    for job in session.jobs.all():
        made = job.answer is not None and (job.kind not in ("fit", "gap", "since") or job.target in chosen)
        if made and job.kind in ORDER:
            last[f"export {job.target}" if job.kind == "export" else job.kind] = job
    return sorted(last.values(), key=lambda job: ORDER.index(job.kind))


def commands(session: Session) -> str:
    """A shell script, to be run where the recordings and the map lie as in the session."""
    lines = ["#!/bin/sh", f"# What greybox app did in the session {session.folder.name}; run in this folder."]
    if session["columns"] == MAP:
        lines.append(f"# {MAP} began as what greybox data map proposed; the answers to its questions are in it.")
    return "\n".join([*lines, *(job.command for job in kept_jobs(session))]) + "\n"


def code(session: Session) -> list[str]:
    """Python that does the same, in cells."""
    fit, gap = request_of(session, session["fit"]), request_of(session, session["gap"])
    first = fit or gap
    if first is None:
        return []
    cells = [first.read_code(), "for recording in train:\n    print(gb.check(recording))"]
    if fit is not None:
        cells.append(fit.fit_code())
    if gap is not None:
        words = next((job.words for job in session.jobs.all() if job.target == session["gap"]), ())
        cells.append(gap.gap_code("--fit" in words, "--since" in words))
    results = [name for name, request in (("fit", fit), ("gap", gap)) if request is not None]
    return [*cells, f'gb.report([{", ".join(results)}], "report.html")']


def notebook(session: Session) -> dict[str, Any]:
    """The same as a notebook of Jupyter's format 4."""
    words = f"# {session.folder.name}\n\nMade by greybox app. The column map and the recordings lie beside this file."
    cells: list[dict[str, Any]] = [{"cell_type": "markdown", "metadata": {}, "source": words}]
    for source in code(session):
        cells.append({"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": source})
    return {
        "cells": [{**cell, "id": f"cell-{k}"} for k, cell in enumerate(cells)],
        "metadata": {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }


def write(session: Session) -> None:
    """Write both into the session's folder."""
    write_atomically(session.folder / COMMANDS, commands(session))
    write_atomically(session.folder / NOTEBOOK, json.dumps(notebook(session), indent=1, ensure_ascii=False) + "\n")


def pack(session: Session) -> str:
    """Everything in one file: recordings, map, commands, notebook, results. Returns its name."""
    write(session)
    name = f"{session.folder.name}.zip"
    beside = session.folder / f".{name}"
    chosen = [COMMANDS, NOTEBOOK, *([MAP] if MAP in commands(session) else []), *session.files()]
    for job in kept_jobs(session):
        chosen += [word for word in job.words if word.startswith("recordings/")]
        place = session.folder / job.target
        if job.kind != "check":
            inside = [place] if place.is_file() else sorted(place.rglob("*"))
            chosen += [str(each.relative_to(session.folder)) for each in inside if each.is_file()]
    with zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as packed:
        total = 0
        for file in dict.fromkeys(chosen):
            place = session.folder / file
            total += place.stat().st_size if place.is_file() else 0
            if place.is_file() and total <= LARGEST:
                packed.write(place, file)
    beside.replace(session.folder / name)
    return name
