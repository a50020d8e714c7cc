"""What is taken away: the commands that made everything, a notebook that does the same, all of it in one file."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from .beneath import write_atomically
from .jobs import Job
from .model import Request
from .session import LARGEST, MAP, Session

COMMANDS, NOTEBOOK = "commands.sh", "notebook.ipynb"


def request_of(session: Session, target: str) -> Request | None:
    """The request that a fit or a gap was made of."""
    body = session.state.get("requests", {}).get(target)
    return (
        None
        if body is None
        else Request(**{each.name: body[each.name] for each in fields(Request) if each.name in body})
    )


def kept_jobs(session: Session) -> list[Job]:
    """The jobs that made what the session shows now: the last check, the chosen fit and gap, what was written."""
    chosen = {session["fit"], session["gap"]} - {""}
    last: dict[tuple[str, str], Job] = {}
    for job in session.jobs.all():
        if job.answer is not None and (
            job.kind in ("join", "check") or job.target in chosen or job.kind in ("report", "export", "design")
        ):
            last.pop((job.kind, job.target), None)
            last[job.kind, job.target] = job
    order = ("join", "check", "fit", "gap", "since", "design", "report", "export")
    return sorted(last.values(), key=lambda job: order.index(job.kind) if job.kind in order else len(order))


def commands(session: Session) -> str:
    """A shell script, to be run where the recordings and the map lie as in the session."""
    lines = ["#!/bin/sh", f"# What greybox app did in the session {session.folder.name}; run in this folder."]
    if session["columns"] == MAP:
        lines.append(f"# {MAP} began as what greybox data map proposed; the answers to its questions are in it.")
    return "\n".join([*lines, *(job.command for job in kept_jobs(session))]) + "\n"


def notebook(session: Session) -> dict[str, Any]:
    """The same as a notebook of Jupyter's format 4."""
    fit, gap = request_of(session, session["fit"]), request_of(session, session["gap"])
    first = fit or gap
    cells = [
        _words(
            f"# {session.folder.name}\n\nMade by greybox app. The column map and the recordings lie beside this file."
        )
    ]
    if first is not None:
        cells += [_words("## Recordings"), _code(first.read_code())]
        cells.append(
            _code(
                "for recording in train:\n    for finding in gb.check(recording):\n        print(finding.severity.value, finding.sentence)"
            )
        )
    if fit is not None:
        cells += [_words("## Fit"), _code(fit.fit_code())]
    if gap is not None:
        job = next((each for each in session.jobs.all() if each.target == session["gap"]), None)
        words = job.words if job is not None else ()
        cells += [_words("## Why not"), _code(gap.gap_code("--fit" in words, "--since" in words))]
    results = [name for name, request in (("fit", fit), ("gap", gap)) if request is not None]
    if results:
        cells += [_words("## Report"), _code(f'gb.report([{", ".join(results)}], "report.html")')]
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
    """Everything in one file: recordings, map, commands, notebook, results. Returns its name in the session's folder."""
    write(session)
    name = f"{session.folder.name}.zip"
    beside = session.folder / f".{name}"
    chosen = [COMMANDS, NOTEBOOK, *([MAP] if session["columns"] == MAP else []), *session.files()]
    for folder in filter(None, (session["fit"], session["gap"], "report.html", "report.pdf")):
        place = session.folder / folder
        chosen += [
            str(file.relative_to(session.folder))
            for file in ([place] if place.is_file() else place.rglob("*"))
            if file.is_file()
        ]
    chosen += [
        file for job in kept_jobs(session) if job.kind == "join" for file in job.words if file.startswith("recordings/")
    ]
    with zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as packed:
        total = 0
        for file in dict.fromkeys(chosen):
            place = session.folder / file
            total += place.stat().st_size if place.is_file() else 0
            if place.is_file() and total <= LARGEST:
                packed.write(place, file)
    beside.replace(session.folder / name)
    return name


def _words(text: str) -> dict[str, Any]:
    return {"cell_type": "markdown", "metadata": {}, "source": _lines(text)}


def _code(text: str) -> dict[str, Any]:
    return {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": _lines(text)}


def _lines(text: str) -> Sequence[str]:
    return text.splitlines(keepends=True)
