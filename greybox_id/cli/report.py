"""`greybox report`: what a fit, a diagnosis, a track or several fits side by side say, as PDF or HTML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..base.condition import span
from ..base.errors import BadInput
from ..base.files import at_once
from ..base.guard import claim
from ..base.numbers import counted
from ..base.saved import format_of
from ..datasets.recording import Recording
from ..fitting.fit import Fit, load
from ..models.registry import build
from .options import json_option, own_option, part
from .output import console, print_json, working

if TYPE_CHECKING:
    from ..reports.document import Document


@click.command(name="report")
@click.argument("files", nargs=-1, required=True, metavar="FIT|GAP|TRACK...", type=click.Path())
@click.option("--train", multiple=True, metavar="FILE", help="Training recording, where it has moved; repeatable.")
@click.option("--validate", metavar="FILE", help="Validation recording, where it has moved.")
@click.option("--columns", metavar="MAP", help="Column map; the one the fit names unless given.")
@click.option("--format", "kind", type=click.Choice(["pdf", "html"]), help="As the name of --out says; else pdf.")
@click.option("--out", metavar="FILE", help="File to write; beside the first file unless given.")
@click.option("--posterior", metavar="FILE", help="Of one FIT: draws of greybox sample, as bands and a corner plot.")
@click.option("--figures", metavar="FOLDER", help="Also write the figures there, as SVG.")
@own_option
@json_option
def report(
    files: Sequence[str],
    train: Sequence[str],
    validate: str | None,
    columns: str | None,
    kind: str | None,
    out: str | None,
    posterior: str | None,
    figures: str | None,
    as_json: bool,
) -> None:
    """Write a report of a FIT made by greybox fit, of a GAP (gap.json) left by greybox gap --out, of a TRACK left by
    greybox track beside its table, or of several FITs side by side.

    \b
    greybox report run/fit.json
    greybox report run/fit.json --format html
    greybox report run/fit.json --posterior posterior.parquet
    greybox report gap/gap.json --out gap.html
    greybox report estimates.json
    greybox report run/fit.json other/fit.json --out comparison.pdf

    The recordings of fits are read from where the fits found them, and must be the same files: their hashes are
    compared.
    """
    # The reports load the typesetter: commands that write none, and --help, do without.
    from ..reports.document import write_drawings
    from ..reports.report import kind_of, write

    target = Path(out) if out is not None else _beside([Path(file) for file in files], kind or "pdf")
    kind = kind_of(target, kind)
    claim(target, becomes="a report")
    with working(f"writing {target}"):
        document = _document([Path(file) for file in files], train, validate, columns, posterior)
        with at_once():
            target = write(document, target, kind)
            written = write_drawings(document.drawings, figures) if figures else []
    if as_json:
        verdict = [sentence for _, sentence in document.verdict]
        print_json({"report": str(target), "figures": [str(file) for file in written], "verdict": verdict})
        return
    for _, sentence in document.verdict:
        console().print(sentence)
    for file in (target, *written):
        console().print(f"written  {file}")


def _beside(files: Sequence[Path], kind: str) -> Path:
    return files[0].with_suffix(f".{kind}") if len(files) == 1 else files[0].with_name(f"comparison.{kind}")


def _document(
    files: Sequence[Path], train: Sequence[str], validate: str | None, columns: str | None, posterior: str | None
) -> Document:
    """The report of what the files hold."""
    kinds = {file: format_of(file) for file in files}
    others = [file for file, kind in kinds.items() if kind in OTHERS]
    if posterior is not None and (others or len(files) > 1):
        raise BadInput("‹posterior› belongs to one fit; name that fit alone.")
    if len(files) > 1:
        if others:
            raise BadInput(f"{others[0]} is no fit; only fits are compared side by side. Name it alone.")
        return _side_by_side(files, train, validate, columns)
    if others:
        return OTHERS[kinds[files[0]]](files[0])
    from ..fitting.posterior.posterior import load_posterior
    from ..reports.report import prepared

    fit = load(files[0], build)
    draws = None if posterior is None else load_posterior(posterior)
    return prepared(fit, recordings_of(fit, files[0], train, validate, columns), draws)


def _of_gap(file: Path) -> Document:
    from ..reports.gap.report import gap_report
    from ..reports.gap.saved import load_gap

    return gap_report(*load_gap(file))


def _of_track(file: Path) -> Document:
    from ..reports.track.digest import load_track
    from ..reports.track.report import track_report

    return track_report(load_track(file))


OTHERS = {"greybox-gap": _of_gap, "greybox-track": _of_track}
"""What a file says it is -> its report, where it is no fit; each loads libraries that the others do without."""


def _side_by_side(files: Sequence[Path], train: Sequence[str], validate: str | None, columns: str | None) -> Document:
    from ..reports.comparison import NamedFit, comparison

    if len({file.resolve() for file in files}) < len(files):
        raise BadInput(f"{', '.join(map(str, files))}: one fit is named twice; name each once.")
    fits = [load(file, build) for file in files]
    return comparison(
        [
            NamedFit(name, fit, tuple(recordings_of(fit, file, train, validate, columns)))
            for name, fit, file in zip(_names(files), fits, files, strict=True)
        ]
    )


def _names(files: Sequence[Path]) -> list[str]:
    """Short names that differ: of the file where that suffices, with its folder otherwise."""
    for parts in (1, 2):
        names = ["/".join(file.with_suffix("").parts[-parts:]) for file in files]
        if len(set(names)) == len(names):
            return names
    return [str(file) for file in files]


def recordings_of(
    fit: Fit,
    fit_file: Path,
    train: Sequence[str] = (),
    validate: str | None = None,
    columns: str | None = None,
    option: str = "--{role}",
) -> list[Recording]:
    """The recordings of a fit, from where it found them or from where they have moved."""
    from ..api.fit_result import found_again
    from ..datasets.read import read

    moved = {"train": list(train), "validate": [validate] if validate else []}
    for role, files in moved.items():
        count = sum(record.role == role for record in fit.data)
        if files and len(files) != count:
            named = option.format(role=role)
            raise BadInput(
                f"{fit_file} was made with {counted(count, 'recording')} to {role}, but {named} names {len(files)}."
            )
    result = []
    for record in fit.data:
        files = moved.get(record.role, [])
        file = (
            Path(files.pop(0))
            if files
            else found_again(record, fit_file, f"Name the file's new place with {option.format(role=record.role)}.")
        )
        whole = read(file, columns or record.mapping)
        result.append(part(whole, span(record.between) if record.between else None, record.where or None))
    return result
