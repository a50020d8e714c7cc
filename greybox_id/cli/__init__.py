"""The `greybox` command: a thin shell over the verbs; no logic lives here."""

from __future__ import annotations

import sys
from importlib import import_module
from keyword import iskeyword

import click

from .. import __version__
from ..errors import GreyboxError

COMMANDS = {
    "fit": ("fit", "Fit a model to recordings."),
    "simulate": ("predict", "Simulate a fit or a model freely on a recording's inputs."),
    "predict": ("predict", "Predict a recording with a fit."),
    "validate": ("validate", "Score a fit on recordings."),
    "export": ("export", "Write a model down for a controller: C, CasADi, acados, ONNX, f1tenth."),
    "track": ("track", "Track sideslip, tyres and forces along a recording."),
    "import": ("import_", "Make a fit of a network that nnodely saved."),
    "profile": ("profile", "Follow the likelihood along parameters of a fit."),
    "models": ("models", "List the models there are, or say what one is made of."),
    "effects": ("models", "List the effects that models may lack, or say what one is."),
    "gap": ("gap", "Say where a simulation departs from the vehicle, why, and how much of that closes."),
    "exam": ("exam", "Examine the diagnosis of gaps blindly, on vehicles whose truth is sealed."),
    "report": ("report", "Write figures and a PDF report of a fit."),
    "data": ("data", "Look at recordings before anything is fitted to them."),
}
"""Command -> module of this folder that holds it, and its line of help; loaded only when it is called."""


class _Commands(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        name = f"{cmd_name}_" if iskeyword(cmd_name) else cmd_name
        command = getattr(import_module(f".{COMMANDS[cmd_name][0]}", __name__), name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in COMMANDS.items()])


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="greybox")
def greybox() -> None:
    """Identify vehicle models from recordings, with honest uncertainty.

    \b
    greybox data check lap.csv
    greybox fit --model single_track --vehicle car.toml lap.csv --validate other_lap.csv --out run
    greybox validate run/fit.json third_lap.csv
    greybox models single_track
    """


def main() -> None:
    """Entry point: bad input ends with a sentence and exit code 2, Ctrl-C with 130."""
    try:
        greybox(standalone_mode=False)
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
