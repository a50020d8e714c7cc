"""`greybox fit`: from recordings and the name of a model to a fit."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.table import Table

from ..datasets.read import read
from ..files import ensure_writable
from ..fit import Fit
from ..fitting import How, Solver
from ..fitting import fit as fit_model
from ..models.registry import MODELS, candidates
from ..parameter import Parameter, Prior
from ..recording import join
from .options import columns_option, json_option, settings_of
from .output import console, errors_table, print_json, progress


@click.command(name="fit")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path())
@click.option("--model", "name", required=True, metavar="NAME", help=f"One of {', '.join(MODELS)}.")
@columns_option
@click.option(
    "--validate",
    "validation",
    metavar="FILE",
    help="A recording to score on; it chooses nothing, but for --early-stopping.",
)
@click.option("--out", default=None, metavar="DIR", help="Folder for fit.json; default: the model's name.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A hyperparameter, such as lat.q=14.")
@click.option("--with", "effects", multiple=True, metavar="EFFECT=VALUE", help="Add an effect, held at a magnitude.")
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
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@json_option
def fit(
    files: Sequence[str],
    name: str,
    columns: str,
    validation: str | None,
    out: str | None,
    settings: Sequence[str],
    effects: Sequence[str],
    early_stopping: bool,
    strength: float | None,
    solver: Solver,
    starts: int,
    seed: int,
    as_json: bool,
) -> None:
    """Fit a model to one or more recordings FILE...

    \b
    greybox fit --model msnn_full train.csv --columns roboracer --validate valid.csv --out run

    The strength of regularisation is chosen by blocked cross-validation on the training data, unless
    --early-stopping or --strength says otherwise. Ctrl-C keeps the best so far.
    """
    if early_stopping and strength is not None:
        raise click.UsageError("--early-stopping and --strength exclude each other.")
    if early_stopping and solver == "ipopt":
        raise click.UsageError("--early-stopping watches Gauss-Newton's steps; leave --solver ipopt away.")
    if early_stopping and validation is None:
        raise click.UsageError("--early-stopping needs --validate FILE.")
    recordings = [read(file, columns) for file in files]
    validate = read(validation, columns) if validation is not None else None
    models = candidates(name, join(recordings, "training data"), settings_of(settings), settings_of(effects))
    how = How(
        strengths="early stopping" if early_stopping else strength if strength is not None else "cross-validation",
        solver=solver,
        starts=starts,
        seed=seed,
    )
    command = shlex.join(["greybox", *sys.argv[1:]])
    target = Path(out or name) / "fit.json"
    ensure_writable(target.parent)
    with progress() as say:
        result = fit_model(models, recordings, validate=validate, how=how, say=say, command=command)
    path = result.save(target)
    if as_json:
        print_json(summary(result) | {"written": str(path)})
    else:
        show(result)
        console().print(f"\nwritten  {path}   figures and report: greybox report {path}")


def summary(result: Fit) -> dict[str, Any]:
    """The fit as one JSON object: metrics, CPU time, sizes, how it was chosen."""
    seconds = {_key(stage.model, stage.closed_loop): stage.cpu_seconds for stage in result.stages}
    body = result.as_dict()
    return {
        "model": body["model"],
        "mode": result.mode,
        "metrics": body["metrics"],
        "cpu_seconds": seconds | {"cross_validation": sum(s.cross_validation_seconds for s in result.stages)},
        "parameters": {_key(part.name, False): part.size for part in result.model.parts or (result.model,)}
        | ({"full": result.model.size} if result.model.parts else {}),
        "stages": body["stages"],
        "physical": {p.name: body["parameters"][p.name] for p in result.model.parameters if p.shape == ()},
        "notes": body["notes"],
        "together": body["together"],
        "per_run": body["per_run"],
        "data": body["data"],
        "seed": result.seed,
        "version": result.version,
    }


def show(result: Fit) -> None:
    """Print a fit for people."""
    out = console()
    for record in result.data:
        out.print(
            f"{record.role:9}{record.name}: {record.runs} runs, {record.duration:.1f} s, {record.samples} samples"
        )
    for stage in result.stages:
        loop = ", closed loop" if stage.closed_loop else ""
        out.print(f"fit      {stage.model}{loop}: {stage.steps} steps, {stage.cpu_seconds:.2f} s; {stage.status}")
        if stage.certificate is not None:
            c = stage.certificate
            out.print(
                f"         {'certified' if c.confirmed else 'not certified'} by Ipopt: {c.status}, {c.iterations} "
                f"iterations, objective {100 * c.gained:.2g} % lower, gradient {c.gradient:.1e}"
            )
    strengths = ", ".join(f"{k} {v:g}" for s in result.stages if not s.closed_loop for k, v in s.strengths.items())
    out.print(f"priors   strengths {strengths or 'as stated'} ({result.mode})\n")
    if any(p.shape == () for p in result.model.parameters):
        out.print(_parameters(result))
        out.print()
    for sentence in result.model.together:
        out.print(f"together {sentence}")
    out.print()
    out.print(errors_table(result.metrics))


def _parameters(result: Fit) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title in ("parameter", "estimate", "95 % interval", "unit", "prior", "note"):
        table.add_column(title, header_style="dim")
    notes = result.notes()
    for p in (p for p in result.model.parameters if p.shape == ()):
        value, sd = float(p.array), float(result.sd[p.name])
        low, high = (max(value - 1.96 * sd, p.bounds[0]), min(value + 1.96 * sd, p.bounds[1]))
        interval = "–" if p.fixed else f"[{low:.3g}, {high:.3g}]"
        prior = "" if p.prior is None else _prior(p, p.prior)
        table.add_row(p.name, f"{value:.4g}", interval, p.unit, prior, notes.get(p.name, ""))
    return table


def _prior(parameter: Parameter, prior: Prior) -> str:
    """What was believed of a number: mean and standard deviation."""
    mean = parameter.array if prior.mean is None else np.asarray(prior.mean, dtype=float)
    return f"{float(mean):.3g} ± {float(np.asarray(prior.sd)):.2g}"


def _key(model: str, closed_loop: bool) -> str:
    return "full" if closed_loop else model.removeprefix("msnn_")
