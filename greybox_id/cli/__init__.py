"""The `greybox` command: a thin layer over the Python interface, without logic of its own."""

from __future__ import annotations

import atexit
import gc
import sys
import warnings
from typing import Any

import click

from ..base.errors import GreyboxError
from ..base.version import __version__
from .commands import LazyGroup, option_called
from .defaults import defaults_of
from .terminal import OutputFailed, clean, drop_output, interrupts, streams, tell

INTERRUPTED = 130
"""Exit code after Ctrl-C."""
COLLECTED = (250_000, 1, 1)
"""Thresholds of garbage collection: with Python's defaults it takes a tenth of a report's time, and finds hardly one in
a hundred of the objects of imports and figures. The first is three times what the imports of a fit leave."""


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="greybox")
@click.pass_context
def greybox(ctx: click.Context) -> None:
    """Identify vehicle models from recordings, with honest uncertainty.

    \b
    greybox data map lap.csv --out my_car.toml
    greybox data check lap.csv --columns my_car.toml
    greybox fit --model single_track --vehicle car.toml lap.csv --columns my_car.toml --out run
    greybox gap lap.csv --vehicle car.toml --columns my_car.toml --report gap.pdf
    greybox export run/fit.json --target c --out car

    Each command has examples in its --help. Defaults live in greybox.toml in the working folder, or
    in the file that $GREYBOX_CONFIG names: a table for a command, a key for an option, as in [fit] model = "lateral".
    """  # fmt: skip
    ctx.default_map = defaults_of(ctx)


def main() -> None:
    """Entry point: bad input ends with a sentence and exit code 2, Ctrl-C with 130.

    Warnings of libraries are not shown, since users cannot act on them. The commands print what users must know.
    """
    gc.set_threshold(*COLLECTED)
    atexit.register(gc.freeze)  # the process ends: nothing is collected any more
    with warnings.catch_warnings(), streams(), interrupts() as sent:
        warnings.showwarning = _discarded
        try:
            _run(sent)
            if sent:  # results so far have been kept
                _end("interrupted", INTERRUPTED)
        except Exception as error:
            _fail(error, bool(sent))
        except KeyboardInterrupt:
            _end("interrupted", INTERRUPTED)


def _discarded(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    """Discards warnings; filters that turn them into errors still do."""


def _run(sent: list[int]) -> None:
    """Run the command; report if standard output cannot be written, except to a reader that has closed its end."""
    code: str | int | None = 0
    try:
        try:
            greybox(prog_name="greybox", standalone_mode=False)
        except SystemExit as end:
            code = end.code
        sys.stdout.flush()
    except OutputFailed as error:
        drop_output()
        if not isinstance(error.reason, BrokenPipeError):
            _end(f"standard output cannot be written: {error.reason.strerror}.", 2)
    if code and not sent:
        sys.exit(code)


def _fail(error: Exception, interrupted: bool) -> None:
    """End with the message of an error.

    After an interrupt, all errors are consequences of it: libraries that it reaches, such as during their import, may
    raise errors of their own instead.
    """
    if interrupted or isinstance(error, click.Abort):
        _end("interrupted", INTERRUPTED)
    if isinstance(error, GreyboxError):
        _end(error.said(option_called), 2)
    if not isinstance(error, click.ClickException):
        raise error
    vars(error)["message"] = clean(error.message)
    error.show()
    sys.exit(2)


def _end(sentence: str, code: int) -> None:
    tell(f"greybox: {sentence}")
    sys.exit(code)
