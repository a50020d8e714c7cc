"""What options and arguments of a command name: a place that is written, or what may be a file that is read."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from ..guard import allow_overwriting, claim, protect

if TYPE_CHECKING:
    _Type = click.ParamType[Any]
else:  # not every click that will do has generic types
    _Type = click.ParamType

OVERWRITE = "--overwrite"
WRITTEN = ("--out", "--apply", "--figures", "--report")
"""Options that name a file or folder to be written."""


class Guarded(_Type):
    """A text as its own type takes it, which the guard is told of.

    Parameters
    ----------
    own : the type.
    written : the option, where it names what is written; else the text may be the name of a file that is read.
    """

    def __init__(self, own: _Type, written: str = "") -> None:
        self.own, self.written, self.name = own, written, own.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """What the own type makes of it; claimed as an output, or kept from being written over if it is a file."""
        found: Any = self.own.convert(value, param, ctx)
        if self.written:
            claim(found, f"‹{self.written.removeprefix('--')}›")
        else:
            with suppress(OSError, ValueError):  # no name that a file can have
                if Path(found).is_file():
                    protect(found)
        return found

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str | None:
        """As the own type."""
        return self.own.get_metavar(param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """As the own type."""
        return self.own.shell_complete(ctx, param, incomplete)


def guarded(command: click.Command) -> click.Command:
    """A command whose texts the guard is told of; one that writes can be told to overwrite."""
    if isinstance(command, click.Group):
        return command
    for own in command.params:
        if isinstance(own.type, (click.types.StringParamType, click.Path)):
            own.type = Guarded(own.type, next((option for option in own.opts if option in WRITTEN), ""))
    writes = any(isinstance(own.type, Guarded) and own.type.written for own in command.params)
    if writes and not any(OVERWRITE in own.opts for own in command.params):
        command.params.append(
            click.Option(
                [OVERWRITE],
                is_flag=True,
                is_eager=True,  # before places are claimed
                expose_value=False,
                callback=_allow,
                help="Replace what is there even if it is something else; never what is read.",
            )
        )
    return command


def _allow(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    del ctx, param
    if value:
        allow_overwriting()
