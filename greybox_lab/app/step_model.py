"""Step 4: the model; its equations, its parameters as sliders, the trace simulated anew while one is dragged."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

import greybox_id as gb

from . import charts
from .beneath import equations, number, pretty_unit
from .model import MODELS, TYRES, Bench, Slider, lacking, nominal, sliders
from .traces import Shown

if TYPE_CHECKING:
    from .page import Page


async def prepare(page: Page) -> dict[str, Any]:
    """The model over the recording, simulated once; of those that the recording suits."""
    session, files = page.session, page.session.files("train")
    if not files:
        raise gb.BadInput("No recording is to be fitted: give one the role fit in step 1.")
    recording = await page.off(page.work.recording, files[0])
    if "suits" not in page.picked or page.picked.get("suits of") != session.key:
        page.picked["suits"] = await page.off(lambda: {name: lacking(name, recording) for name in MODELS})
        page.picked["suits of"] = session.key
    suits = page.picked["suits"]
    chosen = dict(session["model"])
    if not chosen["name"] or suits.get(chosen["name"]):
        usable = [name for name in ("lateral", "kinematic", "single_track", "longitudinal") if not suits[name]]
        if not usable:
            raise gb.BadInput(f"No model can be simulated on this recording: {suits['lateral']}")
        chosen["name"] = usable[0]
        if not chosen["vehicle"]:
            chosen["vehicle"] = _vehicle(session)
        session.keep_quietly(model=chosen)
    bench, traces = await page.off(_bench, session["model"], recording)
    return {"bench": bench, "traces": traces, "suits": suits, "formulas": await page.off(_formulas, bench.model)}


def _vehicle(session: Any) -> str:
    """A shipped vehicle of the same name as the shipped map or the recordings; else the full-size car."""
    names = gb.vehicles()
    if session["columns"] in names:
        return str(session["columns"])
    if any("racer" in file for file in session.files()) and "roboracer" in names:
        return "roboracer"
    return "full_size_car" if "full_size_car" in names else names[0]


def _bench(chosen: dict[str, Any], recording: gb.Recording) -> tuple[Bench, dict[str, Any]]:
    bench = Bench(nominal(chosen), recording)
    return bench, bench.simulate(chosen["start"])


def _formulas(model: gb.Model) -> list[str]:
    try:
        return equations(model)
    except gb.GreyboxError:
        return []


def draw(page: Page, data: dict[str, Any]) -> None:
    """The step."""
    from .page import guarded, heading, title

    session, chosen = page.session, page.session["model"]
    bench: Bench = data["bench"]
    heading("Which model?", "Dragging a slider simulates the recording anew; where it stands is where the fit starts.")
    with ui.row(align_items="center").classes("w-full"):
        fields = {
            "name": ([name for name in MODELS if not data["suits"][name]], "model"),
            "vehicle": (["", *gb.vehicles()], "vehicle"),
        }
        for key, (names, label) in fields.items():
            ui.select(names, value=chosen[key], label=label, on_change=partial(_choose, page, key)).props(
                "dense outlined"
            ).style("width: 11rem").mark(f"choose-{key}")
        if "tyre" in bench.model.settings:
            ui.select(
                list(TYRES), value=bench.model.settings["tyre"], label="tyre", on_change=partial(_choose, page, "tyre")
            ).props("dense outlined").style("width: 9rem")
        effects = [name for name in gb.effects.names() if _concerns(name, chosen)]
        ui.select(
            effects,
            value=list(chosen["effects"]),
            multiple=True,
            label="with effects",
            on_change=partial(_choose, page, "effects"),
        ).props("dense outlined use-chips").style("min-width: 12rem")

        async def onward() -> None:
            await page.go(4)

        ui.button("Fit it", on_click=guarded(page, lambda: _fit(page, onward))).props("no-caps").mark("fit-it")
        if chosen["start"]:
            ui.button("Sliders back", on_click=lambda: _back(page)).props("flat dense no-caps")
    for name, why in data["suits"].items():
        if why:
            ui.label(f"{name}: {why}").classes("quiet")
    with ui.element("div").classes("left"):
        rows = ui.column()
        with ui.column():
            shown = Shown(bench.recording)
            strips = [_strip(bench, shown, name, data["traces"]) for name in bench.outputs]
            options = charts.strips(strips, shown.span, height=150, legend=True, cursor=session["cursor"])
            element = charts.chart(
                options, charts.height_of(len(strips), 150, True), f"measured and simulated {', '.join(bench.outputs)}"
            ).mark("simulated")
            wrong = ui.label(_errors(bench, data["traces"])).mark("errors")
            if data["formulas"]:
                title(f"{bench.model.name}: {bench.model.about}")
                ui.html(
                    "<div class=formulas>" + "".join(f"<div>{each}</div>" for each in data["formulas"]) + "</div>",
                    sanitize=False,
                ).classes("card")
        with rows:
            _sliders(page, bench, shown, element, wrong)


def _concerns(name: str, chosen: dict[str, Any]) -> bool:
    if name in chosen["effects"]:
        return True
    model = getattr(gb.models, chosen["name"])()
    return bool(getattr(gb.effects, name).concerns(model))


def _strip(bench: Bench, shown: Shown, name: str, traces: dict[str, Any]) -> charts.Strip:
    curves = [
        charts.Curve("measured", shown.points(np.asarray(bench.recording[name])), "measured"),
        charts.Curve("simulated", shown.points(traces[name]), "simulated"),
    ]
    return charts.Strip(name, bench.recording.unit(name), curves)


def _errors(bench: Bench, traces: dict[str, Any]) -> str:
    parts = [
        f"{name} {number(value)} {pretty_unit(bench.recording.unit(name))}"
        for name, value in bench.errors(traces).items()
    ]
    return f"Root mean square of simulated less measured, free run: {', '.join(parts)}"


def _sliders(page: Page, bench: Bench, shown: Shown, element: ui.echart, wrong: ui.label) -> None:
    from .page import title

    session = page.session
    rows = sliders(bench.model)
    values = dict(session["model"]["start"])
    drag = Drag(page, bench, shown, element, wrong, values)
    title("Estimated")
    for k, row in enumerate(rows):
        if k and row.fixed and not rows[k - 1].fixed:
            title("Held")
        _slider(page, row, drag)


def _slider(page: Page, row: Slider, drag: Drag) -> None:
    chosen = page.session["model"]
    value = chosen["start"].get(row.name, row.value)
    free = row.name in chosen["free"] or (not row.fixed and row.name not in chosen["fix"])
    with ui.element("div").classes("slider"):
        name = ui.label(row.name).style("font-style: italic")
        name.tooltip(row.about)
        slider = (
            ui.slider(min=row.low, max=row.high, step=row.step, value=value)
            .props(f'aria-label="{row.name}" dense')
            .mark(f"slider-{row.name}")
        )
        words = ui.label(_value(value, row)).classes("r").style("white-space: nowrap; text-align: right")
        box = ui.checkbox(value=free, on_change=partial(_hold, page, row)).props(
            f'dense aria-label="estimate {row.name}"'
        )
        box.tooltip("estimated by the fit")
        if row.prior is not None:
            width = row.high - row.low
            left = 100 * (row.prior[0] - row.prior[1] - row.low) / width
            ui.html(
                f'<i style="left: {max(left, 0):.1f}%; width: {min(200 * row.prior[1] / width, 100):.1f}%"></i>',
                sanitize=False,
            ).classes("prior").tooltip(
                f"believed: {number(row.prior[0])} ± {number(row.prior[1], 2)} {pretty_unit(row.unit)}"
            )

    async def moved(event: Any) -> None:
        words.set_text(_value(float(event.value), row))
        await drag.to(row.name, float(event.value))

    slider.on_value_change(moved)


def _value(value: float, row: Slider) -> str:
    return f"{number(value)} {pretty_unit(row.unit) if row.unit != '1' else ''}"


class Drag:
    """Simulates anew while a slider moves; what is overtaken by a newer value is left out."""

    def __init__(
        self, page: Page, bench: Bench, shown: Shown, element: ui.echart, wrong: ui.label, values: dict[str, float]
    ) -> None:
        self.page, self.bench, self.shown, self.element, self.wrong = page, bench, shown, element, wrong
        self.values, self._busy, self._again = values, False, False

    async def to(self, name: str, value: float) -> None:
        """A slider is at a value."""
        self.values[name] = value
        if self._busy:
            self._again = True
            return
        self._busy = True
        try:
            while True:
                self._again = False
                points, words = await self.page.off(self._simulated, dict(self.values))
                charts.with_curves(self.element, points)
                self.wrong.set_text(words)
                if not self._again:
                    break
        finally:
            self._busy = False
        session = self.page.session
        session.change(model={**session["model"], "start": dict(self.values)})
        self.page.changed_here()

    def _simulated(self, values: dict[str, float]) -> tuple[dict[str, Any], str]:
        traces = self.bench.simulate(values)
        points = {f"{name}/simulated": self.shown.points(trace) for name, trace in traces.items()}
        return points, _errors(self.bench, traces)


def _choose(page: Page, key: str, event: Any) -> None:
    chosen = dict(page.session["model"])
    if key == "tyre":
        chosen["settings"] = {**chosen["settings"], "tyre": event.value}
    else:
        chosen[key] = event.value
    if key == "name":
        chosen |= {"settings": {}, "effects": []}
    if key in ("name", "vehicle", "tyre"):
        chosen |= {"start": {}, "fix": [], "free": []}
    page.session.change(model=chosen)


def _hold(page: Page, row: Slider, event: Any) -> None:
    chosen = dict(page.session["model"])
    free = [name for name in chosen["free"] if name != row.name]
    fix = [name for name in chosen["fix"] if name != row.name]
    start = dict(chosen["start"])
    if event.value and row.fixed:
        free.append(row.name)
    if not event.value and not row.fixed:
        fix.append(row.name)
        start.setdefault(row.name, row.value)
    page.session.change(model={**chosen, "free": free, "fix": fix, "start": start})
    page.changed_here()


def _back(page: Page) -> None:
    page.session.change(model={**page.session["model"], "start": {}, "fix": [], "free": []})


async def _fit(page: Page, onward: Any) -> None:
    page.work.fit()
    await onward()
