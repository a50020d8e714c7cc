"""`greybox export`: a model for a controller or simulator elsewhere."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from ..choices.parameters import Choices, Magnitudes, magnitudes, with_choices
from ..choices.wanted import Wanted
from ..errors import BadInput
from ..export.subject import Subject
from ..export.verb import TARGETS, cautions
from ..export.verb import export as export_model
from ..fit import load
from ..model import Model
from ..models.registry import build, with_effects
from ..reports.numbers import pretty_unit
from .completion import names
from .defaults import command_line
from .model_options import simulated_model_options, wanted
from .options import json_option
from .output import console, plain, print_json


@click.command(name="export")
@click.argument("fit_file", required=False, metavar="[FIT]", type=click.Path())
@simulated_model_options
@click.option(
    "--target", required=True, metavar="TARGET", shell_complete=names(TARGETS), help=f"One of {', '.join(TARGETS)}."
)
@click.option("--out", required=True, metavar="FOLDER", help="Folder to write; an earlier export there is replaced.")
@click.option(
    "--parameters",
    default="free",
    show_default=True,
    metavar="free|all|NAME,...",
    help="What can be changed afterwards; everything else becomes a constant, which makes the code faster.",
)
@click.option(
    "--name", "called", metavar="NAME", help="What files and functions are called; after FOLDER unless given."
)
@json_option
def export(
    fit_file: str | None,
    target: str,
    out: str,
    parameters: str,
    called: str | None,
    as_json: bool,
    effects: tuple[str, ...],
    fix: tuple[str, ...],
    **asked: Any,
) -> None:
    """Write FIT, or a model made from options, as code for a controller.

    \b
    greybox export run/fit.json --target c --out car
    greybox export --vehicle car_closed.toml --target casadi --out car
    greybox export --vehicle roboracer --with steering_delay=30ms --target c --out racer
    """  # fmt: skip
    command = command_line()
    name = called or _identifier(out)
    if fit_file is not None:
        if any(asked.values()):
            raise click.UsageError("Name a FIT, or make a model with --model and --vehicle, but not both.")
        fit = load(fit_file, build)
        model = with_choices(with_effects(fit.model, magnitudes(effects)), Choices(fix=fix))
        subject = Subject(model, name, _moving(model, parameters), fit, fit_file, command)
    else:
        if not any(asked.values()):
            raise click.UsageError("Name a FIT, or a model with --vehicle or --model.")
        meant = _or_single_track(wanted(**asked, effects=effects, fix=fix))
        model = meant.model()
        source = asked["vehicle"] or model.name
        subject = Subject(model, name, _moving(model, parameters), None, source, command, meant.vehicle)
    for sentence in (*_assumed(model, magnitudes(effects)), *cautions(subject, target)):
        click.echo(f"warning: {sentence}", err=True)
    written = export_model(subject, target, out)
    if as_json:
        print_json({"target": target, "name": name, "model": model.name, "written": [str(file) for file in written]})
        return
    console().print(f"{model.name} for {target}: {TARGETS[target]}")
    for file in written:
        console().print(f"written  {file}")


def _or_single_track(asked: Wanted) -> Wanted:
    """What is wanted; of a vehicle that names no model, a single track."""
    open_to_us = asked.name is None and asked.vehicle is not None and asked.vehicle.model is None
    return replace(asked, name="single_track") if open_to_us else asked


def _moving(model: Model, asked: str) -> tuple[str, ...] | None:
    if asked == "all":
        return None
    if asked == "free":
        return tuple(p.name for p in model.parameters if not p.fixed)
    return tuple(name.strip() for name in asked.split(",") if name.strip())


def _assumed(model: Model, stated: Magnitudes) -> list[str]:
    """Sentences on effects that stand at a magnitude nobody told."""
    return [
        f"{name} is taken at {plain(float(model[name].array))} {pretty_unit(model[name].unit)}, its typical size; "
        f"state it with --with {name}=VALUE."
        for name, magnitude in stated.items()
        if magnitude is None
    ]


def _identifier(folder: str) -> str:
    """A folder's name as far as it can name functions of C."""
    found = re.sub(r"\W+", "_", Path(folder).resolve().name.lower(), flags=re.ASCII).strip("_")
    if not found:
        raise BadInput(f"No function can be called after the folder {folder}; name them with --name.")
    return found if found[0].isalpha() else f"model_{found}"
