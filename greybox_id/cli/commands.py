"""The commands, groups that import them when called, and guards on the files that their options name."""

from __future__ import annotations

import math
from contextlib import suppress
from functools import cache
from importlib import import_module
from keyword import iskeyword
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from ..base.errors import near_or_all
from ..base.extensions import COMMANDS, extensions
from ..base.guard import allow_overwriting, claim, guarding, protect

if TYPE_CHECKING:
    _Type = click.ParamType[Any]
else:  # some supported versions of click have no generic types
    _Type = click.ParamType

OVERWRITE = "--overwrite"
WRITTEN = ("--out", "--apply", "--figures", "--report", "--repair")
"""Options for files or folders to write."""


class Guarded(_Type):
    """A text parameter of any type that reports files to the guard.

    Parameters
    ----------
    own : the type.
    written : the option, if it names an output; otherwise the text may be the name of an input file.
    """

    def __init__(self, own: _Type, written: str = "") -> None:
        self.own, self.written, self.name = own, written, own.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value converted by its own type; outputs are claimed, existing input files are protected."""
        result: Any = self.own.convert(value, param, ctx)
        if self.written:
            claim(result, f"‹{self.written.removeprefix('--')}›")
        else:
            with suppress(OSError, ValueError):  # not a valid name of a file
                if Path(result).is_file():
                    protect(result)
        return result

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str | None:
        """As the parameter's own type."""
        return self.own.get_metavar(param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """As the parameter's own type."""
        return self.own.shell_complete(ctx, param, incomplete)


class Finite(click.types.FloatParamType):
    """A finite number: click's own type accepts NaN, and its ranges do not exclude it."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number, which must be finite."""
        result = float(super().convert(value, param, ctx))
        if not math.isfinite(result):
            self.fail(f"a finite number is needed, not {value}.", param, ctx)
        return result


class FiniteRange(click.FloatRange, Finite):
    """A finite number within a range, which is checked last."""


def guarded(command: click.Command) -> click.Command:
    """A command with finite numbers and guarded texts; one with outputs gets the option to overwrite."""
    if isinstance(command, click.Group):
        return command
    for param in command.params:
        if isinstance(param.type, click.FloatRange):
            param.type = FiniteRange(
                param.type.min, param.type.max, param.type.min_open, param.type.max_open, param.type.clamp
            )
        elif isinstance(param.type, click.types.FloatParamType):
            param.type = Finite()
        if isinstance(param.type, (click.types.StringParamType, click.Path)):
            param.type = Guarded(param.type, next((option for option in param.opts if option in WRITTEN), ""))
    writes = any(isinstance(param.type, Guarded) and param.type.written for param in command.params)
    if writes and not any(OVERWRITE in param.opts for param in command.params):
        command.params.append(
            click.Option(
                [OVERWRITE],
                is_flag=True,
                is_eager=True,  # before outputs are claimed
                expose_value=False,
                callback=_allow,
                help="Replace existing output files, whatever they hold; input files are never replaced.",
            )
        )
    return command


def _allow(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    del ctx, param
    if value:
        allow_overwriting()


Groups = dict[str, dict[str, tuple[str, str]]]
GROUPS: Groups = {
    "Recordings": {
        "data": ("greybox_id.cli.data", "Check recordings, map their columns, convert and join them."),
        "datasets": ("greybox_id.cli.datasets", "Fetch public recordings, or make synthetic ones."),
    },
    "Fit": {
        "models": ("greybox_id.cli.models", "List all models, or describe one."),
        "effects": ("greybox_id.cli.models", "List all effects that can be added to a model, or describe one."),
        "fit": ("greybox_id.cli.fit", "Fit a model to recordings."),
        "validate": ("greybox_id.cli.validate", "Score a fit on recordings."),
        "profile": ("greybox_id.cli.profile", "Compute profile likelihoods of a fit's parameters."),
        "sample": ("greybox_id.cli.sample", "Draw samples from the posterior of a fit's parameters."),
        "predict": ("greybox_id.cli.predict", "Predict the outputs in a recording with a fit."),
        "simulate": ("greybox_id.cli.predict", "Simulate a fit or a model with the inputs in a recording."),
        "grid": ("greybox_id.cli.grid", "Fit a network with many combinations of settings, and choose one."),
        "adapt": ("greybox_id.cli.adapt", "Adapt a fit to a changed car, with a few seconds of a new recording."),
        "report": (
            "greybox_id.cli.report",
            "Write a report with figures on a fit, a gap or the estimates of a filter.",
        ),
    },
    "Gap": {
        "gap": ("greybox_id.cli.gap", "Find where a simulation deviates from the vehicle, and which effects cause it."),
        "design": ("greybox_id.cli.design", "Design the manoeuvre that is most informative to drive next."),
    },
    "Estimate": {
        "track": ("greybox_id.cli.track", "Estimate sideslip, tyre parameters and forces over a recording."),
    },
    "Deploy": {
        "export": ("greybox_id.cli.export", "Write a model for a controller: C, CasADi, acados, ONNX, f1tenth."),
    },
    "This tool": {
        "completion": (
            "greybox_id.cli.options",
            "Print a script for your shell, which then completes commands, options and names.",
        ),
    },
}
"""Heading -> command -> module, and line of help."""
LAST = "This tool"
"""The last heading, after those of installed packages."""
_SHIPPED = {name: entry for commands in GROUPS.values() for name, entry in commands.items()}


@cache
def groups() -> Groups:
    """Return `GROUPS` with the commands of installed packages; commands about this tool itself come last."""
    merged = {heading: dict(commands) for heading, commands in GROUPS.items()}
    for table in extensions(COMMANDS).values():
        for heading, commands in table.items():
            merged.setdefault(heading, {}).update({k: v for k, v in commands.items() if k not in _SHIPPED})
    return merged | {LAST: merged.pop(LAST)}


def entry_of(name: str) -> tuple[str, str] | None:
    """Module and line of help of a command; installed packages are searched only for commands that are not shipped."""
    return _SHIPPED.get(name) or {k: v for commands in groups().values() for k, v in commands.items()}.get(name)


def command_names() -> list[str]:
    """All names, in the order of the help."""
    return [name for commands in groups().values() for name in commands]


OTHERWISE = {"validation": "validate", "effects": "with", "settings": "set"}
"""Arguments of functions -> options with other names."""


def option_called(argument: str) -> str:
    """The option for an argument of a function."""
    return f"--{OTHERWISE.get(argument, argument).replace('_', '-')}"


class CommandGroup(click.Group):
    """Commands of a group; a wrong name is answered with similar ones, and outputs can be overwritten."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command with a name."""
        command = super().get_command(ctx, cmd_name)
        return None if command is None else guarded(command)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is called, or an error with the nearest names."""
        if not args[0].startswith("-") and not ctx.resilient_parsing and self.get_command(ctx, args[0]) is None:
            known = self.list_commands(ctx)
            raise click.UsageError(f"There is no command {args[0]!r}.{near_or_all(args[0], known)}", ctx)
        return super().resolve_command(ctx, args)


class LazyGroup(CommandGroup):
    """All commands under their headings; a command's module is imported when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All names, in the order of the help."""
        return command_names()

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command with a name, from its imported module."""
        entry = entry_of(cmd_name)
        if entry is None:
            return None
        name = f"{cmd_name}_" if iskeyword(cmd_name) else cmd_name
        command = getattr(import_module(entry[0]), name)
        assert isinstance(command, click.Command)
        return guarded(command)

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run a command, with protection of its inputs and of files of other kinds from being overwritten."""
        with guarding():
            return super().main(*args, **extra)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Matching names and options, without importing modules."""
        result = [
            CompletionItem(name, help=about)
            for commands in groups().values()
            for name, (_, about) in commands.items()
            if name.startswith(incomplete)
        ]
        return [*result, *click.Command.shell_complete(self, ctx, incomplete)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the headings with their commands in aligned columns."""
        width = max(map(len, command_names()))
        for heading, commands in groups().items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(width), about) for name, (_, about) in commands.items()])
