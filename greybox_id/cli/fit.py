"""`greybox fit`: fit of a model to recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import click

from ..base.interrupts import uninterrupted
from .defaults import command_line
from .options import (
    ABOVE_ZERO,
    CALIBRATE,
    COLUMNS,
    FILE,
    FROM_ZERO,
    JOBS,
    JSON,
    MODEL,
    argument,
    command,
    option,
    read_part,
    requested,
)
from .output import console, end_by, print_json, progress, show

TYRE = "tyre"
"""Used as the name of a model, though data of a rig have no vehicle."""


@command("fit", more=MODEL)
def fit(
    files: Sequence[str] = argument("RECORDING...", type=FILE, required=True),
    columns: str = COLUMNS,
    validation: str | None = option(
        "Held-out recording on which the fit is scored. It has no influence on the fit, except with --early-stopping.",
        "RECORDING",
        name="--validate",
        type=FILE,
    ),
    calibrate: str | None = CALIBRATE,
    out: str | None = option("Folder to which fit.json is written; default: the name of the model.", "FOLDER"),
    horizon: float | None = option(
        "Length of the predictions whose errors are minimised; default: whole runs.", "SECONDS", type=ABOVE_ZERO
    ),
    start_from: Literal["free", "measured"] = option(
        "Initial states of predictions. free: they are estimated and may deviate from the readings; measured: they "
        "are the readings.",
        default="free",
    ),
    robust: float | None = option(
        "Count residuals beyond K standard deviations linearly, not squared.", "K", type=ABOVE_ZERO
    ),
    noise: Sequence[str] = option(
        "Known standard deviation of the sensor noise of an output, as in yaw_rate=0.01.", "NAME=SD"
    ),
    early_stopping: bool = option(
        "Stop when the error on the validation recording is smallest, as in the paper that introduced the model."
    ),
    strength: float | None = option(
        "Only models msnn_... and gnn: factor on the strength of the priors of the weights (regularisation); default: "
        "chosen by cross-validation.",
        type=ABOVE_ZERO,
    ),
    solver: Literal["auto", "gauss-newton", "ipopt"] = option(
        "auto: Gauss-Newton finds the optimum, Ipopt confirms it.", default="auto"
    ),
    pretrain: str | None = option(
        "For mlp_lateral and bicycle_mlp: a fit or posterior of equations of motion, which the network learns first. "
        "For hybrid_stiffness and hybrid_force: a fit of the same model, whose training is continued.",
        "FILE",
    ),
    pretrain_points: int = option("Number of points at which --pretrain trains the network.", default=20_000),
    pretrain_range: Literal["data", "box"] = option(
        "data: these points are rows of the recordings; box: they lie in ranges 1.3 times as wide as those of the "
        "recordings.",
        default="data",
    ),
    pretrain_beyond: float = option(
        "With --pretrain, train also at speeds up to this factor times the highest recorded speed; 1: no higher than "
        "recorded.",
        default=1.0,
    ),
    starts: int = option(
        "Number of starting points from which the solver is run.", type=click.IntRange(1, 1000), default=1
    ),
    jobs: int = JOBS,
    seed: int = option("Seed of all random numbers.", type=FROM_ZERO, default=0),
    as_json: bool = JSON,
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

    --model tyre fits a magic formula to data of a tyre rig (columns SA, FZ, FY) and writes a .tir file.

    A number without a unit is in SI units. For networks, --calibrate timing estimates the delay of the outputs in each
    training run and corrects it before the fit. Ctrl-C keeps the best fit so far. Exit code 3: the fit is
    written, but is not usable; the verdict says why.
    """  # fmt: skip
    from .. import FitOptions
    from ..api.fitting import fit as fit_model  # not needed for --help, since it imports all models and solvers
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
    nominal = chosen.model()  # report errors in it before reading recordings
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
    with uninterrupted():
        path = replace(result, command=command_line()).save(target)
    if as_json:
        more = {"vehicle": result.vehicle or None, "warnings": list(result.warnings), "written": str(path)}
        print_json(result.to_json() | more)
    else:
        show(result.parts())
        console().print(f"\nwritten  {path}   figures and report: greybox report {path}")
        console().print(f"         to score it on other recordings: greybox validate {path} RECORDING")
    end_by(result.verdict)
