"""`greybox gap`: where a simulation deviates from the vehicle, by which effect, and how far effects close the gap."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Any

import click
from rich.console import Console, Group
from rich.table import Table

from ..api.closed_vehicle import no_place
from ..api.diagnosing import diagnose, nominal_model, visible
from ..api.gap_result import ChangeResult, GapResult
from ..base.errors import BadInput
from ..base.files import at_once, ensure_writable, write_atomically
from ..base.guard import claim, option_of
from ..base.json_data import finite, plain
from ..base.numbers import listed, number, pretty_unit, the_recordings
from ..fitting.requested_model import named_vehicle
from ..gap.changes.verb import Changed, Visible
from ..gap.design.arena import arena as arena_of
from ..gap.gap import Gap
from ..models.registry import MODELS
from ..models.vehicle import Vehicle, write_vehicle
from ..reports.gap.saved import KIND, Made, as_plain_data, as_text
from ..reports.gap.words import before_words, budget, magnitude_words, unchanged_words
from ..reports.text.gap import parts, probability
from ..reports.text.screen import led, plain_table
from .defaults import command_line
from .options import (
    COLUMNS,
    FILE,
    FROM_ZERO,
    JSON_AND_OWN,
    VEHICLES,
    argument,
    command,
    fit_of,
    named_model,
    names,
    option,
    read_part,
)
from .output import console, print_json, progress
from .terminal import clean_json, tell

IN_FOLDER = {"json": "gap.json", "vehicle": "closed.toml", "picture": "gap.png"}
"""Kind of file -> name in the folder of --out."""
BECOMES = {
    "json": "a gap",
    "vehicle": "a vehicle file that greybox wrote",
    "picture": "a figure",
    "report": "a report",
}
"""Kind of file -> its name in the guard."""


def targets_of(out: str | None, report: str | None, apply: str | None) -> list[tuple[str, Path]]:
    """Files to write, as (kind, file), checked before the computation.

    Parameters
    ----------
    out, report, apply : the options.

    Raises
    ------
    BadInput : if a file has a wrong name, cannot be written, or is an input, too.
    """
    if report is not None and Path(report).suffix.lower() not in (".pdf", ".html"):
        raise BadInput(f"{report}: a report is a .pdf or a .html file; name it so with --report.")
    if apply is not None and Path(apply).suffix.lower() not in (".toml", ".json"):
        raise BadInput(f"{apply}: a vehicle file ends in .toml or .json; name it so with --apply.")
    result = [(kind, Path(out) / name) for kind, name in IN_FOLDER.items()] if out is not None else []
    if report is not None or out is not None:
        result.append(("report", Path(report) if report is not None else Path(out or "") / "gap.pdf"))
    if apply is not None:
        result.append(("vehicle", Path(apply)))
    for kind, target in result:
        option = "‹apply›" if apply is not None and target == Path(apply) else option_of(target)
        claim(target, option, BECOMES[kind])
    for folder in dict.fromkeys(target.parent for _, target in result):
        ensure_writable(folder)
    return result


def without_vehicle(targets: Sequence[tuple[str, Path]], model: str, apply: str | None) -> list[tuple[str, Path]]:
    """Files for a model with weights, which a vehicle file cannot contain.

    Raises
    ------
    BadInput : if a vehicle file was requested.
    """
    if apply is not None:
        raise BadInput(f"{apply}: {no_place(model)} Omit --apply.")
    return [(kind, target) for kind, target in targets if kind != "vehicle"]


def write(kind: str, target: Path, gap: GapResult, closed: Vehicle | None) -> None:
    """Write one of the files, atomically."""
    # Imported here, since --help and other outputs do not need the typesetter of reports.
    if kind == "json":
        write_atomically(target, as_text(gap, gap.made))
    elif kind == "vehicle":
        assert closed is not None
        write_vehicle(closed, target)
    elif kind == "picture":
        from ..reports.gap.page import write_picture

        write_picture(gap, target)
    else:
        from ..reports.gap.report import write_report

        write_report(gap, gap.made, target)


def warnings_of(closed: Vehicle | None, gap: Gap, apply: str | None, out: str | None = None) -> list[str]:
    """Warnings about the closed vehicle, or why there is none."""
    if closed is None:
        return [f"{IN_FOLDER['vehicle']} is not written: {no_place(gap.model)}"] if out is not None else []
    if apply is not None and not gap.applied:
        return [f"no effect was found to apply: {apply} describes the vehicle as it was."]
    return []


def as_json_text(gap: Gap, made: Made, written: Sequence[Path], changed: Changed | None = None) -> str:
    """The diagnosis and its provenance as one JSON object, which `greybox report` accepts like gap.json.

    Numbers that are not finite become null.
    """
    body = as_plain_data(gap) if changed is None else changed.to_json() | as_plain_data(gap)
    return KIND.text(finite(plain({**body, **asdict(made), "written": [str(target) for target in written]})))


def show(out: Console, gap: Gap) -> None:
    """Print a diagnosis: doubts about the data, gap, location, causes, errors, and what remains."""
    for part in parts(gap, out.width):
        out.print(part)


def show_changed(out: Console, changed: Changed) -> None:
    """Print what changed since other recordings, share of the gap, and what did not change."""
    gap = changed.gap
    for doubt in (*gap.doubts, *changed.drift):
        out.print(led("Doubt", doubt))
    table = Table.grid(padding=(0, 2, 0, 0))
    for _ in range(4):
        table.add_column(overflow="fold")
    for item in gap.ranking:
        if item.effect in gap.applied:
            mean = before_words(item, changed.scatter[item.effect][0])
            table.add_row(item.effect, magnitude_words(item), probability(item.probability), f"before: {mean}")
    lead = f"{'' if gap.applied else 'nothing '}beyond the scatter of {the_recordings(changed.since)}"
    out.print(led("Changed", Group(lead, table) if gap.applied else lead))
    for alike in gap.classes:
        if alike.applied and len(alike.members) > 1:
            out.print(led("", f"one of {listed(alike.members)}, probability {probability(alike.probability)}"))
    for item in gap.ranking:
        if item.reason:
            out.print(led("", f"{item.effect} {magnitude_words(item)} not applied: {item.reason}"))
    if gap.budget is not None:
        out.print(led("Budget", budget(gap)))
    if changed.not_changed:
        still = [unchanged_words(item["effect"], item["within"]) for item in changed.not_changed]
        out.print(led("Same", f"no change beyond two standard deviations, given in brackets: {listed(still)}"))
    if changed.not_seen:
        out.print(
            led("Unknown", f"a change of usual size would be below the detection limit: {listed(changed.not_seen)}")
        )
    out.print(led("Remains", gap.unknown or "no unexplained error"))


def what_would_show(
    recordings: Sequence[str],
    vehicle: str | None,
    fit_file: str | None,
    since: Sequence[str],
    columns: str,
    model: str | None,
    as_json: bool,
) -> None:
    """Print the smallest changes that would be detected on one more recording like those from before."""
    if recordings or not since:
        raise BadInput("--sensitivity needs recordings from before the change, named with --since, and no others.")
    simulation, stated = _simulation(vehicle, fit_file, model)
    before = [read_part(file, columns or "canonical") for file in since]
    with progress() as say:
        result = visible(simulation, before, vehicle=stated, progress=say)
    if as_json:
        print_json({"since": [item.name for item in before], "visible": [asdict(item) for item in result]})
        return
    sizes = ("smallest change", "scatter between runs", "sd of an estimate")
    table = plain_table("effect", *sizes, right=sizes)
    for item in result:
        table.add_row(item.effect, *(_within_words(item, value) for value in (item.size, item.scatter, item.told)))
    console().print(
        "Smallest change that would be detected with one more recording like "
        f"{the_recordings([item.name for item in before])}:"
    )
    console().print(table)
    console().print(
        "Scatter between runs: standard deviation of the effect between runs without a change. "
        "Sd of an estimate: standard deviation of an estimate from one run."
    )


def _within_words(item: Visible, value: float) -> str:
    """A distance in an effect's unit, or in per cent for factors."""
    if not isfinite(value):
        return "at no size"
    unit = "%" if item.factor else pretty_unit("" if item.unit == "1" else item.unit)
    return f"± {number(100 * value if item.factor else value, 2)} {unit}".strip()


class _Since(click.Command):
    """A command whose --since takes all words up to the next option, as in AFTER.. --since BEFORE.."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Write `--since a b` as `--since a --since b`."""
        spread, taking = list[str](), False
        for before, word in zip(["", *args], args, strict=False):
            if word.startswith("-"):
                taking = word == "--since"
            elif taking and before != "--since":
                spread.append("--since")
            spread.append(word)
        return super().parse_args(ctx, spread)


@command("gap", cls=_Since)
def gap(
    recordings: Sequence[str] = argument("RECORDING...", type=FILE),
    vehicle: str | None = option(
        "Vehicle that is simulated: a shipped name or a vehicle file.", "VEHICLE", shell_complete=VEHICLES
    ),
    fit_file: str | None = option(
        "Fit that is simulated, in place of a vehicle. A --vehicle beside --fit gives only noise and tolerances.",
        "FIT",
        name="--fit",
        type=FILE,
    ),
    model: str | None = option(
        "Model that is simulated with the values of --vehicle; default: the one that the vehicle file names, else "
        "single_track. Your own: FILE.py:NAME, which is executed.",
        "NAME",
        shell_complete=names(MODELS),
        callback=named_model,
    ),
    columns: str = COLUMNS,
    held_out: Sequence[str] = option(
        "Held-out recording, to measure how much of the gap closes; repeatable.", "RECORDING", type=FILE
    ),
    since: Sequence[str] = option(
        "Recordings from before a change of the vehicle. Reports only what has changed since, beyond the scatter "
        "between these recordings.",
        "RECORDING...",
        type=FILE,
    ),
    sensitivity: bool = option(
        "With --since and without RECORDING: print the smallest change of each effect that one more such recording "
        "would show."
    ),
    out: str | None = option(
        "Folder for gap.json (the results), gap.png, gap.pdf and closed.toml (the vehicle with the applied effects).",
        "FOLDER",
    ),
    report: str | None = option(
        "Write the report to this .pdf or .html file; default with --out: FOLDER/gap.pdf.", "FILE"
    ),
    apply: str | None = option("Write a vehicle file (.toml or .json) with the effects that close the gap.", "FILE"),
    arena: str | None = option(
        "Design a manoeuvre that distinguishes the possible causes, within this free area, such as disc:30 (radius in "
        "m).",
        "ARENA",
    ),
    check: bool = option("Exit with code 1 if a gap is detected."),
    seed: int = option("Seed of all random numbers.", type=FROM_ZERO, default=0),
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Find where the simulation deviates from RECORDING, which effects cause this, and how much of the gap they close.

    \b
    greybox gap lap7.csv --vehicle car.toml --held-out lap8.csv
    greybox gap lap7.csv --fit run/fit.json --columns roboracer --report gap.pdf
    greybox gap wet1.csv --since dry1.csv dry2.csv --vehicle car.toml --held-out wet2.csv
    greybox gap --since dry1.csv dry2.csv --vehicle car.toml --sensitivity
    greybox gap lap7.csv --vehicle car.toml --apply car_closed.toml
    greybox simulate lap9.csv --vehicle car_closed.toml

    Name a recording with --held-out: only recordings that were not used for the diagnosis show how much of the gap
    closes.
    """  # fmt: skip
    if sensitivity:
        what_would_show(recordings, vehicle, fit_file, since, columns, model, as_json)
        return
    targets = targets_of(out, report, apply)
    simulation, stated = _simulation(vehicle, fit_file, model)
    nominal, _ = nominal_model(simulation, stated)
    if not recordings:
        raise BadInput("There is no recording to diagnose; name at least one file.")
    after, before, others = ([read_part(file, columns) for file in files] for files in (recordings, since, held_out))
    held_by_file = not nominal.learnt
    if not held_by_file:
        targets = without_vehicle(targets, nominal.name, apply)
    if arena is not None:
        arena_of(arena)  # report errors in it before the computation
    with progress() as say:
        gap = diagnose(
            simulation, after, before or None, held_out=others, vehicle=stated, seed=seed,
            horizons=bool(targets) or not as_json, progress=say,
        )  # fmt: skip
        gap = replace(gap, made=replace(gap.made, command=command_line()))
        if arena is not None:
            from ..api.designing import quoted  # its imports are not needed for a diagnosis alone

            gap = quoted(gap, arena, say)
    changed = gap.change if isinstance(gap, ChangeResult) else None
    closed = gap.closed_vehicle if held_by_file else None
    for warning in warnings_of(closed, gap, apply, out):
        tell(f"warning: {warning}")
    if as_json:
        sys.stdout.write(clean_json(as_json_text(gap, gap.made, [target for _, target in targets], changed)))
    else:
        if changed is not None:
            show_changed(console(), changed)
        else:
            show(console(), gap)
    with at_once():
        for kind, target in targets:
            write(kind, target, gap, closed)
    for _, target in () if as_json else targets:
        console().print(f"written  {target}")
    if check and gap.gap_detected:
        sys.exit(1)


def _simulation(vehicle: str | None, fit: str | None, model: str | None) -> tuple[Any, Vehicle | None]:
    """The fit, model or vehicle whose simulation is diagnosed, and a separately stated vehicle."""
    if vehicle is None and fit is None:
        raise BadInput("Which simulation? Name the vehicle with --vehicle, or a fit with --fit.")
    stated = named_vehicle(vehicle)
    if fit is not None:
        if model is not None:
            raise BadInput(
                f"--model {model}: a fit has its own model; omit --model, or use --vehicle in place of --fit."
            )
        return fit_of(fit), stated
    usual = stated is not None and stated.model is not None and model in (None, stated.model.name)
    return (stated, None) if model is None or usual else (model, stated)
