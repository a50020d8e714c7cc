"""`greybox design`: the manoeuvre to be driven next, so that parameters get precise or explanations come apart."""

from __future__ import annotations

from typing import Literal

import click

from ..api.designing import GOALS, as_dict, targets
from ..api.designing import design as designed
from .options import json_option, own_option
from .output import console, print_json, progress, show


@click.command(name="design")
@click.argument("source", metavar="FIT|GAP", type=click.Path())
@click.option("--goal", type=click.Choice(GOALS), help="Default: precision for a FIT, discriminate for a GAP.")
@click.option("--arena", required=True, metavar="ARENA", help="straight:120x8, disc:30 (m), or OUTLINE.csv with x, y.")
@click.option(
    "--parameters",
    default="",
    metavar="NAMES",
    help=("Parameters to estimate precisely, such as I_z,B_f; default: all free ones."),
)
@click.option(
    "--criterion", type=click.Choice(["d", "a", "e", "c"]), default="d", show_default=True,
    help="Makes small: the covariance's determinant (d), the mean variance (a), the variance of the worst"
    " combination (e), or that of the first of NAMES (c).",
)  # fmt: skip
@click.option("--duration", type=float, default=20.0, show_default=True, metavar="SECONDS", help="At most.")
@click.option("--rate", type=float, default=50.0, show_default=True, metavar="HZ", help="Rows of the plan per second.")
@click.option("--limits", metavar="FILE", type=click.Path(), help="TOML file: steer_max, speed_max, sideslip_max ...")
@click.option("--vehicle", metavar="NAME|FILE", help="Vehicle whose steer_max is the limit, unless LIMITS states one.")
@click.option("--speed-max", type=float, metavar="M/S", help="Highest speed that is allowed.")
@click.option("--grip", type=float, metavar="SHARE", help="Largest share of an axle's friction to use; default: 0.85.")
@click.option("--repeat", type=int, default=1, show_default=True, help="How often the manoeuvre will be driven.")
@click.option(
    "--driver/--open-loop", default=True, show_default=True,
    help="A driver corrects speed and path, or the planned commands are given unchanged.",
)  # fmt: skip
@click.option(
    "--effort", type=float, default=1.0, show_default=True, help=("Time to spend on the search: 2 is twice the usual.")
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@click.option(
    "--out", default="design", show_default=True, metavar="FOLDER", help="Folder for plan.csv, plan.svg, design.json."
)
@own_option
@json_option
def design(
    *, source: str, goal: Literal["precision", "discriminate", "detect"] | None, arena: str, parameters: str,
    criterion: str, duration: float, rate: float, limits: str | None, vehicle: str | None,
    speed_max: float | None, grip: float | None, repeat: int, driver: bool,
    effort: float, seed: int, out: str, as_json: bool,
) -> None:  # fmt: skip
    """Design the manoeuvre that tells most: about parameters of FIT, or about which explanation of GAP is true.

    \b
    greybox design run/fit.json --goal precision --parameters I_z,B_f --arena disc:40 --duration 20 --out next
    greybox design gap/gap.json --goal discriminate --arena straight:120x8 --out next
    greybox simulate --vehicle car.toml next/plan.csv

    The plan keeps to the arena, to friction and to sideslip for 95 % of what is held possible.
    """  # fmt: skip
    place = targets(out)
    names = tuple(name.strip() for name in parameters.split(",") if name.strip())
    with progress() as say:
        result = designed(
            source, goal, arena=arena, parameters=names, criterion=criterion, duration=duration, rate=rate,
            limits=limits, vehicle=vehicle, speed_max=speed_max, grip=grip, repeat=repeat, driver=driver,
            effort=effort, seed=seed, progress=say,
        )  # fmt: skip
    written = result.save(place)
    if as_json:
        print_json(as_dict(result, written))
        return
    show(result.parts())
    for path in written:
        console().print(f"written  {path}")
