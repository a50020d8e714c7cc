"""`greybox fit`: from recordings and the name of a model to a fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from ..choices.parameters import noise_of
from ..choices.wanted import doubts, must_be_recorded, must_suit_options
from ..datasets.read import read
from ..engine.motion.shooting import Starts
from ..files import ensure_writable
from ..fitting import How, Solver
from ..fitting import fit as fit_model
from ..motion_model import MotionModel
from ..recording import join
from ..scores.prediction import must_suit
from .defaults import command_line
from .fit_output import show, summary
from .model_options import model_options, wanted
from .options import columns_option, jobs_option, json_option
from .output import console, print_json, progress


@click.command(name="fit")
@click.argument("files", nargs=-1, required=True, metavar="RECORDING...", type=click.Path())
@model_options
@columns_option
@click.option(
    "--validate",
    "validation",
    metavar="RECORDING",
    type=click.Path(),
    help="A recording to score on; it chooses nothing, but for --early-stopping.",
)
@click.option("--out", default=None, metavar="FOLDER", help="Folder for fit.json; default: the model's name.")
@click.option(
    "--horizon",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Predict so far from one start; default: whole runs.",
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
    help="Factor on the priors of the weights, instead of choosing it.",
)
@click.option(
    "--solver",
    type=click.Choice(["auto", "gauss-newton", "ipopt"]),
    default="auto",
    show_default=True,
    help="auto: Gauss-Newton finds, Ipopt certifies.",
)
@click.option("--starts", type=click.IntRange(1, 1000), default=1, show_default=True, help="Starting points tried.")
@jobs_option
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@json_option
def fit(
    files: Sequence[str],
    columns: str,
    validation: str | None,
    out: str | None,
    horizon: float | None,
    start_from: Starts,
    robust: float | None,
    noise: Sequence[str],
    early_stopping: bool,
    strength: float | None,
    solver: Solver,
    starts: int,
    jobs: int,
    seed: int,
    as_json: bool,
    **asked: Any,
) -> None:
    """Fit a model to one or more RECORDINGs.

    \b
    greybox fit --model single_track lap1.csv lap2.csv --vehicle roboracer --columns roboracer
    greybox fit --model lateral lap.csv --vehicle car.toml --with steering_delay --fix m=3.5kg --prior B_f=6±3
    greybox fit --model msnn_full train.csv --columns roboracer --validate valid.csv --out run
    greybox fit --model hybrid_force step*.csv sine*.csv --vehicle simrod --columns canonical

    Numbers may carry a unit; without one they are SI. Where weights of a model with memory are held to priors, how
    strongly is chosen by blocked cross-validation on the training data, unless --early-stopping or --strength says
    otherwise. Ctrl-C keeps the best so far.
    """  # fmt: skip
    if early_stopping and strength is not None:
        raise click.UsageError("--early-stopping and --strength exclude each other.")
    if early_stopping and solver == "ipopt":
        raise click.UsageError("--early-stopping watches Gauss-Newton's steps; leave --solver ipopt away.")
    if early_stopping and validation is None:
        raise click.UsageError("--early-stopping needs --validate RECORDING.")
    chosen = wanted(**asked)
    given = {
        "--horizon": horizon, "--start-from": start_from != "free", "--robust": robust, "--noise": noise,
        "--early-stopping": early_stopping, "--strength": strength,
    }  # fmt: skip
    nominal = chosen.model()  # what is wrong with it is better said before recordings are read than after
    must_suit_options(nominal, [option for option, said in given.items() if said])
    sensors = noise_of(noise, nominal)
    recordings = [read(file, columns) for file in files]
    validate = read(validation, columns) if validation is not None else None
    seen = [*recordings, *([validate] if validate is not None else [])]
    must_be_recorded(nominal, seen)
    models = chosen.models(join(recordings, "training data"))
    if horizon is not None:
        must_suit(horizon, recordings)
    how = How(
        strengths="early stopping" if early_stopping else strength if strength is not None else "cross-validation",
        solver=solver,
        starts=starts,
        seed=seed,
        jobs=jobs,
        horizon=horizon,
        start_from=start_from,
        robust=robust,
        noise=sensors,
    )
    command = command_line()
    target = Path(out or models[0].name) / "fit.json"
    ensure_writable(target.parent)
    warnings = doubts(models[0], chosen.vehicle, recordings)
    with progress() as say:
        for warning in warnings:
            say(f"warning: {warning}")
        result = fit_model(models, recordings, validate=validate, how=how, say=say, command=command)
    path = result.save(target)
    vehicle = chosen.vehicle.name if chosen.vehicle is not None else ""
    if as_json:
        print_json(summary(result) | {"vehicle": vehicle or None, "warnings": warnings, "written": str(path)})
        return
    show(result, vehicle)
    figures = f"   figures and report: greybox report {path}"
    console().print(f"\nwritten  {path}{figures}")
    if isinstance(result.model, MotionModel):
        console().print(f"         on other recordings: greybox validate {path}")
