"""Which commands there are, and groups that load them only when they are called."""

from __future__ import annotations

from importlib import import_module
from keyword import iskeyword
from typing import Any

import click
from click.shell_completion import CompletionItem

from ..errors import near_or_all
from ..guard import guarding
from .paths import guarded

GROUPS: dict[str, dict[str, tuple[str, str]]] = {
    "Recordings": {
        "data": ("data", "Check, map and convert recordings before anything is fitted to them."),
        "datasets": ("datasets", "Fetch public recordings, or make synthetic ones."),
    },
    "Fit": {
        "models": ("models", "List the models there are, or say what one is made of."),
        "effects": ("models", "List the effects that models may lack, or say what one is."),
        "fit": ("fit", "Fit a model to recordings."),
        "validate": ("validate", "Score a fit on recordings."),
        "profile": ("profile", "Follow the likelihood along parameters of a fit."),
        "sample": ("sample", "Draw from the posterior of a fit's parameters."),
        "predict": ("predict", "Predict a recording with a fit."),
        "simulate": ("predict", "Simulate a fit or a model freely on a recording's inputs."),
        "grid": ("grid", "Fit many structures of a model with memory, and choose one."),
        "adapt": ("adapt", "Adapt a fit to a car that may have changed, by some seconds of it."),
        "report": ("report", "Write what was found as a report, with figures."),
    },
    "Gap": {
        "gap": ("gap", "Say where a simulation deviates from the vehicle, and why."),
        "design": ("design", "Design the manoeuvre to be driven next, so that it tells most."),
        "exam": ("exam", "Examine the diagnosis of gaps blindly, on sealed truths."),
    },
    "Fleet": {
        "fleet": ("fleet", "Run thousands of recordings of many vehicles; population, outliers, drift."),
    },
    "Race": {
        "loop": ("loop", "Let a learned driver adapt to its vehicle, through what gap names."),
        "serve": ("serve", "Serve vehicles that send rows, and learn policies for them."),
    },
    "Estimate": {
        "track": ("track", "Track sideslip, tyres and forces along a recording."),
    },
    "Deploy": {
        "export": ("export", "Write a model for a controller: C, CasADi, acados, ONNX, f1tenth."),
        "import": ("import_", "Make a fit of a network that nnodely saved."),
    },
    "This tool": {
        "bench": ("bench", "Make the tables of published papers again."),
        "completion": ("completion", "Print what makes a shell complete commands, options and names."),
    },
}
"""Heading -> command -> module of this folder that holds it, and its line of help."""

COMMANDS = {name: entry for group in GROUPS.values() for name, entry in group.items()}

OTHERWISE = {"validation": "validate", "effects": "with", "settings": "set"}
"""Arguments of functions whose options have other names."""


def option_called(argument: str) -> str:
    """The option that says what an argument of a function says."""
    return f"--{OTHERWISE.get(argument, argument).replace('_', '-')}"


class CommandGroup(click.Group):
    """Commands under a name, one of which may have been meant; those that write can be told to overwrite."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name."""
        command = super().get_command(ctx, cmd_name)
        return None if command is None else guarded(command)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is called; a sentence with the nearest names where there is none."""
        known = self.list_commands(ctx)
        if args[0] not in known and not args[0].startswith("-") and not ctx.resilient_parsing:
            raise click.UsageError(f"There is no command {args[0]!r}.{near_or_all(args[0], known)}", ctx)
        return super().resolve_command(ctx, args)


class LazyGroup(CommandGroup):
    """All commands under their headings; a command's module is loaded when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All names, in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name, its module loaded."""
        if cmd_name not in COMMANDS:
            return None
        name = f"{cmd_name}_" if iskeyword(cmd_name) else cmd_name
        command = getattr(import_module(f".{COMMANDS[cmd_name][0]}", __package__), name)
        assert isinstance(command, click.Command)
        return guarded(command)

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run a command; nothing that it reads is written over, nor anything of another kind."""
        with guarding():
            return super().main(*args, **extra)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Names and options that begin so; no module is loaded for it."""
        found = [
            CompletionItem(name, help=about) for name, (_, about) in COMMANDS.items() if name.startswith(incomplete)
        ]
        return [*found, *click.Command.shell_complete(self, ctx, incomplete)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the headings with their commands, columns aligned."""
        width = max(map(len, COMMANDS))
        for heading, commands in GROUPS.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(width), about) for name, (_, about) in commands.items()])
