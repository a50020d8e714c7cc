"""Step 1: drop files; what each column may be, and questions where that is not sure."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import events, ui

import greybox_id as gb

from . import charts
from .beneath import SIGNALS, companion, counted, pretty_unit, sentence
from .mapping import TIME_UNITS, USUAL_UNITS, Entry, column_of, questions, units_for, write_map
from .session import LARGEST, MAP, ROLES, must_be_small, safe_name
from .traces import Shown, read
from .widgets import button, choose, heading, quiet, tell, title, verdict

if TYPE_CHECKING:
    from .page import Page

LITTLE = 92
"""Height of the plot that decides a question, pixels."""
LOOKS = ("simulated", "other", "third")
MOST_ROWS = 200_000
"""Rows of the plot that decides a question."""


async def prepare(page: Page) -> dict[str, Any]:
    """Open questions, with the little plot of each."""
    session = page.session
    entries = questions(session["entries"]) if session["columns"] == MAP else []
    if not entries or not {"time", "rate"} & session["map"].keys():
        return {"open": entries, "strips": {}}
    return {"open": entries, "strips": await page.off(_strips, page, entries)}


def _strips(page: Page, entries: list[Entry]) -> dict[int, charts.StripChart]:
    """Each column in the units that come into question, and what the other channels say it should be."""
    session, strips = page.session, dict[int, charts.StripChart]()
    for file in session["joining"] or session.files()[:1]:
        prefix = f"{Path(file).name.split('.')[0]}/" if session["joining"] else ""
        here = {k: entry for k, entry in enumerate(entries) if entry["column"].startswith(prefix)}
        extra = {
            f"q{k}_{j}": {**column_of(entry, unit), "column": entry["column"].removeprefix(prefix), "optional": True}
            for k, entry in here.items()
            for j, unit in enumerate(units_for(entry)[: len(LOOKS)])
        }
        known = [] if prefix else session["entries"]
        place = session.folder / "jobs" / f"candidates_{Path(file).name}.toml"
        write_map(place, session["map"], known, extra)
        try:
            recording = read(session.folder / file, place)
        except gb.GreyboxError:
            continue
        over = Shown(recording.rows(0, min(len(recording), MOST_ROWS)))
        strips |= {k: _strip(over, entry, k) for k, entry in here.items()}
    return strips


def _strip(over: Shown, entry: Entry, k: int) -> charts.StripChart:
    tried = {unit: f"q{k}_{j}" for j, unit in enumerate(units_for(entry)[: len(LOOKS)])}
    known = {unit: np.asarray(over.recording[name]) for unit, name in tried.items() if name in over.recording}
    beside = companion(over.recording, entry["signal"], next(iter(known.values()))) if known else None
    curves = [charts.PlottedTrace(beside[0], over.points(beside[1]))] if beside is not None else []
    for unit, look in zip(known, LOOKS, strict=False):
        curves.append(charts.PlottedTrace(f"{entry['column']} in {pretty_unit(unit)}", over.points(known[unit]), look))
    return charts.StripChart(entry["signal"], SIGNALS[entry["signal"]].unit, curves, over.span)


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    session = page.session
    heading(
        "Drop recordings", "The first recording is fitted, the second one is held out. Nothing leaves this machine."
    )
    with ui.element("div").classes("left"):
        with ui.column():
            if not session["recordings"]:
                button("Take the shipped racer", page.work.take_racer, "racer")
                quiet("Two drives of a 1:10 car, 182 s at 20 Hz.")
            _files(page)
        with ui.column():
            if session["recordings"]:
                _columns(page, data)


def uploader(page: Page) -> ui.upload:
    """Where files are dropped: without it files on their way are lost, so it stays for as long as the page.

    Files that are dropped together come in one request: the first is fitted, and each in a request of its own
    would arrive in any order.
    """

    async def take(event: events.MultiUploadEventArguments) -> None:
        for file in event.files:
            try:
                name = safe_name(file.name)
                must_be_small(name, file.size())
                place = page.session.folder / "recordings" / name
                place.unlink(missing_ok=True)  # it may be a link
                await file.save(place)
                page.session.add(name)
                page.work.look()
            except (gb.GreyboxError, OSError) as error:
                tell(sentence(error))

    words = (
        f"A file of more than {LARGEST >> 20} MB is too large for this page: cut it into parts, or use the "
        "command line."
    )
    element = ui.upload(
        multiple=True,
        max_file_size=LARGEST,
        auto_upload=True,
        on_multi_upload=take,
        on_rejected=lambda: tell(words),
    )
    element.props('flat label="Drop files here, or choose with +" aria-label="recordings"').mark("upload")

    def failed() -> None:
        tell("The files did not arrive: drop them again.")
        element.run_method("removeQueuedFiles")

    element.on("failed", failed, [])
    element.on("uploaded", lambda: element.run_method("removeUploadedFiles"), [])  # the same file may come again
    element.ignores_events_when_hidden = False  # a file may arrive while another step is shown
    return element


def _files(page: Page) -> None:
    session = page.session

    def role(file: str, event: Any) -> None:
        rows = [{**each, "role": event.value} if each["file"] == file else each for each in session["recordings"]]
        session.change(recordings=rows, looked="")
        page.work.look()

    for each in session["recordings"]:
        name = each["file"].removeprefix("recordings/")
        with ui.row(align_items="center").classes("w-full no-wrap"):
            ui.label(name).classes("col").style("overflow-wrap: anywhere; min-width: 0")
            choose(ROLES, each["role"], "role", 8.5, partial(role, each["file"]), f"role-{name}")
    if len(session.files()) > 1 and not session["joining"] and session["columns"] != "canonical":
        button("They are parts of one drive: join them", page.work.join, "join", "flat")


def _columns(page: Page, data: dict[str, Any]) -> None:
    session, work = page.session, page.work
    if not session["columns"]:
        job = session.latest("map")
        if job is not None and job.failure:
            verdict("This file cannot be read.", job.failure, bad=True)
        else:
            ui.label("Looking at the columns …").classes("sentence")
        return
    state = work.ready
    if session["columns"] != MAP:
        verdict(f"Read through the map {session['columns']}.", state)
    else:
        words = "" if state else "If an assignment is wrong, click on it to change it."
        verdict(state or "Every column has its signal.", words, bad=bool(state))
    with ui.row():
        if session["columns"] == MAP:
            for name in session["maps"]:
                words = f"Read it through the shipped map {name}"
                button(words, partial(work.use_map, name), f"map-{name}", "outline")
        elif session["columns"] != "canonical":
            button("Show the columns instead", work.unmap, kind="flat")
        if not state:
            if session["joining"]:
                button("Join the files", work.make_joined, "make-joined")
            else:
                button("See it", partial(page.go, 1), "onward")
    if session["columns"] == MAP:
        _map(page, data)


def _map(page: Page, data: dict[str, Any]) -> None:
    session = page.session
    if not {"time", "rate"} & session["map"].keys() or session["map"].get("time_units"):
        _time(page)
    for k, entry in enumerate(data["open"]):
        _question(page, entry, data["strips"].get(k))
    title("Decided")
    with ui.row().classes("w-full").style("gap: .4rem"):
        for entry in session["entries"]:
            if entry["use"]:
                _chip(page, entry)
    dropped = [entry["column"] for entry in session["entries"] if entry["use"] is False]
    if dropped:
        quiet(f"Left out: {', '.join(dropped)}")
    if session["others"]:
        _others(page)


def _time(page: Page) -> None:
    base, others = page.session["map"], page.session["others"]
    columns = [*([base["time"]["column"]] if "time" in base else []), *others]
    first = next((name for name in ("time", "t", "timestamp", "s", "stamp") if name in columns), None)
    with ui.column().classes("card"):
        title("Which column is the time?")
        with ui.row():
            column = choose(columns, first or (columns[0] if columns else None), "column", 14)
            rest = choose(["", *columns], "ns" if "ns" in columns else "", "nanoseconds within the second", 16)
        with ui.row():
            for unit in base.get("time_units") or TIME_UNITS:
                answer = lambda unit=unit: page.work.set_time(column.value, unit, rest.value or "")  # noqa: E731
                button(f"in {unit}", answer, f"time-{unit}", "outline")


def _question(page: Page, entry: Entry, strip: charts.StripChart | None) -> None:
    signal, counts = entry["signal"], entry["divide_by"] != 1.0
    with ui.column().classes("card").mark(f"question-{signal}"):
        title(f"Is “{entry['column']}” {signal}, the {SIGNALS[signal].about}?")
        quiet("; ".join(entry["reasons"]))
        if strip is not None and strip.curves:
            options = charts.strips([strip], strip.span, height=LITTLE, zoom=False, legend=True)
            height = charts.height_of(1, LITTLE, True, False)
            charts.chart(options, height, f"{entry['column']} in the possible units")
        with ui.row(align_items="center"):
            factor = ui.number("divide by", value=entry["divide_by"], format="%.6g").props("dense outlined")
            factor.style("width: 9rem").set_visibility(counts or signal == "steer")
            for unit in units_for(entry):

                def yes(unit: str = unit) -> None:
                    page.work.answer(entry, use=True, unit=unit, units=[], divide_by=float(factor.value or 1.0))

                words = f"Yes, {'divided, ' if counts else ''}in {pretty_unit(unit)}"
                button(words, yes, f"yes-{signal}-{unit}", "outline")
            button("No, leave it out", partial(page.work.answer, entry, use=False), f"no-{signal}", "flat")


def _chip(page: Page, entry: Entry) -> None:
    unit, signal = units_for(entry)[0], entry["signal"]
    divided = f" ÷ {entry['divide_by']:g}" if entry["divide_by"] != 1.0 else ""
    words = f"{signal} = {'−' if entry['sign'] < 0 else ''}{entry['column']}{divided} [{pretty_unit(unit)}]"
    with button(words, lambda: None, f"chip-{signal}", "outline"), ui.menu(), ui.column().classes("menu"):
        ui.label("; ".join(entry["reasons"]) or SIGNALS[signal].about)
        usual = USUAL_UNITS.get(SIGNALS[signal].unit, (unit,))
        units = choose(list(dict.fromkeys((unit, *usual))), unit, "unit", 9)
        turned = ui.checkbox("turn its sign", value=entry["sign"] < 0)
        change = lambda: page.work.answer(entry, unit=units.value, units=[], sign=-1 if turned.value else 1)  # noqa: E731
        with ui.row():
            button("Change", change)
            button("Leave it out", partial(page.work.answer, entry, use=False), kind="flat")


def _others(page: Page) -> None:
    others = page.session["others"]
    taken = {entry["signal"] for entry in page.session["entries"] if entry["use"]}
    free = [name for name in SIGNALS if name not in taken]
    listed = ", ".join(others[:12]) + (" …" if len(others) > 12 else "")
    words = f"{counted(len(others), 'further column')}: {listed}"
    with ui.expansion(words).classes("w-full"), ui.row(align_items="center"):
        column = choose(others, others[0], "column", 14)
        signal = choose(free, free[0], "is the signal", 12)
        button("Ask about it", lambda: page.work.add_entry(column.value, signal.value), kind="outline")
