"""`greybox exam`: a blind examination of `greybox gap` on vehicles whose truth is known and sealed."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from .commands import Group
from .options import json_option
from .output import console, print_json, progress

DIAGNOSER = f"{__name__}:diagnose_case"
"""What sits the examination, unless another function is named."""


@click.group(name="exam", cls=Group)
def exam() -> None:
    """Examine the diagnosis of gaps blindly: make cases, diagnose them, open the answers once.

    \b
    greybox exam make --tier clean --seed 7 --cases 300 --out exam_clean
    greybox exam run exam_clean/cases --jobs 2
    greybox exam score exam_clean --detail
    """


@exam.command("make")
@click.option(
    "--out",
    required=True,
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    help="A new folder, or one left unfinished.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Says which examination.")
@click.option(
    "--tier",
    type=click.Choice(["clean", "workshop"]),
    default="clean",
    show_default=True,
    help="Exact vehicle files, nominal forms and white noise; or tolerances, other forms, coloured noise, outliers.",
)
@click.option("--cases", type=click.IntRange(min=0), default=60, show_default=True, help="With something the matter.")
@click.option("--nulls", type=click.IntRange(min=0), help="With nothing; default: a sixth of the others.")
@click.option("--real", metavar="FOLDER", type=click.Path(path_type=Path), help="Real RoboRacer recordings instead.")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes at a time.")
@json_option
def make_command(
    out: Path, seed: int, tier: Any, cases: int, nulls: int | None, real: Path | None, jobs: int, as_json: bool
) -> None:
    """Make cases, and seal their answers apart from them; carries on where it was stopped.

    Note the sum that is printed: with it, greybox exam score --seal tells whether the answers were replaced.

    \b
    greybox exam make --tier clean --seed 7 --cases 300 --out exam_clean
    """  # fmt: skip
    with progress() as say:
        if real is not None:
            from ..exam.real import make_real

            made = make_real(out, real, say)
        else:
            from ..exam.make import make

            made = make(out, seed, tier, cases, nulls, jobs, say)
    if as_json:
        print_json(asdict(made) | {"folder": str(made.folder)})
        return
    counts = ", ".join(f"{count} {kind}" for kind, count in sorted(made.counts.items()))
    console().print(f"written  {made.folder}: {counts}")
    if made.hidden:
        console().print(f"         {made.hidden} of them hardly show")
    console().print(f"sealed   {made.seal}")


@exam.command("run")
@click.argument("cases", metavar="CASES", type=click.Path(path_type=Path))
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes at a time.")
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, min_open=True),
    default=120.0,
    show_default=True,
    metavar="SECONDS",
    help="A case that takes longer counts as wrong.",
)
@click.option("--diagnoser", default=DIAGNOSER, metavar="MODULE:FUNCTION", help="In place of greybox gap.")
@json_option
def run_command(cases: Path, jobs: int, timeout: float, diagnoser: str, as_json: bool) -> None:
    """Diagnose each of CASES as greybox gap does, where the answers cannot be seen; carries on where it was stopped.

    Each case is left diagnosis.json and closed.toml.

    \b
    greybox exam run exam_clean/cases --jobs 2
    """
    from ..exam.run import run

    with progress() as say:
        sat = run(cases, diagnoser, jobs, timeout, say)
    if as_json:
        print_json(asdict(sat))
        return
    console().print(
        f"diagnosed {sat.diagnosed} of {sat.cases} cases ({sat.before} were before), {sat.failed} ended in an error, "
        f"{sat.cpu:.1f} CPU s"
    )


@exam.command("score")
@click.argument("folder", metavar="FOLDER", type=click.Path(path_type=Path))
@click.option("--detail", is_flag=True, help="Also what was taken for what, and every case that was wrong.")
@click.option("--seal", "noted", default="", metavar="SUM", help="The seal's sum as noted when the cases were made.")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes at a time.")
@json_option
def score_command(folder: Path, detail: bool, noted: str, jobs: int, as_json: bool) -> None:
    """Open the answers in FOLDER and say what was right; that is done once, and kept in FOLDER/score.json.

    \b
    greybox exam score exam_clean --detail
    """  # fmt: skip
    from ..exam.score import score
    from ..exam.table import tables

    with progress() as say:
        body, again = score(folder, say, jobs=jobs, noted=noted)
    if again:
        click.echo(f"these answers were opened already, {body['opened']}; this is the score of then", err=True)
    if as_json:
        print_json(body | {"opened_before": again})
        return
    out = console()
    out.print(f"{body['cases']} cases, tier {body['tier']}, {body['errors']} ended in an error")
    for table in tables(body, detail):
        out.print(table)
        out.print()


def diagnose_case(folder: Path) -> dict[str, Any]:
    """What greybox gap says of a case, as plain data; the closed vehicle is left in the folder.

    Parameters
    ----------
    folder : with recording.csv, and vehicle.toml or fit.json.
    """
    from ..datasets.vehicle_file import vehicle as stated_in
    from ..datasets.vehicle_text import write_vehicle
    from ..exam.folder import CLOSED
    from ..exam.verification import plain_model
    from ..fit import load
    from ..gap.closed_vehicle import closed_vehicle, fitted_vehicle
    from ..models.registry import build
    from ..motion_model import MotionModel
    from .gap import diagnosed

    file, fit, columns = folder / "vehicle.toml", folder / "fit.json", folder / "columns.toml"
    recording, mapping = [folder / "recording.csv"], columns if columns.is_file() else None
    if file.is_file():
        stated = stated_in(file)
        found = diagnosed(recording, vehicle=stated, columns=mapping)
    else:
        stated = fitted_vehicle(load(fit, build), fit.stem)
        found = diagnosed(recording, fit=fit, columns=mapping)
    body: dict[str, Any] = found.to_json()
    if not isinstance(found.closed, MotionModel):  # a vehicle file has no place for the weights of one with memory
        return body
    write_vehicle(closed_vehicle(stated, found), folder / CLOSED)
    return body | {"closed_model": plain_model(found.closed)}
