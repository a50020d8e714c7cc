"""Defaults of options from a file.

    [fit]
    model = "single_track"
    columns = "my_car.toml"
    with = ["steering_delay"]
    [data.check]
    columns = "my_car.toml"

A table is a command, a key is an option without its dashes. Options on the command line take precedence, but a switch
that is true in the file cannot be turned off.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from ..base.errors import BadInput, must_be_one_of, near_or_all
from .commands import command_names, entry_of
from .options import MARK
from .terminal import tell

FILE = "greybox.toml"
VARIABLE = "GREYBOX_CONFIG"


NAMES_CODE = ("diagnoser", "own")
"""Options that are never read from the file: code from the working folder must not run unasked."""


def defaults_of(ctx: click.Context) -> dict[str, Any]:
    """Command -> defaults of its options by parameter name, for the called command; announced on standard error.

    Raises
    ------
    BadInput : if the file cannot be read, or has an unknown command, an unknown option or an invalid value.
    """
    named = os.environ.get(VARIABLE)
    file = Path(named or FILE)
    if not named and not file.is_file():
        return {}
    from ..base.toml_file import read_toml  # not needed for --help without such a file

    table = read_toml(file, "file of defaults")
    for name in table:
        if entry_of(name) is None:
            raise BadInput(f"{file}: there is no command {name!r}.{near_or_all(name, command_names())}")
    called = ctx.invoked_subcommand
    if called is None or called not in table:
        return {}
    assert isinstance(ctx.command, click.Group)
    command = ctx.command.get_command(ctx, called)
    assert command is not None
    tell(f"defaults from {file}")
    return {called: _of_command(ctx, command, table[called], f"{file}: [{called}]")}


def command_line() -> str:
    """The command being run, with defaults from the file written out."""
    ctx = click.get_current_context(silent=True)
    words = sys.argv[1:]
    if ctx is None:
        return shlex.join(["greybox", *words])
    taken: list[str] = []
    for option in ctx.command.params:
        if option.name and ctx.get_parameter_source(option.name) is ParameterSource.DEFAULT_MAP:
            assert isinstance(option, click.Option)
            taken += _written(option, ctx.params[option.name])
    return shlex.join(["greybox", *words[:1], *taken, *words[1:]])


def _written(option: click.Option, value: Any) -> list[str]:
    """An option and its value as typed on a command line."""
    name = _long(option)
    if option.is_flag:
        return [name] if value else []
    return [word for item in (value if option.multiple else (value,)) for word in (name, str(item))]


def _of_command(ctx: click.Context, command: click.Command, table: Any, where: str) -> dict[str, Any]:
    if not isinstance(table, Mapping):
        raise BadInput(f"{where} must be a table of options, not {table!r:.60}.")
    if isinstance(command, click.Group):
        return {name: _of_command(ctx, _inner(command, name, where), item, f"{where[:-1]}.{name}]")
                for name, item in table.items()}  # fmt: skip
    options = {_long(param).removeprefix("--"): param for param in command.params if isinstance(param, click.Option)}
    result = {}
    for key, value in table.items():
        must_be_one_of(options, key, f"{where}: there is no option")
        if key in NAMES_CODE:
            raise BadInput(
                f"{where}: {key} names code to run, which a file of defaults may not do; give --{key} on the command "
                "line."
            )
        if any(isinstance(item, str) and MARK in item for item in (value if isinstance(value, list) else [value])):
            raise BadInput(
                f"{where}: {key} names a file to run, which a file of defaults may not do; give --{key} on the "
                "command line."
            )
        option = options[key]
        result[str(option.name)] = _value(ctx, option, value, f"{where} {key}")
    return result


def _inner(group: click.Group, name: str, where: str) -> click.Command:
    must_be_one_of(group.commands, name, f"{where}: there is no command")
    return group.commands[name]


def _value(ctx: click.Context, option: click.Option, value: Any, where: str) -> Any:
    """A value as the option takes it. Raises `BadInput` if it is not valid."""
    if option.is_flag:
        if not isinstance(value, bool):
            raise BadInput(f"{where} is true or false, not {value!r:.60}.")
        return value
    many = value if isinstance(value, list) else [value]
    if isinstance(value, list) and not option.multiple:
        raise BadInput(f"{where} takes one value, not the list {value!r:.60}.")
    if any(isinstance(item, bool | Mapping | list) for item in many):
        raise BadInput(f"{where} is text or a number, not {value!r:.60}.")
    words = [str(item) for item in many]
    for word in words:
        try:
            option.type.convert(word, option, ctx)
        except click.BadParameter as error:
            raise BadInput(f"{where}: {error.message}") from error
    return words if option.multiple else words[0]


def _long(option: click.Option) -> str:
    return next((name for name in option.opts if name.startswith("--")), option.opts[0])
