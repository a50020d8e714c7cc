"""`greybox export`: a model for a controller or simulator elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ..api.handing_over import identifier, moving
from ..base.errors import BadInput
from ..base.numbers import pretty_unit
from ..export.elsewhere import Exporter, ForeignResult, exporter_of_file
from ..export.subject import Subject
from ..export.verb import ALONE, TARGETS, cautions, origins
from ..export.verb import export as export_model
from ..fitting.choices.parameters import Choices, Magnitudes, magnitudes, with_choices
from ..models.model import Model
from ..models.registry import with_effects
from ..reports.text.screen import plain
from .completion import names
from .defaults import command_line
from .options import fit_of, json_option, own_option, parameter_values, requested, simulated_model_options
from .output import console, end_by, print_json, working
from .terminal import tell


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
@click.option("--name", "called", metavar="NAME", help="Name of files and functions; default: that of FOLDER.")
@own_option
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
    **options: Any,
) -> None:
    """Write FIT, or a model made from options, as code or parameter files for other tools.

    A policy's file in the place of FIT is written as C or ONNX.

    \b
    greybox export run/fit.json --target c --out car
    greybox export --vehicle car_closed.toml --target casadi --out car
    greybox export --vehicle roboracer --with steering_delay=30ms --target c --out racer
    greybox export --vehicle full_size_car --with steering_lag=50ms --target fmu --out car
    """  # fmt: skip
    command = command_line()
    if Path(out).suffix in (".fmu", ".tir", ".yaml", ".mat", ".zip") and Path(out).suffix != ALONE.get(target):
        raise BadInput(f"{out}: a target writes a folder; name one with --out, such as {Path(out).with_suffix('')}.")
    name = called or identifier(out)
    exporter = exporter_of_file(fit_file) if fit_file is not None and Path(fit_file).is_file() else None
    if exporter is not None and fit_file is not None:
        if any(options.values()) or effects or fix or parameters != "free":
            raise click.UsageError(f"A {exporter.what} is exported as it is: omit the options of models.")
        _elsewhere(exporter, ForeignResult(name, fit_file, command), target, out, as_json)
        return
    if fit_file is not None:
        if any(options.values()):
            raise click.UsageError("Name a FIT, or make a model with --model and --vehicle, but not both.")
        fit = fit_of(fit_file)
        model = with_choices(with_effects(fit.model, magnitudes(effects)), Choices(**parameter_values(fix)))
        subject = Subject(model, name, moving(model, parameters), fit, fit_file, command)
    else:
        if not any(options.values()):
            raise click.UsageError("Name a FIT, or a model with --vehicle or --model.")
        meant = requested(**options, effects=effects, fix=fix).or_single_track()
        model = meant.model()
        source = options["vehicle"] or model.name
        subject = Subject(model, name, moving(model, parameters), None, source, command, meant.vehicle)
    verdict = subject.fit.verdict if subject.fit is not None else None
    for sentence in (*_assumed(model, magnitudes(effects)), *cautions(subject, target)):
        tell(f"warning: {sentence}")
    with working(f"writing {out}"):
        written = export_model(subject, target, out)
    if as_json:
        print_json(
            {
                "target": target,
                "name": name,
                "model": model.name,
                "written": [str(file) for file in written],
                "keys": [origin.plain() for origin in origins(subject, target)],
            }
        )
    else:
        console().print(f"{model.name} for {target}: {TARGETS[target]}")
        for file in written:
            console().print(f"written  {file}")
    end_by(verdict)


def _elsewhere(exporter: Exporter, named: ForeignResult, target: str, out: str, as_json: bool) -> None:
    """Write a result that is no model."""
    with working(f"writing {out}"):
        written = exporter.write(exporter.load(named.source), named, target, out)
    if as_json:
        files = [str(file) for file in written]
        print_json({"target": target, "name": named.name, "model": exporter.what, "written": files, "keys": []})
        return
    console().print(f"{exporter.what} for {target}: {exporter.targets[target]}")
    for file in written:
        console().print(f"written  {file}")


def _assumed(model: Model, stated: Magnitudes) -> list[str]:
    """Sentences on effects that stand at a magnitude nobody told."""
    return [
        f"{name} is taken at {plain(float(model[name].array))} {pretty_unit(model[name].unit)}, its typical size; "
        f"state it with --with {name}=VALUE."
        for name, magnitude in stated.items()
        if magnitude is None
    ]
