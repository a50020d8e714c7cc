"""Files that a diagnosis leaves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..datasets.vehicle_text import write_vehicle
from ..errors import BadInput
from ..files import ensure_writable, write_atomically
from ..gap import Gap
from ..gap.closed_vehicle import no_place, not_held
from ..guard import claim, option_of
from ..reports.gap.saved import Made, as_text
from ..vehicle import Vehicle

IN_FOLDER = {"json": "gap.json", "vehicle": "closed.toml", "picture": "gap.png"}
"""Kind of file -> its name in the folder of --out."""
BECOMES = {
    "json": "a gap",
    "vehicle": "a vehicle file that greybox wrote",
    "picture": "a figure",
    "report": "a report",
}
"""Kind of file -> what the guard calls it."""


def targets_of(out: str | None, report: str | None, apply: str | None) -> list[tuple[str, Path]]:
    """What is to be written where, as (kind, file), checked before long work.

    Parameters
    ----------
    out, report, apply : options of these names.

    Raises
    ------
    BadInput : a file is named wrongly, cannot be written, or is read as well.
    """
    if report is not None and Path(report).suffix.lower() not in (".pdf", ".html"):
        raise BadInput(f"{report}: a report is a .pdf or a .html file; name it so with --report.")
    if apply is not None and Path(apply).suffix.lower() not in (".toml", ".json"):
        raise BadInput(f"{apply}: a vehicle file ends in .toml or .json; name it so with --apply.")
    found = [(kind, Path(out) / name) for kind, name in IN_FOLDER.items()] if out is not None else []
    if report is not None or out is not None:
        found.append(("report", Path(report) if report is not None else Path(out or "") / "gap.pdf"))
    if apply is not None:
        found.append(("vehicle", Path(apply)))
    for kind, target in found:
        option = "‹apply›" if apply is not None and target == Path(apply) else option_of(target)
        claim(target, option, BECOMES[kind])
    for folder in dict.fromkeys(target.parent for _, target in found):
        ensure_writable(folder)
    return found


def without_vehicle(targets: Sequence[tuple[str, Path]], model: str, apply: str | None) -> list[tuple[str, Path]]:
    """Targets of a model whose weights a vehicle file has no place for.

    Raises
    ------
    BadInput : a vehicle file was asked for.
    """
    if apply is not None:
        raise BadInput(f"{apply}: {no_place(model)} Omit --apply.")
    return [(kind, target) for kind, target in targets if kind != "vehicle"]


def write(kind: str, target: Path, gap: Gap, closed: Vehicle | None, made: Made) -> None:
    """Write one of the files, atomically."""
    # Reports load the typesetter: without them, and for --help, it is done without.
    if kind == "json":
        write_atomically(target, as_text(gap, made))
    elif kind == "vehicle":
        assert closed is not None
        write_vehicle(closed, target)
    elif kind == "picture":
        from ..reports.gap.page import write_picture

        write_picture(gap, target)
    else:
        from ..reports.gap.report import write_report

        write_report(gap, made, target)


def warnings_of(closed: Vehicle | None, gap: Gap, apply: str | None, out: str | None = None) -> list[str]:
    """What is to be known of the closed vehicle, or of why there is none."""
    if closed is None:
        return [f"{IN_FOLDER['vehicle']} is left out: {no_place(gap.model)}"] if out is not None else []
    lost = not_held(closed, gap)
    said = []
    if lost:
        said.append(f"a vehicle file has no place for {', '.join(lost)}: the closed vehicle takes what is usual.")
    if apply is not None and not gap.applied:
        said.append(f"no effect was found to apply: {apply} describes the vehicle as it was.")
    return said
