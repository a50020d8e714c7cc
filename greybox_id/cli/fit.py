"""`greybox fit`: from recordings and the name of a model to a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .defaults import command_line
from .options import calibrate_option, columns_option, jobs_option, json_option, model_options, read_part, requested
from .output import console, end_by, print_json, progress, show

TYRE = "tyre"
"""What stands for a model here, though a rig has no vehicle."""
if TYPE_CHECKING:
    from ..engine.motion.shooting import Starts
    from ..fitting.how import Solver
    from ..fitting.pretraining import Span


@click.command(name="fit")
@click.argument("files", nargs=-1, required=True, metavar="RECORDING...", type=click.Path())
@model_options
@columns_option
@click.option(
    "--validate",
    "validation",
    metavar="RECORDING",
    type=click.Path(),
    help="A recording to score on; it affects the fit with --early-stopping only.",
)
@calibrate_option
@click.option("--out", default=None, metavar="FOLDER", help="Folder for fit.json; default: the model's name.")
@click.option(
    "--horizon",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Length of each prediction; default: whole runs.",
)
@click.option(
    "--start-from",
    type=click.Choice(["free", "measured"]),
    default="free",
    show_default=True,
    help="Whether starts of predictions may deviate from their readings.",
)
@click.option(
    "--robust",
    type=click.FloatRange(min=0, min_open=True),
    metavar="K",
    help="Residuals beyond K standard deviations count linearly.",
)
@click.option("--noise", multiple=True, metavar="NAME=SD", help="Standard deviation of an output's readings.")
@click.option(
    "--early-stopping", is_flag=True, help="Stop where the validation recording is fitted best (as published)."
)
@click.option(
    "--strength",
    type=click.FloatRange(min=0, min_open=True),
    help="Factor on the priors of the weights; chosen by cross-validation unless given.",
)
@click.option(
    "--solver",
    type=click.Choice(["auto", "gauss-newton", "ipopt"]),
    default="auto",
    show_default=True,
    help="auto: Gauss-Newton finds the optimum, Ipopt confirms it.",
)
@click.option(
    "--pretrain",
    metavar="FILE",
    help="mlp_lateral, bicycle_mlp: a fit or a posterior from which the network learns first; hybrid_stiffness, "
    "hybrid_force: a fit of the same model, whose training is continued.",
)
@click.option(
    "--pretrain-points",
    type=int,
    default=20_000,
    show_default=True,
    help=("Number of points at which the network learns from the fit of --pretrain."),
)
@click.option(
    "--pretrain-range",
    type=click.Choice(["data", "box"]),
    default="data",
    show_default=True,
    help="Pretrain at rows of the recordings, or in a box 1.3 times as wide.",
)
@click.option(
    "--pretrain-beyond",
    type=float,
    default=1.0,
    show_default=True,
    help="Also pretrain on the known vehicle at speeds up to this many times the fastest recorded.",
)
@click.option("--starts", type=click.IntRange(1, 1000), default=1, show_default=True, help="Starting points tried.")
@jobs_option
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@json_option
def fit(
    *,
    files: Sequence[str],
    columns: str,
    validation: str | None,
    calibrate: str | None,
    out: str | None,
    horizon: float | None,
    start_from: Starts,
    robust: float | None,
    noise: Sequence[str],
    early_stopping: bool,
    strength: float | None,
    solver: Solver,
    pretrain: str | None,
    pretrain_points: int,
    pretrain_range: Span,
    pretrain_beyond: float,
    starts: int,
    jobs: int,
    seed: int,
    as_json: bool,
    **options: Any,
) -> None:
    """Fit a model to one or more RECORDINGs.

    \b
    greybox fit --model single_track lap1.csv lap2.csv --vehicle roboracer --columns roboracer
    greybox fit --model lateral lap.csv --vehicle car.toml --with steering_delay --fix m=3.5kg --prior B_f=6±3
    greybox fit --model msnn_full train.csv --columns roboracer --validate valid.csv --out run
    greybox fit --model mlp_lateral lap1.csv lap2.csv lap3.csv --columns roboracer --pretrain lateral/fit.json
    greybox fit --model tyre rig.csv --out tyre.tir
    greybox fit --model hybrid_force step*.csv sine*.csv --vehicle simrod --columns canonical

    The model "tyre" is a magic formula of what a tyre rig measured (SA, FZ, FY); it is written as .tir.

    Numbers may carry a unit; without one they are SI. Where weights of a model with memory are held to priors, how
    strongly is chosen by blocked cross-validation on the training data, unless --early-stopping or --strength says
    otherwise. --calibrate timing aligns training runs by their delays, and scores the validation recording behind the
    seconds that tell its runs' delays. Ctrl-C keeps the best so far. Exit code 3: the fit is written, but is not
    usable; the verdict says why.
    """  # fmt: skip
    from .. import FitOptions
    from ..api.fitting import fit as fit_model  # not for --help: these load every model and the solvers
    from ..base.files import ensure_writable
    from ..base.guard import claim
    from ..base.units import pairs

    if options.get("name") == TYRE:
        from .tyre import fit_tyre_command

        fit_tyre_command(files, out, as_json)
    if early_stopping and strength is not None:
        raise click.UsageError("--early-stopping and --strength exclude each other.")
    if early_stopping and validation is None:
        raise click.UsageError("--early-stopping needs --validate RECORDING.")
    how = FitOptions(
        strengths="early stopping" if early_stopping else strength if strength is not None else "cross-validation",
        solver=solver,
        starts=starts,
        seed=seed,
        jobs=jobs,
        horizon=horizon,
        start_from=start_from,
        robust=robust,
        noise=pairs(noise, "NAME=SD, as in ‹noise› yaw_rate=0.01"),
        calibrate=calibrate,
    )
    chosen = requested(**options)
    nominal = chosen.model()  # what is wrong with it is better said before recordings are read than after
    how.must_suit(nominal)
    target = claim(Path(out or nominal.name) / "fit.json", becomes=f"a fit of {nominal.name}")
    ensure_writable(target.parent, make=False)
    recordings = [read_part(file, columns) for file in files]
    held_out = None if validation is None else read_part(validation, columns)
    with progress() as say:
        result = fit_model(
            chosen,
            recordings,
            validation=held_out,
            options=how,
            pretrain=pretrain,
            pretrain_points=pretrain_points,
            pretrain_range=pretrain_range,
            pretrain_beyond=pretrain_beyond,
            progress=say,
        )
    path = replace(result, command=command_line()).save(target)
    if as_json:
        entry = {"vehicle": result.vehicle or None, "warnings": list(result.warnings), "written": str(path)}
        print_json(result.to_json() | entry)
    else:
        show(result.parts())
        console().print(f"\nwritten  {path}   figures and report: greybox report {path}")
        console().print(f"         on other recordings: greybox validate {path}")
    end_by(result.verdict)
