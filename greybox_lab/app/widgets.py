"""Parts that all steps use: buttons that make sentences of errors, selections, verdicts, tables; words are escaped."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

from nicegui import ui

import greybox_id as gb

from .beneath import sentence


def tell(words: str) -> None:
    """A sentence on what went wrong, which stays until it was read."""
    ui.notify(words, type="negative", multi_line=True, timeout=20000, close_button="close")


def button(words: str, act: Callable[[], Any], mark: str = "", kind: str = "") -> ui.button:
    """A button; what goes wrong is a sentence. `kind` is "", "outline" or "flat"."""

    async def guarded() -> None:
        try:
            result = act()
            if isinstance(result, Awaitable):
                await result
        except gb.GreyboxError as error:
            tell(sentence(error))

    return ui.button(words, on_click=guarded).props(f"no-caps {kind} {'dense' if kind else ''}").mark(mark or words)


def choose(
    options: Sequence[Any] | Mapping[Any, str], value: Any, label: str, width: float, change: Any = None, mark: str = ""
) -> ui.select:
    """A selection of so many rem."""
    given = dict(options) if isinstance(options, Mapping) else list(options)
    element = ui.select(given, value=value, label=label, on_change=change).props("dense outlined options-dense")
    return element.style(f"width: {width}rem").mark(mark or label)


def quiet(words: str) -> ui.label:
    """Words that are less important."""
    return ui.label(words).classes("quiet")


def heading(words: str, what: str = "") -> None:
    """A step's name, and its one sentence."""
    ui.label(words).classes("h2").props("role=heading aria-level=2")
    if what:
        quiet(what)


def title(words: str) -> None:
    """A heading within a step."""
    ui.label(words).classes("h3").props("role=heading aria-level=3")


def verdict(head: str, words: str = "", *, bad: bool = False) -> None:
    """What a reader does with it, first."""
    with ui.column().classes("verdict bad" if bad else "verdict"):
        ui.label(head).classes("sentence").style("font-weight: bold")
        if words:
            ui.label(words)
