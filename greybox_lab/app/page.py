"""The frame of the page: seven steps, what runs, and a step's picture, drawn anew where the session has changed."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from functools import partial
from types import ModuleType
from typing import Any

from nicegui import app, run, ui

import greybox_id as gb

from .beneath import sentence
from .jobs import PageJob
from .widgets import quiet, tell, verdict
from .work import STEPS, Work

TICK = 0.25
"""Seconds between looks at whether the session has changed."""
SOON = 0.5
"""Seconds from which on a job is shown with a stop."""
GRACE = 5.0
"""Seconds for which what was drawn anew still answers: a click may be on its way, a selection may be open."""


class Page:
    """One open page of a session, which all pages share; each of its steps is a module with `prepare` and `draw`."""

    def __init__(self, work: Work, steps: Sequence[ModuleType]) -> None:
        self.work, self.session, self.steps = work, work.session, steps
        self.step = int(self.session["step"])
        self.seen, self._drawing = -1, 0
        self.window: tuple[float, float] | None = None
        self.picked: dict[str, Any] = {}
        self._ticking, self._trouble = list[Callable[[], Any]](), work.trouble

    def build(self) -> None:
        """Make the page."""
        ui.colors(primary="#0072b2", negative="#a34a12", accent="#7b3f8c")
        with ui.row(align_items="center").classes("bar"):
            ui.label("greybox").classes("h3").props("role=heading aria-level=1")
            with ui.row().classes("steps").props('role=navigation aria-label="steps"'):
                self.buttons = [self._button(k, name) for k, name in enumerate(STEPS)]
            ui.space()
            quiet(self.session.folder.name).tooltip(str(self.session.folder))
        with ui.column().classes("page").props("role=main") as self.frame:
            self.running = ui.column().classes("running")
            self.uploader = self.steps[0].uploader(self)  # never drawn anew: files may be on their way
            self.body = ui.column().classes("body")
        with self.body:
            ui.spinner(size="2rem")
        ui.echart({}).style("display: none")  # the browser loads what draws while it waits
        ui.timer(TICK, self._tick)  # which draws the step once the browser is there

    def _button(self, k: int, name: str) -> ui.button:
        button = ui.button(f"{k + 1} {name}", on_click=partial(self.go, k)).mark(f"step-{k}")
        return button.props("flat dense no-caps").classes("step")

    @property
    def reach(self) -> int:
        """The last step that is open: the fit and what follows stay locked until the check was looked at."""
        return 0 if self.work.ready else 6 if self.session["looked"] == self.session.key else 2

    async def go(self, step: int) -> None:
        """Show another step, as far as it is open."""
        self.step, self.window = min(step, self.reach), None
        self.session.change(quietly=True, step=self.step)
        await self.draw()

    async def draw(self) -> None:
        """Draw the step anew."""
        self.step = min(self.step, self.reach)
        self._drawing += 1
        mine, self.seen = self._drawing, self.session.version
        module = self.steps[self.step]
        try:
            data = await module.prepare(self)
        except Exception as error:  # a page that stands still would hide it
            data = error
            if not isinstance(error, gb.GreyboxError):
                app.handle_exception(error)
        if mine != self._drawing or self.body.is_deleted:
            return
        self._ticking = []
        for k, button in enumerate(self.buttons):
            button.set_enabled(k <= self.reach)
            button.props(f"aria-current={'step' if k == self.step else 'false'}")
        self.running.clear()
        with self.running:
            for job in self.session.jobs.running():
                self._job(job)
        self.uploader.set_visibility(self.step == 0)
        replaced = self.body
        replaced.set_visibility(False)
        with self.frame:
            ui.timer(GRACE, replaced.delete, once=True)
            self.body = ui.column().classes("body")
        with self.body:
            if isinstance(data, Exception):
                verdict("This cannot be shown.", sentence(data), bad=True)
            else:
                module.draw(self, data)

    def _job(self, job: PageJob) -> None:
        """What runs: its command, its last line, for how long, and a stop."""
        with ui.row(align_items="center").classes("card no-wrap") as card:
            ui.spinner(size="1.2rem")
            ui.label(job.command).classes("col mono")
            line = quiet("")
            ui.button("Stop", on_click=job.stop).props("outline dense no-caps").mark("stop")

        def tick() -> None:
            last = next((text for text in reversed(job.lines) if text.strip()), "starting")
            line.set_text(f"{last.partition('; ')[0][:90]} · {time.time() - job.started:.0f} s")
            card.set_visibility(time.time() - job.started > SOON)

        tick()
        self.every_tick(tick)

    async def _tick(self) -> None:
        for tick in self._ticking:
            if asyncio.iscoroutine(result := tick()):
                await result
        if self.work.trouble and self.work.trouble != self._trouble:
            tell(self.work.trouble)
        self._trouble = self.work.trouble
        if self.seen != self.session.version:
            await self.draw()

    def every_tick(self, tick: Callable[[], Any]) -> None:
        """Call several times a second while the step is shown as it is."""
        self._ticking.append(tick)

    def changed_here(self) -> None:
        """The last change is on this page already; one that came in between is not."""
        self.seen += 1

    async def off(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a function in a thread, so that the page stays alive."""
        return await run.io_bound(function, *arguments)
