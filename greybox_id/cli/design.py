"""`greybox design`: the manoeuvre to drive next, for precise parameters or to distinguish explanations."""

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
        "precision: precise parameters; discriminate: tell possible causes of a gap apart; detect: find an effect that "
        "is below the detection limit. Default: precision for a FIT, discriminate for a GAP."
    ),
    arena: str = option(
        "Free area: straight:LENGTHxWIDTH or disc:RADIUS (in m), or a .csv file of its outline with columns x and y.",
        "ARENA",
        required=True,
    ),
    parameters: str = option(
        "Parameters to estimate precisely, such as I_z,B_f; default: all free ones.", "NAMES", default=""
    ),
    criterion: Literal["d", "a", "e", "c"] = option(
        "What is minimised. d: determinant of the covariance; a: mean variance; e: variance of the worst combination; "
        "c: variance of the first of NAMES.",
        default="d",
    ),
    duration: float = option("Longest duration of the manoeuvre.", "SECONDS", default=20.0),
    rate: float = option("Rows per second of plan.csv.", "HZ", default=50.0),
    limits: str | None = option(
        "TOML file of limits in SI units, such as steer_max, speed_max, sideslip_max.", "FILE", type=FILE
    ),
    vehicle: str | None = option("Vehicle that gives steer_max, unless --limits does.", "NAME|FILE"),
    speed_max: float | None = option("Highest speed that is allowed.", "M/S"),
    grip: float | None = option(
        "Largest share of the friction of an axle that the manoeuvre may use; default: 0.85.", "SHARE"
    ),
    repeat: int = option("How many times the manoeuvre will be driven.", default=1),
    driver: bool = option(
        "driver: a driver corrects speed and path; open-loop: the planned commands are sent unchanged.",
        name="--driver/--open-loop",
        default=True,
        show_default=True,
    ),
    effort: float = option("Factor on the time of the search for a manoeuvre: 2 is twice the usual time.", default=1.0),
    seed: int = option("Seed of all random numbers.", type=FROM_ZERO, default=0),
    out: str = option(
        "Folder for plan.csv (the manoeuvre), plan.svg (its path) and design.json (the results).",
        "FOLDER",
        default="design",
    ),
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Design the most informative manoeuvre: to estimate parameters of FIT, or to tell possible causes in GAP apart.

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
