"""Step 1: drop files; what each column may be, and questions where that is not sure."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import events, ui

import greybox_id as gb

from . import charts, mapping
from .beneath import SIGNALS, counted, pretty_unit
from .mapping import TIME_UNITS, Entry, questions, units_for
from .session import LARGEST, MAP, ROLES, must_be_small, must_be_takeable, safe_name
from .traces import Shown, companion

if TYPE_CHECKING:
    from .page import Page

LITTLE = 92
"""Height of the plot that decides a question, pixels."""
LOOKS = ("simulated", "other", "third")


async def prepare(page: Page) -> dict[str, Any]:
    """Candidates of the first open question as curves."""
    session = page.session
    open_ones = questions(session["entries"]) if session["columns"] == MAP else []
    base = session["map"]
    if not open_ones or "time" not in base or session.state.get("joining"):
        return {"open": open_ones, "curves": {}}
    return {"open": open_ones, "curves": await page.off(_candidates, page, open_ones)}


def _candidates(page: Page, open_ones: list[Entry]) -> dict[int, charts.Strip]:
    """The little plot of each question: the column in each unit that comes into question, and what others say of it."""
    session = page.session
    extra = {
        f"q{k}_{j}": {**mapping.column_of(entry, unit), "optional": True}
        for k, entry in enumerate(open_ones) for j, unit in enumerate(units_for(entry)[:3])
    }  # fmt: skip
    place = session.folder / "jobs" / "candidates.toml"
    mapping.write_map(place, session["map"], session["entries"], **extra)
    try:
        recording = page.work.library.read(session.folder / session.files()[0], place)
    except gb.GreyboxError:
        return {}
    shown = Shown(recording.rows(0, min(len(recording), 200_000)))
    strips = {}
    for k, entry in enumerate(open_ones):
        curves = []
        beside = companion(shown.recording, entry["signal"])
        if beside is not None:
            curves.append(charts.Curve(beside[0], shown.points(beside[1]), "measured"))
        for j, unit in enumerate(units_for(entry)[:3]):
            if f"q{k}_{j}" in shown.recording:
                curves.append(
                    charts.Curve(
                        f"{entry['column']} in {pretty_unit(unit)}",
                        shown.points(shown.recording[f"q{k}_{j}"]),
                        LOOKS[j],
                    )
                )
        if curves:
            unit = SIGNALS[entry["signal"]].unit if entry["signal"] in SIGNALS else "1"
            strips[k] = charts.Strip(entry["signal"], unit, curves)
    return strips


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    from .page import heading

    session, work = page.session, page.work
    heading("Drop recordings", "The first is fitted, the second is held out. Nothing leaves this machine.")
    with ui.element("div").classes("left"):
        with ui.column():
            _upload(page)
            if not session["recordings"]:
                ui.button("Take the shipped racer", on_click=lambda: work.take_racer()).props("no-caps").mark("racer")
                ui.label("Two drives of a 1:10 car, 182 s at 20 Hz.").classes("quiet")
            _files(page)
        with ui.column():
            if session["recordings"]:
                _columns(page, data)


def _upload(page: Page) -> None:
    async def take(event: events.UploadEventArguments) -> None:
        from .beneath import sentence

        session = page.session
        try:
            name = safe_name(event.file.name)
            must_be_small(name, event.file.size())
            place = session.folder / "recordings" / name
            if place.is_symlink():
                place.unlink()
            await event.file.save(place)
            try:
                must_be_takeable(place)
            except gb.GreyboxError:
                place.unlink(missing_ok=True)
                raise
            session.add(name)
            page.work.look()
        except gb.GreyboxError as error:
            ui.notify(sentence(error), type="negative", multi_line=True, timeout=20000, close_button="close")

    def refuse() -> None:
        words = f"A file of more than {LARGEST >> 20} MB is not taken here: cut it into parts, or use the command line."
        ui.notify(words, type="negative", multi_line=True, timeout=20000, close_button="close")

    upload = ui.upload(
        multiple=True, max_file_size=LARGEST, auto_upload=True, on_upload=take, on_rejected=refuse,
        label="Drop files here, or choose with +",
    )  # fmt: skip
    upload.props('flat aria-label="recordings"').mark("upload")


def _files(page: Page) -> None:
    session = page.session

    def role(file: str, event: Any) -> None:
        rows = [{**each, "role": event.value} if each["file"] == file else each for each in session["recordings"]]
        session.change(recordings=rows, looked="")

    for each in session["recordings"]:
        with ui.row(align_items="center").classes("w-full no-wrap"):
            name = each["file"].removeprefix("recordings/")
            ui.label(name).classes("col").style("overflow-wrap: anywhere; min-width: 0")
            ui.select(dict(ROLES), value=each["role"], on_change=partial(role, each["file"])).props(
                f'dense outlined options-dense aria-label="role"'
            ).style("width: 8.5rem").mark(f"role-{name}")
    used = session.files()
    if len(used) > 1 and not session.state.get("joining") and session["columns"] != "canonical":
        button = ui.button("They are parts of one drive: join them", on_click=page.work.join).props(
            "flat dense no-caps"
        )
        button.tooltip("greybox data join: one file per sensor or topic, each with a clock of its own").mark("join")


def _columns(page: Page, data: dict[str, Any]) -> None:
    from .page import title, verdict

    session, work = page.session, page.work
    if not session["columns"]:
        job = session.latest("map")
        if job is not None and job.failure:
            verdict("This file cannot be read.", job.failure, bad=True)
        else:
            ui.label("Looking at the columns …").classes("sentence")
        return
    if session["columns"] != MAP:
        verdict(f"Read through the map {session['columns']}.", work.ready)
        _onward(page)
        if session["columns"] != "canonical":
            ui.button("Look at the columns instead", on_click=work.own_map).props("flat dense no-caps")
        return
    state = work.ready
    verdict(
        state or "Every column has its signal.",
        "" if state else "A wrong one is changed by a click on it.",
        bad=bool(state),
    )
    with ui.row():
        for name in work.maps:
            ui.button(f"Read it through the shipped map {name}", on_click=partial(work.use_map, name)).props(
                "outline dense no-caps"
            ).mark(f"map-{name}")
        if not state and not session.state.get("joining"):
            _onward(page)
    if not state and session.state.get("joining"):
        ui.button("Join the files", on_click=work.make_joined).props("no-caps").mark("make-joined")
    if "time" not in session["map"] or session["map"].get("time_units"):
        _time(page)
    for k, entry in enumerate(data["open"]):
        _question(page, entry, data["curves"].get(k))
    title("Decided")
    with ui.row().classes("w-full").style("gap: .4rem"):
        for entry in session["entries"]:
            if entry["use"]:
                _chip(page, entry)
    dropped = [entry for entry in session["entries"] if entry["use"] is False]
    if dropped:
        ui.label(f"Left out: {', '.join(entry['column'] for entry in dropped)}").classes("quiet")
    if session["others"]:
        _others(page)


def _onward(page: Page) -> None:
    async def go() -> None:
        await page.go(1)

    if not page.work.ready:
        ui.button("See it", on_click=go).props("no-caps").mark("onward")


def _time(page: Page) -> None:
    from .page import title

    session, base = page.session, page.session["map"]
    with ui.column().classes("card"):
        title("Which column is the time?")
        columns = [*([base["time"]["column"]] if "time" in base else []), *session["others"]]
        known = [each for each in ("time", "t", "timestamp", "s", "stamp") if each in columns]
        column = (
            ui.select(columns, value=known[0] if known else columns[0] if columns else None, label="column")
            .props("dense outlined")
            .style("width: 14rem")
        )
        rest = (
            ui.select(["", *columns], value="ns" if "ns" in columns else "", label="nanoseconds within the second")
            .props("dense outlined")
            .style("width: 16rem")
        )
        with ui.row():
            for unit in base.get("time_units") or TIME_UNITS:
                act = lambda unit=unit: page.work.set_time(column.value, unit, rest.value or "")  # noqa: E731
                ui.button(f"in {unit}", on_click=act).props("outline dense no-caps").mark(f"time-{unit}")


def _question(page: Page, entry: Entry, strip: charts.Strip | None) -> None:
    from .page import title

    work = page.work
    with ui.column().classes("card").mark(f"question-{entry['signal']}"):
        title(f"Is “{entry['column']}” {entry['signal']}, the {SIGNALS[entry['signal']].about}?")
        ui.label("; ".join(entry["reasons"])).classes("quiet")
        if strip is not None:
            options = charts.strips([strip], _span(strip), height=LITTLE, zoom=False, legend=True)
            charts.chart(
                options,
                charts.height_of(1, LITTLE, True, False),
                f"{entry['column']} in the units that come into question",
            )
        with ui.row(align_items="center"):
            factor = None
            if entry["divide_by"] != 1.0:
                factor = (
                    ui.number("divide by", value=entry["divide_by"], format="%.6g")
                    .props("dense outlined")
                    .style("width: 9rem")
                )
            for unit in units_for(entry):
                yes = lambda unit=unit: work.answer(
                    entry,
                    use=True,
                    unit=unit,
                    units=[],
                    divide_by=float(factor.value) if factor is not None and factor.value else 1.0,
                )  # noqa: E731
                words = (
                    f"Yes, divided by {entry['divide_by']:g} in {pretty_unit(unit)}"
                    if factor is not None
                    else f"Yes, in {pretty_unit(unit)}"
                )
                ui.button(words, on_click=yes).props("dense no-caps outline").mark(f"yes-{entry['signal']}-{unit}")
            ui.button("No, leave it out", on_click=lambda: work.answer(entry, use=False)).props(
                "dense no-caps flat"
            ).mark(f"no-{entry['signal']}")


def _span(strip: charts.Strip) -> tuple[float, float]:
    instants = [point[0] for curve in strip.curves for point in curve.points if point is not None]
    return (min(instants), max(instants)) if instants else (0.0, 1.0)


def _chip(page: Page, entry: Entry) -> None:
    unit = units_for(entry)[0]
    sign = "−" if entry["sign"] < 0 else ""
    divided = f" ÷ {entry['divide_by']:g}" if entry["divide_by"] != 1.0 else ""
    with (
        ui.button(f"{entry['signal']} = {sign}{entry['column']}{divided} [{pretty_unit(unit)}]")
        .props("outline dense no-caps color=primary")
        .mark(f"chip-{entry['signal']}") as button
    ):
        with ui.menu(), ui.column().style("padding: .6rem 1rem; max-width: 30rem"):
            ui.label("; ".join(entry["reasons"]) or SIGNALS[entry["signal"]].about)
            usual = mapping.USUAL_UNITS.get(SIGNALS[entry["signal"]].unit, (unit,))
            units = (
                ui.select(list(dict.fromkeys((unit, *usual))), value=unit, label="unit")
                .props("dense outlined")
                .style("width: 9rem")
            )
            sign_of = ui.checkbox("turn its sign", value=entry["sign"] < 0)
            with ui.row():
                act = lambda: page.work.answer(entry, unit=units.value, units=[], sign=-1 if sign_of.value else 1)  # noqa: E731
                ui.button("Change", on_click=act).props("dense no-caps")
                ui.button("Leave it out", on_click=lambda: page.work.answer(entry, use=False)).props(
                    "dense no-caps flat"
                )
    button.props("aria-haspopup=true")


def _others(page: Page) -> None:
    session = page.session
    taken = {entry["signal"] for entry in session["entries"] if entry["use"]}
    free = [name for name in SIGNALS if name not in taken]
    with (
        ui.expansion(
            f"{counted(len(session['others']), 'further column')}: {', '.join(session['others'][:12])}{' …' if len(session['others']) > 12 else ''}"
        ).classes("w-full"),
        ui.row(align_items="center"),
    ):
        column = (
            ui.select(session["others"], value=session["others"][0], label="column")
            .props("dense outlined")
            .style("width: 14rem")
        )
        signal = ui.select(free, value=free[0], label="is the signal").props("dense outlined").style("width: 12rem")
        ui.button("Ask about it", on_click=lambda: page.work.add_entry(column.value, signal.value)).props(
            "dense no-caps outline"
        )
