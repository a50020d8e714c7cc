"""`greybox sample`: draws of the posterior of a fit's parameters."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import click

from .options import json_option, own_option
from .output import console, print_json, progress, show

INTERRUPTED = 130
"""Exit code after Ctrl-C, as of other commands; what there is was kept."""


@click.command(name="sample")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("files", nargs=-1, metavar="[RECORDING...]", type=click.Path())
@click.option(
    "--method",
    type=click.Choice(["laplace", "mcmc", "abc-smc"]),
    default="mcmc",
    show_default=True,
    help=(
        "Draw from the fit's covariance (laplace), from likelihood and priors (mcmc), or by distances alone (abc-smc)."
    ),
)
@click.option("--draws", type=int, default=2000, show_default=True, help="Number of draws; of particles for abc-smc.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@click.option(
    "--distance",
    type=click.Choice(["pooled", "trajectories"]),
    default="pooled",
    show_default=True,
    help="abc-smc: distance over all rows, or the mean of the trajectories' distances.",
)
@click.option("--columns", metavar="MAP", help="Column map; default: the one that the fit names.")
@click.option(
    "--out",
    default="posterior.parquet",
    show_default=True,
    metavar="FILE",
    help="A .parquet file; an interrupted run continues from it.",
)
@own_option
@json_option
def sample(
    fit_file: str,
    files: Sequence[str],
    method: Any,
    draws: int,
    seed: int,
    distance: Any,
    columns: str | None,
    out: str,
    as_json: bool,
) -> None:
    """Draw from the posterior of FIT's free parameters.

    The recordings are those FIT was trained on, read again from where it found them unless RECORDING... names their
    new places; their hashes are compared. A run that was interrupted, or killed, goes on where it was when the same
    command is given again; more --draws of mcmc go on as well.

    \b
    greybox sample run/fit.json --draws 2000 --out posterior.parquet
    greybox sample run/fit.json --method laplace --draws 10000
    """  # fmt: skip
    from ..api.sampling import posterior_target, sampled
    from ..fitting.posterior.verb import SampleOptions, must_suit_sampling
    from .options import MOVED, fit_of

    target = posterior_target(out)
    options = SampleOptions(method, draws, seed, distance)
    fit = fit_of(fit_file)
    must_suit_sampling(fit)
    read = fit.seen("train", moved={"train": files}, columns=columns, otherwise=MOVED)
    with progress() as say:
        result = sampled(fit, read, options, target, say)
    if as_json:
        print_json(result.as_dict() | {"written": str(target)})
    else:
        show(result.parts())
        console().print(f"\nwritten  {target}")
    if not result.complete:
        sys.exit(INTERRUPTED)
