"""`greybox design`: the manoeuvre to be driven next, so that parameters get precise or explanations come apart."""

from __future__ import annotations

from typing import Literal

from ..api.designing import as_dict, targets
from ..api.designing import design as designed
from .options import FILE, FROM_ZERO, JSON_AND_OWN, argument, command, option
from .output import console, print_json, progress, show


@command("design")
def design(
    source: str = argument("FIT|GAP", type=FILE),
    goal: Literal["precision", "discriminate", "detect"] | None = option(
        "Goal of the design; default: precision for a FIT, discriminate for a GAP."
    ),
    arena: str = option(
        "Free area: straight:120x8 or disc:30 (in m), or OUTLINE.csv with x and y.", "ARENA", required=True
    ),
    parameters: str = option(
        "Parameters to estimate precisely, such as I_z,B_f; default: all free ones.", "NAMES", default=""
    ),
    criterion: Literal["d", "a", "e", "c"] = option(
        "Minimises the covariance's determinant (d), the mean variance (a), the variance of the worst"
        " combination (e) or that of the first of NAMES (c).",
        default="d",
    ),
    duration: float = option("Longest duration of the manoeuvre.", "SECONDS", default=20.0),
    rate: float = option("Rows of the plan per second.", "HZ", default=50.0),
    limits: str | None = option("TOML file of limits, such as steer_max, speed_max, sideslip_max.", "FILE", type=FILE),
    vehicle: str | None = option("Vehicle whose steer_max is the limit, unless LIMITS states one.", "NAME|FILE"),
    speed_max: float | None = option("Highest speed that is allowed.", "M/S"),
    grip: float | None = option(
        "Largest share of an axle's friction that the manoeuvre may use; default: 0.85.", "SHARE"
    ),
    repeat: int = option("How many times the manoeuvre will be driven.", default=1),
    driver: bool = option(
        "Whether a driver corrects speed and path, or the planned commands are sent unchanged.",
        name="--driver/--open-loop",
        default=True,
        show_default=True,
    ),
    effort: float = option("Factor on the time of the search for a manoeuvre: 2 is twice the usual time.", default=1.0),
    seed: int = option("Seed of all random numbers.", type=FROM_ZERO, default=0),
    out: str = option("Folder for plan.csv, plan.svg, design.json.", "FOLDER", default="design"),
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Design the most informative manoeuvre: for the parameters of FIT, or to separate the explanations of GAP.

    \b
    greybox design run/fit.json --goal precision --parameters I_z,B_f --arena disc:40 --duration 20 --out next
    greybox design gap/gap.json --goal discriminate --arena straight:120x8 --out next
    greybox simulate --vehicle car.toml next/plan.csv

    With 95 % probability, the vehicle stays within the arena and the limits of friction and sideslip.
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
