"""`greybox profile`: how far parameters of a fit can move while all others make up for it."""

from __future__ import annotations

from collections.abc import Sequence

import click

from ..api.profiles import profiles, profiles_target
from ..fitting.holding import profiled
from .options import MOVED, fit_of, jobs_option, json_option, own_option
from .output import console, print_json, progress, show


@click.command(name="profile")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("files", nargs=-1, metavar="[RECORDING...]", type=click.Path())
@click.option("--parameter", "names", multiple=True, metavar="NAME", help="A free parameter; repeatable.")
@click.option("--all", "everything", is_flag=True, help="Every free parameter.")
@click.option(
    "--confidence",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.95,
    show_default=True,
    help="Of the intervals.",
)
@click.option("--columns", metavar="MAP", help="Column map; default: the one that the fit names.")
@jobs_option
@click.option("--out", metavar="FILE", help="Write the curves there: a .csv or .parquet file.")
@own_option
@json_option
def profile(
    fit_file: str,
    files: Sequence[str],
    names: Sequence[str],
    everything: bool,
    confidence: float,
    columns: str | None,
    jobs: int,
    out: str | None,
    as_json: bool,
) -> None:
    """Profile parameters of FIT: the interval in which the fit stays good, all other parameters re-optimised.

    The recordings are those FIT was trained on, read again from where it found them unless RECORDING... names their
    new places. Ctrl-C keeps the profiles that are done.

    \b
    greybox profile run/fit.json --parameter I_z --parameter B_f --out profiles.csv
    """  # fmt: skip
    target = None if out is None else profiles_target(out)
    fit = fit_of(fit_file)
    entry = profiled(fit, names, everything)
    read = fit.seen("train", moved={"train": files}, columns=columns, otherwise=MOVED)
    with progress() as say:
        result = profiles(fit, entry, read, confidence, jobs, say)
    if target is not None:
        result.save(target)
    if as_json:
        print_json(result.as_dict() | ({"written": str(target)} if target is not None else {}))
        return
    show(result.parts())
    if target is not None:
        console().print(f"\nwritten  {target}")
