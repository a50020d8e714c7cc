"""The frame of the page: seven steps, what runs, and a step's picture, drawn anew where the session has changed."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from types import ModuleType
from typing import Any

from nicegui import run, ui

import greybox_id as gb

from . import step_check, step_drop, step_fit, step_model, step_see, step_take, step_why
from .beneath import sentence
from .jobs import Job
from .work import STEPS, Work

MODULES: tuple[ModuleType, ...] = (step_drop, step_see, step_check, step_model, step_fit, step_why, step_take)
TICK = 0.25
"""Seconds between looks at whether the session has changed."""
SOON = 0.5
"""Seconds from which on a job is shown with a stop."""


class Page:
    """One open page.

    Parameters
    ----------
    work : the session, which all pages share.
    """

    def __init__(self, work: Work) -> None:
        self.work, self.session = work, work.session
        self.step = int(self.session["step"])
        self.seen = -1
        self.window: tuple[float, float] | None = None
        self.picked: dict[str, Any] = {}
        self._drawing = 0
        self._ticking: list[Callable[[], None]] = []
        self._trouble = ""

    async def build(self) -> None:
        """Make the page."""
        from .server import CSS

        ui.add_css(CSS)
        ui.colors(primary="#0072b2", negative="#a34a12", accent="#7b3f8c")
        with ui.row(align_items="center").classes("bar"):
            ui.html(f"<h1>greybox</h1>", sanitize=False)
            with ui.row().classes("steps").props('role=navigation aria-label="steps"'):
                self.buttons = [self._button(k, name) for k, name in enumerate(STEPS)]
            ui.space()
            ui.label(self.session.folder.name).classes("quiet").tooltip(str(self.session.folder))
        with ui.column().classes("page").props("role=main"):
            self.running = ui.column().classes("w-full")
            self.body = ui.column().classes("w-full")
        await self.draw()
        ui.timer(TICK, self._tick)

    def _button(self, k: int, name: str) -> ui.button:
        async def go() -> None:
            await self.go(k)

        return ui.button(f"{k + 1} {name}", on_click=go).props("flat dense no-caps").classes("step").mark(f"step-{k}")

    async def go(self, step: int) -> None:
        """Show another step; the fit and what follows it stay locked until the check was looked at."""
        if step >= 3 and self.session["looked"] != self.session.key:
            step = min(step, 2)
        if step in (1, 2) and self.work.ready:
            step = 0
        self.step, self.window = step, None
        self.session.keep_quietly(step=step)
        await self.draw()

    async def draw(self) -> None:
        """Draw the step anew."""
        self._drawing += 1
        mine, self.seen = self._drawing, self.session.version
        module = MODULES[self.step]
        try:
            data = await module.prepare(self)
        except gb.GreyboxError as error:
            data = error
        if mine != self._drawing or self.body.is_deleted:
            return
        self._ticking = []
        locked = self.session["looked"] != self.session.key
        for k, button in enumerate(self.buttons):
            button.set_enabled(not (k >= 3 and locked) and not (k in (1, 2) and bool(self.work.ready)))
            button.props(f"aria-current={'step' if k == self.step else 'false'}")
        self.running.clear()
        with self.running:
            for job in self.session.jobs.running():
                job_card(self, job)
        self.body.clear()
        with self.body:
            if isinstance(data, Exception):
                verdict("This cannot be shown.", sentence(data), bad=True)
            else:
                module.draw(self, data)

    async def _tick(self) -> None:
        for tick in self._ticking:
            tick()
        if self.work.trouble and self.work.trouble != self._trouble:
            ui.notify(self.work.trouble, type="negative", multi_line=True, timeout=15000, close_button="close")
        self._trouble = self.work.trouble
        if self.seen != self.session.version:
            await self.draw()

    def every_tick(self, tick: Callable[[], None]) -> None:
        """Call several times a second while the step is shown as it is."""
        self._ticking.append(tick)

    def changed_here(self) -> None:
        """What just changed is on this page already."""
        self.seen = self.session.version

    async def off(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a function in a thread, so that the page stays alive."""
        return await run.io_bound(function, *arguments)


def guarded(page: Page, action: Callable[[], Any]) -> Callable[[], Awaitable[None]]:
    """An action of a button: what goes wrong is a sentence on the page."""

    async def act() -> None:
        try:
            result = action()
            if isinstance(result, Awaitable):
                await result
        except gb.GreyboxError as error:
            ui.notify(sentence(error), type="negative", multi_line=True, timeout=15000, close_button="close")

    return act


def job_card(page: Page, job: Job) -> None:
    """What runs: its command, its last line, for how long, and a stop."""
    with ui.row(align_items="center").classes("card") as card:
        ui.spinner(size="1.2rem")
        ui.label(job.command).style("font-family: monospace; font-size: .84rem; overflow-wrap: anywhere").classes("col")
        line = ui.label("").classes("quiet")
        ui.button("Stop", on_click=job.stop).props("outline dense no-caps").mark("stop")
    card.set_visibility(job.seconds > SOON)

    def tick() -> None:
        last = next((text for text in reversed(job.lines) if text.strip()), "starting")
        line.set_text(f"{last[:110]} · {job.seconds:.0f} s")
        card.set_visibility(job.seconds > SOON)

    tick()
    page.every_tick(tick)


def verdict(head: str, words: str = "", *, bad: bool = False) -> None:
    """What a reader does with it, first."""
    with ui.column().classes("verdict bad" if bad else "verdict"):
        ui.label(head).style("font-weight: bold").classes("sentence")
        if words:
            ui.label(words)


def heading(words: str, sentence: str = "") -> None:
    """A step's one sentence."""
    ui.label(words).style("font-size: 1.35rem; font-weight: bold; line-height: 1.25").props("role=heading aria-level=2")
    if sentence:
        ui.label(sentence).classes("quiet")


def title(words: str) -> None:
    """A heading within a step."""
    ui.label(words).style("font-weight: bold; font-size: 1.08rem").props("role=heading aria-level=3")
