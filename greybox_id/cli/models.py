"""`greybox models`: what can be fitted, and what can be added to it."""

from __future__ import annotations

import click
from rich.table import Table

from ..models.registry import EFFECTS, MODELS, build
from .options import json_option
from .output import console, print_json


@click.command(name="models")
@json_option
def models(as_json: bool) -> None:
    """List the models and effects there are, with inputs, outputs and number of parameters."""
    built = {name: build(name) for name in MODELS}
    if as_json:
        print_json(
            {
                "models": {
                    name: {
                        "about": model.about,
                        "inputs": model.inputs,
                        "outputs": model.outputs,
                        "parameters": model.size,
                        "settings": dict(model.settings),
                    }
                    for name, model in built.items()
                },
                "effects": {
                    name: {"unit": effect.parameter.unit, "about": effect.parameter.about, "touches": effect.touches}
                    for name, effect in EFFECTS.items()
                },
            }
        )
        return
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title in ("model", "parameters", "inputs", "outputs", "about"):
        table.add_column(title, header_style="dim")
    for name, model in built.items():
        table.add_row(name, str(model.size), " ".join(model.inputs), " ".join(model.outputs), model.about)
    out = console()
    out.print(table)
    out.print()
    effects = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title in ("effect", "unit", "about"):
        effects.add_column(title, header_style="dim")
    for name, effect in EFFECTS.items():
        effects.add_row(name, effect.parameter.unit, effect.parameter.about)
    out.print(effects)
