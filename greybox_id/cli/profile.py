"""`greybox profile`: profile likelihoods of a fit's parameters."""

from __future__ import annotations

from collections.abc import Sequence

import click

from ..api.profiles import profiles, profiles_target
from ..fitting.holding import profiled
from .options import FILE, JOBS, JSON_AND_OWN, MOVED, argument, command, fit_of, option
from .output import console, print_json, progress, show


@command("profile")
def profile(
    fit_file: str = argument("FIT", type=FILE),
    files: Sequence[str] = argument("[RECORDING...]", type=FILE),
    names: Sequence[str] = option("Free parameter whose profile is computed; repeatable.", "NAME", name="--parameter"),
    everything: bool = option("Compute the profile of every free parameter.", name="--all"),
    confidence: float = option(
        "Confidence level of the intervals.", type=click.FloatRange(0, 1, min_open=True, max_open=True), default=0.95
    ),
    columns: str | None = option("Column map; default: the one that the fit names.", "MAP"),
    jobs: int = JOBS,
    out: str | None = option("Write the profiles to this .csv or .parquet file.", "FILE"),
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Compute profile likelihoods of FIT's parameters, and confidence intervals from them.

    A profile holds one parameter at a series of values and optimises all others again. The training recordings of FIT
    are read from their former paths, or from RECORDING if they were moved. Ctrl-C keeps the profiles that are done.

    \b
    greybox profile run/fit.json --parameter I_z --parameter B_f --out profiles.csv
    """  # fmt: skip
    target = None if out is None else profiles_target(out)
    fit = fit_of(fit_file)
    chosen = profiled(fit, names, everything)
    read = fit.seen("train", moved={"train": files}, columns=columns, otherwise=MOVED)
    with progress() as say:
        result = profiles(fit, chosen, read, confidence, jobs, say)
    if target is not None:
        result.save(target)
    if as_json:
        print_json(result.as_dict() | ({"written": str(target)} if target is not None else {}))
        return
    show(result.parts())
    if target is not None:
        console().print(f"\nwritten  {target}")
