"""Models and effects of one's own on the command line: FILE.py:NAME. Naming a file runs it, so only a person may."""

from __future__ import annotations

from collections.abc import Sequence

import click

MARK = ".py:"
"""What tells a place in a file from a name."""


def named_model(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """The name of a model: that of the model in a file, which is known from now on."""
    del ctx, param
    if value is None or MARK not in value:
        return value
    from ..models.own import own_model

    return own_model(value).name


def named_effects(ctx: click.Context, param: click.Parameter, values: Sequence[str]) -> tuple[str, ...]:
    """EFFECT[=VALUE] with the names of effects that are in files, which are known from now on."""
    del ctx, param
    found = []
    for value in values:
        place, equals, magnitude = value.partition("=")
        if MARK in place:
            from ..models.own import own_effect

            place = own_effect(place.strip()).name
        found.append(f"{place}{equals}{magnitude}")
    return tuple(found)


def named_effect(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """The name of an effect: that of the effect in a file, which is known from now on."""
    return value if value is None else named_effects(ctx, param, [value])[0]


def _known(ctx: click.Context, param: click.Parameter, values: Sequence[str]) -> None:
    del ctx, param
    for value in values:
        from ..models.own import own

        own(value)


own_option = click.option(
    "--own", multiple=True, metavar="FILE.py:NAME", expose_value=False, callback=_known, is_eager=True,
    help="A model or an effect of your own, that a fit was made with or that is to be tried; the file is run.",
)  # fmt: skip
