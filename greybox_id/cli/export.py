"""`greybox export`: a model for a controller or simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ..api.exporting import export as export_model
from ..base.errors import BadInput
from ..export.verb import ALONE, TARGETS, exporter_of_file
from .defaults import command_line
from .options import (
    FILE,
    JSON_AND_OWN,
    SIMULATED_MODEL,
    argument,
    command,
    fit_of,
    names,
    option,
    parameter_values,
    requested,
)
from .output import console, end_by, print_json, working
from .terminal import tell


@command("export", more=SIMULATED_MODEL)
def export(
    *,
    fit_file: str | None = argument("[FIT]", type=FILE, required=False),
    target: str = option(f"One of {', '.join(TARGETS)}.", "TARGET", required=True, shell_complete=names(TARGETS)),
    out: str = option("Folder to write; an earlier export there is replaced.", "FOLDER", required=True),
    parameters: str = option(
        "Parameters that remain arguments of the code; all others become constants, which makes the code faster.",
        "free|all|NAME,...",
        default="free",
    ),
    called: str | None = option("Name of the files and functions; default: the name of FOLDER.", "NAME", name="--name"),
    as_json: bool = JSON_AND_OWN,
    effects: tuple[str, ...],
    fix: tuple[str, ...],
    **options: Any,
) -> None:
    """Write FIT, or a model made from options, as code or parameter files for other tools.

    FIT may also be a driving policy that greybox loop has trained; it is written as C or ONNX.

    \b
    greybox export run/fit.json --target c --out car
    greybox export --vehicle car_closed.toml --target casadi --out car
    greybox export --vehicle roboracer --with steering_delay=30ms --target c --out racer
    greybox export --vehicle full_size_car --with steering_lag=50ms --target fmu --out car
    """  # fmt: skip
    if Path(out).suffix in (".fmu", ".tir", ".yaml", ".mat", ".zip") and Path(out).suffix != ALONE.get(target):
        raise BadInput(f"{out}: a target writes a folder; name one with --out, such as {Path(out).with_suffix('')}.")
    exporter = exporter_of_file(fit_file) if fit_file is not None and Path(fit_file).is_file() else None
    if exporter is not None and (any(options.values()) or effects or fix or parameters != "free"):
        raise click.UsageError(f"A {exporter.what} is exported as it is: omit the options of models.")
    if fit_file is not None and any(options.values()):
        raise click.UsageError("Name a FIT, or make a model with --model and --vehicle, but not both.")
    if fit_file is None and not any(options.values()):
        raise click.UsageError("Name a FIT, or a model with --vehicle or --model.")
    more: dict[str, Any] = {"source": fit_file or options["vehicle"] or ""}
    if fit_file is None:
        model: Any = requested(**options, effects=effects, fix=fix).or_single_track()
    elif exporter is not None:
        model = Path(fit_file)
    else:
        model, more = fit_of(fit_file), more | {"effects": effects, "fix": parameter_values(fix).get("fix", ())}
    with working(f"writing {out}"):
        result = export_model(
            model, out, target=target, name=called or "", parameters=parameters, command=command_line(), **more
        )
    for sentence in result.cautions:
        tell(f"warning: {sentence}")
    if as_json:
        print_json(result.to_json())
    else:
        about = TARGETS if exporter is None else exporter.targets
        console().print(f"{result.model} exported for {target}: {about[target]}")
        for file in result:
            console().print(f"written  {file}")
    end_by(getattr(model, "verdict", None))
