"""Step 4: the model; its equations, its parameters as sliders, the trace simulated anew while one is dragged."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

import greybox_id as gb

from . import charts
from .beneath import equations, number, pretty_unit, quantity
from .model import (
    MODELS,
    TYRES,
    Playground,
    effects_of,
    lacking,
    longest,
    nearest_vehicle,
    nominal,
    prior_of,
    span_of,
    stated_effects,
)
from .traces import Array
from .widgets import button, choose, heading, quiet, title

if TYPE_CHECKING:
    from .page import Page

HOLDS = {
    "": "not stated: compare both",
    "zero": "commanded: held from row to row",
    "linear": "measured: linear between rows",
}
USUAL = ("lateral", "kinematic", "single_track", "longitudinal")
"""Models in the order in which the first that suits is proposed."""


async def prepare(page: Page) -> dict[str, Any]:
    """The model over the recording, simulated once; models that the recording suits."""
    session, files = page.session, page.session.files("train")
    if not files:
        raise gb.BadInput("No recording is to be fitted: give one the role 'fit' in step 1.")
    recording = await page.off(page.work.recording, files[0])
    if page.picked.get("suits of") != session.key:
        page.picked["suits"] = await page.off(lambda: {name: lacking(name, recording) for name in MODELS})
        page.picked["suits of"] = session.key
    suits = page.picked["suits"]
    if suits.get(session["model"]["name"], "none"):
        usable = [name for name in USUAL if not suits[name]]
        if not usable:
            lacks = " ".join(f"{why.partition(';')[0]}." for why in suits.values())
            raise gb.BadInput(f"No model can be simulated on this recording. {lacks} Name their columns in step 1.")
        vehicle = await page.off(nearest_vehicle, usable[0], longest(recording))
        proposed = {"name": usable[0], "vehicle": vehicle, "effects": stated_effects(usable[0], vehicle)}
        session.change(quietly=True, model={**session["model"], **proposed})
    return {"suits": suits, **await page.off(_simulated, session["model"], recording)}


def _simulated(chosen: dict[str, Any], recording: gb.Recording) -> dict[str, Any]:
    bench = Playground(nominal(chosen), recording)
    try:
        formulas = equations(bench.model)
    except gb.GreyboxError:
        formulas = []
    traces = bench.simulate(chosen["start"])
    return {"bench": bench, "traces": traces, "formulas": formulas, "effects": effects_of(chosen)}


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    session, chosen, suits = page.session, page.session["model"], data["suits"]
    bench: Playground = data["bench"]
    heading("Which model?", "Drag a slider to simulate the recording again; the fit starts from the sliders' values.")
    with ui.row(align_items="center").classes("w-full"):
        choose(
            [name for name in MODELS if not suits[name]], chosen["name"], "model", 11, partial(_choose, page, "name")
        )
        vehicles = {"": "none", **{name: name for name in gb.models.vehicles()}}
        choose(vehicles, chosen["vehicle"], "vehicle", 11, partial(_choose, page, "vehicle"))
        if "tyre" in bench.model.settings:
            choose(TYRES, bench.model.settings["tyre"], "tyre", 9, partial(_choose, page, "tyre"))
        if session["columns"] != "canonical":
            held = choose(
                HOLDS,
                page.work.mapped()[0].get("hold", ""),
                "steering between rows",
                15,
                lambda event: page.work.set_hold(event.value),
            )
            held.tooltip("Were steering and drive measured or commanded? This sets hold in the column map.")
        extra = choose(data["effects"], list(chosen["effects"]), "with effects", 14, partial(_choose, page, "effects"))
        extra.props("multiple use-chips")

        async def onward() -> None:
            page.work.fit()
            await page.go(4)

        button("Fit it", onward, "fit-it")
        if chosen["start"] or chosen["fix"] or chosen["free"]:
            back = {**chosen, "start": {}, "fix": [], "free": []}
            button("Sliders back", partial(session.change, model=back), kind="flat")
    for name, why in suits.items():
        if why:
            quiet(f"{name}: {why.partition(';')[0]}.")
    with ui.element("div").classes("left"):
        rows = ui.column()
        with ui.column():
            strips = bench.strips({"simulated": data["traces"]})
            options = charts.strips(strips, bench.over.span, height=150, legend=True, cursor=session["cursor"])
            words = f"measured and simulated {', '.join(bench.outputs)}"
            element = charts.chart(options, charts.height_of(len(strips), 150, True), words).mark("simulated")
            wrong = ui.label(_errors(bench, data["traces"])).mark("errors")
            if data["formulas"]:
                title(f"{bench.model.name}: {bench.model.about}")
                lines = "".join(f"<div>{formula}</div>" for formula in data["formulas"])
                ui.html(f"<div class=formulas>{lines}</div>", sanitize=False).classes("card")
        with rows:
            drag = Drag(page, bench, element, wrong)
            for words, fixed in (("Estimated", False), ("Held", True)):
                title(words)
                for each in bench.model.parameters:
                    if each.fixed == fixed and (span := span_of(each)) is not None:
                        _slider(page, each, span, drag)


def _errors(bench: Playground, traces: dict[str, Array]) -> str:
    errors = bench.errors(traces).items()
    words = ", ".join(f"{name} {quantity(value, bench.recording.unit(name))}" for name, value in errors)
    return f"Root mean square of the simulated minus the measured signals, free run: {words}"


def _slider(page: Page, row: gb.models.Parameter, span: tuple[float, float], drag: Drag) -> None:
    chosen, (low, high) = page.session["model"], span
    value = chosen["start"].get(row.name, float(row.array))
    free = row.name in chosen["free"] or (not row.fixed and row.name not in chosen["fix"])
    with ui.element("div").classes("slider"):
        ui.label(row.name).style("font-style: italic").tooltip(row.about)
        slider = _Slider(min=low, max=high, step=(high - low) / 200, value=value)
        slider.props(f'aria-label="{row.name}" dense').mark(f"slider-{row.name}")
        words = ui.label(quantity(value, row.unit)).style("white-space: nowrap; text-align: right")
        box = ui.checkbox(value=free, on_change=partial(_hold, page, row))
        box.props(f'dense aria-label="estimate {row.name}"').tooltip("estimated by the fit")
        if (prior := prior_of(row)) is not None:
            mean, sd = prior
            left, width = (mean - sd - low) / (high - low), 2 * sd / (high - low)
            band = f"left: {100 * max(left, 0):.1f}%; width: {100 * min(width, 1 - max(left, 0)):.1f}%"
            bar = ui.html(f'<i style="{band}"></i>', sanitize=False).classes("prior")
            bar.tooltip(f"prior: {number(mean)} ± {number(sd, 2)} {pretty_unit(row.unit)}")

    async def moved(event: Any) -> None:
        await drag.to(row.name, float(event.value))
        words.set_text(quantity(float(event.value), row.unit))

    slider.on_value_change(moved)


class _Slider(ui.slider):
    """A slider that the browser moves by itself: an echo of each value would have the page rendered anew."""

    LOOPBACK = None


class Drag:
    """Simulates anew while a slider moves; what is overtaken by a newer value is left out."""

    def __init__(self, page: Page, bench: Playground, element: ui.echart, wrong: ui.label) -> None:
        self.page, self.bench, self.element, self.wrong = page, bench, element, wrong
        self.values = dict(page.session["model"]["start"])
        self._busy = self._again = False

    async def to(self, name: str, value: float) -> None:
        """A slider is at a value."""
        self.values[name] = value
        self._again = True
        if self._busy:
            return
        self._busy = True
        try:
            while self._again:
                self._again = False
                traces = self.bench.simulate(self.values)  # a few ms: a thread would take longer to wake
                await charts.with_curves(self.element, self.bench.curves(traces, "simulated"))  # one after the other
                self.wrong.set_text(_errors(self.bench, traces))
        finally:
            self._busy = False
        session = self.page.session
        session.change(model={**session["model"], "start": dict(self.values)})
        self.page.changed_here()


def _choose(page: Page, key: str, event: Any) -> None:
    chosen = dict(page.session["model"])
    if key == "tyre":
        chosen["settings"] = {**chosen["settings"], "tyre": event.value}
    else:
        chosen[key] = event.value
    if key == "name":
        chosen |= {"settings": {}}
    if key in ("name", "vehicle"):
        chosen |= {"effects": stated_effects(chosen["name"], chosen["vehicle"])}
    if key != "effects":
        chosen |= {"start": {}, "fix": [], "free": []}
    page.session.change(model=chosen)


def _hold(page: Page, row: gb.models.Parameter, event: Any) -> None:
    chosen = dict(page.session["model"])
    free, fix = ([name for name in chosen[key] if name != row.name] for key in ("free", "fix"))
    start = dict(chosen["start"])
    if event.value and row.fixed:
        free.append(row.name)
    if not event.value and not row.fixed:
        fix.append(row.name)
        start.setdefault(row.name, float(row.array))
    page.session.change(model={**chosen, "free": free, "fix": fix, "start": start})
    page.changed_here()
