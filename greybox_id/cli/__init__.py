"""The `greybox` command: a thin shell over the verbs; no logic lives here."""

from __future__ import annotations

import sys

import click

from .. import __version__
from ..errors import GreyboxError
from .commands import LazyGroup
from .defaults import defaults_of


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

    Each command has examples in its --help. What is always the same goes into greybox.toml in the working folder, or
    into the file that $GREYBOX_CONFIG names: a table for a command, a key for an option, as in [fit] model = "lateral".
    """  # fmt: skip
    ctx.default_map = defaults_of(ctx)


def main() -> None:
    """Entry point: bad input ends with a sentence and exit code 2, Ctrl-C with 130."""
    try:
        greybox(prog_name="greybox", standalone_mode=False)
    except GreyboxError as error:
        _end(str(error), 2)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt):
        _end("interrupted", 130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)


def _end(sentence: str, code: int) -> None:
    click.echo(f"greybox: {sentence}", err=True)
    sys.exit(code)
