"""Output of commands for people and as JSON, on standard error and standard output."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console, RenderableType
from rich.text import Text

from ..base.json_data import finite
from ..base.processes import duration
from ..reports.text.screen import WIDTH, Screen, as_text
from .terminal import clean_json, tell

if TYPE_CHECKING:
    from ..fitting.fit import Verdict
    from ..fitting.how import Say


def console() -> Console:
    """Standard output for people."""
    result = Screen()
    if not result.is_terminal:
        result.width = WIDTH
    return result


def show(parts: Iterable[RenderableType]) -> None:
    """Print a result; to a file or pipe, the text of its `summary()`."""
    screen = console()
    if not screen.is_terminal:
        sys.stdout.write(as_text(parts) + "\n")
        return
    for part in parts:
        screen.print(part)


def tell_result(result: Any, as_json: bool) -> None:
    """Print a result's summary, or its plain data as one JSON object."""
    if as_json:
        print_json(result.to_json())
    else:
        console().print(result.summary(), markup=False, highlight=False, soft_wrap=True)


@contextmanager
def progress() -> Iterator[Say]:
    """Report progress on standard error: as one live line on a terminal, as plain lines elsewhere.

    If GREYBOX_PROGRESS is "all", transient messages are printed as plain lines, too.
    """
    errors = Screen(errors=True, soft_wrap=True)
    if not errors.is_terminal:

        def plain(line: str, passing: bool = False) -> None:
            if not passing or os.environ.get("GREYBOX_PROGRESS") == "all":
                tell(line)

        yield plain
        return
    shown = _Live()
    with errors.status(shown):

        def live(line: str, passing: bool = False) -> None:
            shown.words = line
            if not passing:
                errors.print(line, style="dim")

        yield live


@contextmanager
def working(words: str) -> Iterator[None]:
    """Show on a terminal what is being done and for how long; show nothing elsewhere."""
    with progress() as say:
        say(words, passing=True)
        yield


class _Live:
    """The current work and its duration so far."""

    def __init__(self) -> None:
        self.words, self._began = "starting", time.monotonic()

    def __rich__(self) -> Text:
        return Text.assemble(self.words, (f"  {duration(time.monotonic() - self._began)}", "dim"))


UNUSABLE = 3
"""Exit code of a command that succeeded, but whose fit is not usable."""


def end_by(verdict: Verdict | None) -> None:
    """End the command with the exit code for a verdict."""
    if verdict is not None:
        from ..fitting.fit import NOT_USABLE  # imports all of fitting, which many commands do not need

        if verdict.usability == NOT_USABLE:
            sys.exit(UNUSABLE)


def print_json(body: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output; numbers that are not finite become null."""
    sys.stdout.write(clean_json(json.dumps(finite(body), indent=1, ensure_ascii=False, allow_nan=False)) + "\n")
