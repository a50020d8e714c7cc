"""`greybox exam`: a blind examination of `greybox gap` on vehicles whose truth is known and sealed."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from greybox_id.base.errors import BadInput
from greybox_id.cli.commands import CommandGroup
from greybox_id.cli.options import ABOVE_ZERO, FROM_ONE, FROM_ZERO, JSON, PATH, argument, command, option
from greybox_id.cli.output import console, print_json, progress
from greybox_id.cli.terminal import tell

JOBS: Any = option("Number of parallel processes.", type=FROM_ONE, default=1)
DIAGNOSER = f"{__name__}:diagnose_case"
"""What sits the examination, unless another function is named."""
COUNTS = {
    "foreign": {"nulls": 200, "singles": 70, "pairs": 25, "outside": 30, "many": 0},
    "many": {"nulls": 0, "singles": 0, "pairs": 0, "outside": 0, "many": 60},
    "rough": {"nulls": 20, "singles": 14, "pairs": 6, "outside": 0, "many": 0},
}
"""Tier on foreign simulators -> how many cases of each kind, unless others are asked for."""
INJECTED = 70
"""Altered real recordings, unless others are asked for."""
ASKED = {
    "clean": ("cases", "nulls"),
    "workshop": ("cases", "nulls"),
    "foreign": ("nulls", "singles", "pairs", "outside", "many", "family"),
    "many": ("nulls", "many", "family"),
    "rough": ("nulls", "singles", "pairs", "many", "family"),
    "injected": ("singles", "data", "family"),
    "changed": ("data", "family"),
}
"""Tier -> the options that say what its cases are to be."""
TIERS = click.Choice(list(ASKED))


@click.group(name="exam", cls=CommandGroup)
def exam() -> None:
    """Test how well greybox gap finds causes that are hidden from it: make cases, diagnose them, then score once.

    \b
    greybox exam make --tier clean --seed 7 --cases 300 --out exam_clean
    greybox exam run exam_clean/cases --jobs 2
    greybox exam score exam_clean --detail
    """


@command("make", of=exam)
def make_command(
    out: Path = option(
        "Folder of the examination: a new one, or an unfinished one to continue.",
        "FOLDER",
        required=True,
        type=PATH,
    ),
    seed: int = option("Seed of the examination; the same seed makes the same cases.", type=FROM_ZERO, default=0),
    tier: Any = option(
        "Kind of the cases. clean: exact vehicle files, white noise; workshop: vehicle files with tolerances, other "
        "equations than the model, coloured noise, outliers; foreign: vehicles of other simulators; many: three to six "
        "effects at once; rough: sprung cars with inexact vehicle files; injected: real recordings that were altered; "
        "changed: a real car that was changed (recordings of the DART car).",
        type=TIERS,
        default="clean",
    ),
    cases: int | None = option(
        "Number of cases with hidden effects in the tiers clean and workshop; default: 60.", type=FROM_ZERO
    ),
    nulls: int | None = option(
        "Number of cases without effects; default: a sixth of the other cases, in the tier foreign 200.",
        type=FROM_ZERO,
    ),
    singles: int | None = option("Number of cases with one effect; default: 70, in the tier rough 14.", type=FROM_ZERO),
    data: Path | None = option(
        "Folder of the real recordings, for the tiers injected and changed.", "FOLDER", type=PATH
    ),
    pairs: int | None = option("Number of cases with two effects; default: 25, in the tier rough 6.", type=FROM_ZERO),
    outside: int | None = option(
        "Number of cases with an effect that greybox gap does not know; default: 30.", type=FROM_ZERO
    ),
    many: int | None = option(
        "Number of cases with three to six effects at once; default in the tier many: 60.", type=FROM_ZERO
    ),
    families: tuple[str, ...] = option(
        "Source of the cases: in the tier foreign a simulator (workshop is the virtual vehicle), in injected a "
        "recording, in changed a case; or a set of sources: development or examination. Repeatable.",
        "NAME",
        name="--family",
        multiple=True,
    ),
    jobs: int = JOBS,
    as_json: bool = JSON,
) -> None:
    """Make the cases of an examination, and store the answers (their true causes) in a separate, sealed folder.

    Note the checksum that is printed: greybox exam score --seal uses it to detect replaced answers. After an
    interruption the same command continues.

    \b
    greybox exam make --tier clean --seed 7 --cases 300 --out exam_clean
    greybox exam make --tier foreign --seed 7 --out exam_foreign
    """  # fmt: skip
    requested: dict[str, Any] = {
        "cases": cases,
        "nulls": nulls,
        "singles": singles,
        "data": data,
        "pairs": pairs,
        "outside": outside,
        "many": many,
    }
    requested["family"] = families or None
    if strangers := [f"--{name}" for name, item in requested.items() if item is not None and name not in ASKED[tier]]:
        goes = ", ".join(f"--{name}" for name in ASKED[tier])
        raise BadInput(f"{', '.join(strangers)} cannot be combined with --tier {tier}; possible are {goes}.")
    with progress() as say:
        if tier in COUNTS:
            from ..exam.make import make_foreign
            from ..exam.plan import Counts

            named = {name: value for name in COUNTS[tier] if (value := requested[name]) is not None}
            how_many = Counts(**COUNTS[tier] | named)
            made = make_foreign(out, seed, tier, how_many, families or ("rough",) * (tier == "rough"), jobs, say)
        elif tier in ("injected", "changed"):
            from ..exam.changed import make_changed
            from ..exam.injected import make_injected

            if data is None:
                raise BadInput(f"--tier {tier} is of real recordings; name their folder with --data.")
            if tier == "changed":
                made = make_changed(out, data, seed, families, jobs, say)
            else:
                made = make_injected(out, data, seed, INJECTED if singles is None else singles, families, jobs, say)
        else:
            from ..exam.make import make

            made = make(out, seed, tier, 60 if cases is None else cases, nulls, jobs, say)
    if as_json:
        print_json(asdict(made) | {"folder": str(made.folder)})
        return
    counts = ", ".join(f"{count} {kind}" for kind, count in sorted(made.counts.items()))
    console().print(f"written  {made.folder}: {counts}")
    if made.hidden:
        console().print(f"         {made.hidden} of them are hardly detectable")
    console().print(f"sealed   {made.seal}")


@command("run", of=exam)
def run_command(
    cases: Path = argument("CASES", type=PATH),
    jobs: int = JOBS,
    timeout: float = option(
        "Time limit of a case; a case that takes longer counts as wrong.",
        "SECONDS",
        type=ABOVE_ZERO,
        default=120.0,
    ),
    diagnoser: str = option(
        "Diagnose with this Python function in place of greybox gap.",
        "MODULE:FUNCTION",
        default=DIAGNOSER,
        show_default=False,
    ),
    sample: int | None = option("Diagnose at most this many cases, drawn at random.", type=FROM_ONE),
    seed: int = option("Seed with which --sample draws.", type=FROM_ZERO, default=0),
    as_json: bool = JSON,
) -> None:
    """Diagnose each case in the folder CASES as greybox gap does, without access to the answers.

    The results are the files diagnosis.json and closed.toml of each case. Several commands may work on the same cases
    at once; each process takes one core. After an interruption the same command continues.

    \b
    greybox exam run exam_clean/cases --jobs 2
    greybox exam run exam_many/cases --sample 12 --seed 3
    """
    from ..exam.run import run

    with progress() as say:
        sat = run(cases, diagnoser, jobs, timeout, say, sample, seed)
    if as_json:
        print_json(asdict(sat))
        return
    console().print(
        f"diagnosed {sat.diagnosed} of {sat.cases} cases ({sat.before} of them earlier), {sat.failed} ended in an "
        "error, "
        f"{sat.cpu:.1f} CPU s"
    )


@command("score", of=exam)
def score_command(
    folder: Path = argument("FOLDER", type=PATH),
    detail: bool = option("Also print every wrong case, and which effects were taken for which."),
    noted: str = option("Checksum that greybox exam make printed.", "SUM", name="--seal", default=""),
    partial: bool = option("Score only the cases that have been diagnosed so far; this score is not stored."),
    jobs: int = JOBS,
    as_json: bool = JSON,
) -> None:
    """Compare the diagnoses in FOLDER with the answers.

    This is done once; the score is stored in FOLDER/score.json.

    \b
    greybox exam score exam_clean --detail
    """  # fmt: skip
    from ..exam.score import score, tables

    with progress() as say:
        body, again = score(folder, say, jobs=jobs, noted=noted, partial=partial)
    if again:
        tell(f"the answers were opened on {body['opened']}; this is the score of that time")
    if as_json:
        print_json(body | {"opened_before": again})
        return
    out = console()
    out.print(f"{body['cases']} cases, tier {body['tier']}, {body['errors']} ended in an error")
    for table in tables(body, detail):
        out.print(table)
        out.print()


def diagnose_case(folder: Path) -> dict[str, Any]:
    """What `greybox_id.diagnose` says of a case, as plain data; the closed vehicle is left in the folder.

    Parameters
    ----------
    folder : with recording.csv and vehicle.toml; with recordings from before, what changed since is asked.
    """
    from greybox_id.api.closed_vehicle import closed_vehicle
    from greybox_id.api.diagnosing import diagnose
    from greybox_id.api.gap_result import ChangeResult
    from greybox_id.models.motion_model import MotionModel
    from greybox_id.models.vehicle import vehicle, write_vehicle

    from ..exam.folder import AFTER, BEFORE, CLOSED, COLUMNS
    from ..exam.verification import plain_model

    stated, since, second = vehicle(folder / "vehicle.toml"), sorted(folder.glob(BEFORE)), folder / AFTER
    columns = folder / COLUMNS if (folder / COLUMNS).is_file() else "canonical"
    held_out = [second] if since and second.is_file() else []
    result = diagnose(stated, folder / "recording.csv", since or None, held_out=held_out, columns=columns)
    body: dict[str, Any] = result.to_json()
    if isinstance(result, ChangeResult):
        return body | {"scatter": {name: {"mean": mean, "sd": sd} for name, (mean, sd) in result.scatter.items()}}
    assert isinstance(result.closed, MotionModel)  # of a vehicle file
    write_vehicle(closed_vehicle(stated, result), folder / CLOSED)
    return body | {"closed_model": plain_model(result.closed)}
