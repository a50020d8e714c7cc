"""`greybox sample`: draws from the posterior of a fit's parameters."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Literal

from .options import FILE, FROM_ZERO, JSON_AND_OWN, argument, command, option
from .output import console, print_json, progress, show

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in other commands; draws so far are kept."""


@command("sample")
def sample(
    fit_file: str = argument("FIT", type=FILE),
    files: Sequence[str] = argument("[RECORDING...]", type=FILE),
    method: Literal["laplace", "mcmc", "abc-smc"] = option(
        "laplace: draw from a normal distribution with the fit's covariance; mcmc: from likelihood and priors; "
        "abc-smc: keep draws whose simulations are close to the recordings.",
        default="mcmc",
    ),
    draws: int = option("Number of draws (for abc-smc: of particles).", default=2000),
    seed: int = option("Seed of all random numbers.", type=FROM_ZERO, default=0),
    distance: Literal["pooled", "trajectories"] = option(
        "Distance between recordings and simulations, for abc-smc. pooled: over all rows together; trajectories: the "
        "mean of the distances of the runs.",
        default="pooled",
    ),
    columns: str | None = option("Column map; default: the one that the fit names.", "MAP"),
    out: str = option(
        "Table of the draws, a .parquet file; an interrupted run continues from it.",
        "FILE",
        default="posterior.parquet",
    ),
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Draw samples from the posterior of FIT's free parameters.

    The training recordings of FIT are read from their former paths, or from RECORDING if they were moved; they must be
    unchanged. After an interruption the same command continues. With a larger --draws, mcmc adds draws to the file.

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
