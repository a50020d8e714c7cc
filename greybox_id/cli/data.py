"""`greybox data`: checks, maps, conversion and joining of recordings."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from ..base.errors import BadInput
from ..base.files import write_atomically
from ..base.guard import claim
from ..base.processes import Pace
from ..datasets.checks import check, distrusted
from ..datasets.checks.checking import mended
from ..datasets.clocks import at_rate
from ..datasets.column_map import column_map
from ..datasets.formats import WRITTEN, write
from ..datasets.joining import join_files
from ..datasets.repair import map_text, repaired
from ..reports.text.recordings import as_dict, header, proposal_as_dict, show_findings, show_proposal
from .commands import CommandGroup, Guarded
from .options import ABOVE_ZERO, COLUMNS, FILE, JSON, argument, command, option, part_asked, read_part
from .output import console, print_json, progress, working

WHEELBASE: Any = option("Wheelbase of the vehicle in m, to check the steering angle with.", type=ABOVE_ZERO)


class RepairTarget(Guarded):
    """The file for a repaired map; claimed later, unless it is the map of --columns."""

    def __init__(self) -> None:
        super().__init__(click.STRING, written="--repair")

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The text unchanged."""
        return self.own.convert(value, param, ctx)


@click.group(cls=CommandGroup)
def data() -> None:
    """Check, map and convert recordings before a fit.

    \b
    greybox data map lap.csv --out my_car.toml
    greybox data check lap.csv --columns my_car.toml
    greybox data convert lap.mcap --columns my_car.toml --out lap.csv
    """


@command("check", of=data)
def check_command(
    files: Sequence[str] = argument("FILE...", type=FILE, required=True),
    columns: str = COLUMNS,
    wheelbase: float | None = WHEELBASE,
    repair: str | None = option(
        "Repair the column map as the check proposes, and write it to MAP.toml, which may be the file of --columns.",
        "MAP.toml",
        type=RepairTarget(),
    ),
    as_json: bool = JSON,
) -> None:
    """Check units, signs, time and sensors of each recording FILE, and list what is wrong or noteworthy.

    --repair corrects signs, units and columns in the column map, and then judges each FILE read with the corrected map.
    If MAP.toml is the map of --columns, its former content is kept as MAP.toml.bak. Exit code 1: at least one FILE is
    not to be trusted.

    \b
    greybox data check lap7.csv lap8.csv --columns my_car.toml
    greybox data check lap7.csv --columns my_car.toml --repair mended.toml
    greybox data check lap7.csv --columns my_car.toml --repair my_car.toml
    """  # fmt: skip
    before = _kept_beside(columns, repair) if repair else None
    target = None if not repair else Path(repair) if before else map_target(repair, "‹repair›")
    mapping, changes = (
        mended(lambda mapping: (read_part(file, mapping) for file in files), columns, wheelbase)
        if target
        else (columns, ())
    )
    results, pace = [], Pace(len(files))
    with progress() as say:
        for k, file in enumerate(files):
            say(f"reading {file}, {k + 1} of {len(files)}{pace.left(k)}", passing=True)
            recording = read_part(file, mapping)
            say(f"checking {file}, {k + 1} of {len(files)}{pace.left(k)}", passing=True)
            results.append((recording, check(recording, wheelbase)))
    if target and changes:
        if before:
            write_atomically(before, target.read_text(encoding="utf-8"))
        write_atomically(target, map_text(column_map(mapping)), continued=before is not None)
    backup = str(before) if before and changes else None
    if as_json:
        done = {"written": repair if changes else None, "kept": backup, "changes": list(changes)}
        repairs = {"repair": done} if repair else {}
        print_json({"files": [as_dict(*result) for result in results], **repairs})
    else:
        for recording, findings in results:
            show_findings(recording, findings, console())
        if repair:
            console().print(f"written  {repair}: {'; '.join(changes)}" if changes else "no finding has a repair")
            if backup:
                console().print(f"written  {backup}: the map before the repair")
        elif any(repaired(column_map(columns), findings) for _, findings in results):
            wheels = ["--wheelbase", f"{wheelbase:g}"] if wheelbase else []
            again = ["greybox", "data", "check", *files, "--columns", columns, *wheels, "--repair", _free_name()]
            console().print(Text(f"repair the map: {shlex.join(again)}"), soft_wrap=True)
    sys.exit(1 if any(distrusted(findings) for _, findings in results) else 0)


def _free_name() -> str:
    """An unused file name for a repaired map."""
    names = (f"mended{number or ''}.toml" for number in count())
    return next(name for name in names if not Path(name).exists())


def _kept_beside(columns: str, repair: str) -> Path | None:
    """Path of the backup of a map that is repaired in place; None if the repair goes to another file.

    Only the same name counts as in place: another spelling, or a link, may be a mistake, which the guard refuses.
    """
    target = Path(repair)
    if target != Path(columns) or not target.is_file() or target.is_symlink():
        return None
    names = (target.with_name(f"{target.name}.bak{number or ''}") for number in count())
    return next(name for name in names if not name.exists())


@command("map", of=data)
def map_command(
    files: Sequence[str] = argument("FILE...", type=FILE, required=True),
    out: str | None = option("Write the proposed column map to this file, which you can edit.", "MAP.toml"),
    rate: float | None = option("Rows per second, if FILE has no column of time.", type=ABOVE_ZERO),
    wheelbase: float | None = WHEELBASE,
    as_json: bool = JSON,
) -> None:
    """Propose a column map for FILE: which column holds which signal, and in which unit.

    The proposal follows from names of columns and from relations between signals; uncertain entries are marked. Several
    FILEs, such as topics or sensors with clocks of their own, get one map; they must be of one drive.

    \b
    greybox data map lap7.csv --out my_car.toml
    greybox data map imu.csv odom.csv commands.csv --out my_car.toml
    """
    from ..datasets.mapping import as_toml, propose

    target = map_target(out) if out else None
    with working(f"looking at {files[0]}"):
        proposal = propose(files if len(files) > 1 else files[0], wheelbase, rate or 0.0)
    if target:
        write_atomically(target, as_toml(proposal, target.stem))
    if as_json:
        print_json(proposal_as_dict(proposal, out))
    else:
        show_proposal(proposal, out, console())


@command("convert", of=data)
def convert_command(
    file: str = argument("FILE", type=FILE),
    columns: str = COLUMNS,
    out: str = option(f"File to write: {', '.join(WRITTEN)}.", "FILE", required=True),
    rate: float | None = option("Resample to this number of rows per second.", type=click.FloatRange(0.1, 1e5)),
    as_json: bool = JSON,
) -> None:
    """Convert the recording FILE to SI units, ISO 8855 signs and the signal names of greybox-id.

    The ending of the file name in --out determines the format.

    \b
    greybox data convert lap7.mcap --columns my_car.toml --out lap7.csv
    greybox data convert lap7.csv --rate 50 --out lap7_50Hz.csv
    """
    target = Path(out)
    with working(f"converting {file}"):
        recording = read_part(file, columns)
        recording = at_rate(recording, rate) if rate else recording
        write(recording, target)
    further = {name: recording.unit(name) for name in recording.extra_units}
    if as_json:
        print_json({"written": out, "rows": len(recording), "signals": list(recording.signals), "extra": further})
        return
    screen = console()
    screen.print(f"written  {out}: {header(recording)}; {', '.join(recording.signals)}")
    if further:
        named = ", ".join(f"{name} [{unit}]" for name, unit in further.items())
        screen.print(f"         without canonical names; map these under [extra]: {named}")


@command("join", of=data)
def join_command(
    files: Sequence[str] = argument("FILE...", type=FILE, required=True),
    columns: str = COLUMNS,
    out: str = option(f"File to write: {', '.join(WRITTEN)}.", "FILE", required=True),
    as_json: bool = JSON,
) -> None:
    """Join several FILEs of one drive to one recording.

    Each FILE has one topic or sensor with its own clock. If two files hold the same signal, the offset between their
    clocks is estimated from it and corrected; other files keep their time stamps.

    \b
    greybox data join imu.csv odom.csv commands.csv --columns my_car.toml --out lap7.parquet
    """  # fmt: skip
    target = Path(out)
    with working(f"joining {len(files)} files"):
        recording, offsets = join_files(files, columns)
        recording = part_asked(recording)
        write(recording, target)
    if as_json:
        rows = [
            {
                "file": offset.file, "against": offset.against, "signal": offset.signal or None,
                "offset_s": offset.seconds, "sd_s": offset.sd,
                "rate": offset.alignment.rate if offset.alignment else None,
                "left_s": offset.alignment.left if offset.alignment else None, "taken_off": offset.taken_off,
            }
            for offset in offsets
        ]  # fmt: skip
        print_json({"written": out, "rows": len(recording), "signals": list(recording.signals), "offsets": rows})
        return
    screen = console()
    screen.print(f"written  {out}: {header(recording)}; {', '.join(recording.signals)}")
    for note in recording.notes:
        screen.print(f"         {note}")


def map_target(out: str, option: str = "‹out›") -> Path:
    """The file for a map. Raises `BadInput` for another kind of file, and if the file exists.

    An existing map may have been edited, so the guard never counts a map as replaceable.
    """
    target = Path(out)
    if target.suffix.lower() != ".toml":
        raise BadInput(f"{out}: a column map is a .toml file; name one with --out.")
    return claim(target, option, becomes="a column map")
