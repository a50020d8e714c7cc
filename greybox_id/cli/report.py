"""`greybox report`: figures and a PDF of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from ..datasets.read import read
from ..errors import BadInput
from ..fit import Fit, load
from ..models.registry import build
from ..provenance import DataRecord
from ..recording import Recording
from .options import json_option
from .output import console, print_json


@click.command(name="report")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.option("--train", multiple=True, metavar="FILE", help="Training recording, where it has moved; repeatable.")
@click.option("--validate", metavar="FILE", help="Validation recording, where it has moved.")
@click.option("--columns", metavar="MAP", help="Column map; the one the fit names unless given.")
@click.option("--out", metavar="FILE", help="PDF to write; beside FIT unless given.")
@click.option("--figures", metavar="FOLDER", help="Also write the figures there, as SVG.")
@json_option
def report(
    fit_file: str,
    train: Sequence[str],
    validate: str | None,
    columns: str | None,
    out: str | None,
    figures: str | None,
    as_json: bool,
) -> None:
    """Write a PDF report of FIT, a file made by greybox fit.

    The recordings are read from where the fit found them, and must be the same files: their hashes are compared.
    """
    # The reports load the plotting library: commands that draw nothing, and --help, do without.
    from ..reports.drawing import write_drawings
    from ..reports.pdf import prepared, write_pdf

    path = Path(fit_file)
    fit = load(path, build)
    found = prepared(fit, recordings_of(fit, path, train, validate, columns))
    target = write_pdf(found, out or path.with_suffix(".pdf"))
    written = write_drawings(found.made, figures) if figures else []
    verdict = found.said.verdict
    if as_json:
        print_json({"report": str(target), "figures": [str(file) for file in written], "verdict": list(verdict)})
        return
    for sentence in verdict:
        console().print(sentence)
    for file in (target, *written):
        console().print(f"written  {file}")


def recordings_of(
    fit: Fit,
    fit_file: Path,
    train: Sequence[str] = (),
    validate: str | None = None,
    columns: str | None = None,
    option: str = "--{role}",
) -> list[Recording]:
    """The recordings of a fit, from where it found them or from where they have moved."""
    moved = {"train": list(train), "validate": [validate] if validate else []}
    for role, files in moved.items():
        count = sum(record.role == role for record in fit.data)
        if files and len(files) != count:
            named = option.format(role=role)
            raise BadInput(f"{fit_file} was made with {count} recordings to {role}, but {named} names {len(files)}.")
    found = []
    for record in fit.data:
        files = moved.get(record.role, [])
        file = Path(files.pop(0)) if files else _where(record, fit_file, option.format(role=record.role))
        found.append(read(file, columns or record.columns or "canonical"))
    return found


def _where(record: DataRecord, fit_file: Path, option: str) -> Path:
    """Where a recording lies: as the fit's command named it, else in the same place seen from the fit's folder."""
    if not record.path:
        raise BadInput(
            f"{fit_file} was fitted to a recording made in memory ({record.name}), which no file holds; make its "
            "report from Python with greybox_id.reports.pdf.report."
        )
    for place in (Path(record.path), fit_file.parent / record.path, fit_file.parent / Path(record.path).name):
        if place.is_file():
            return place
    raise BadInput(
        f"{record.path}, which {fit_file} was fitted with, is no longer there. Name the file's new place with {option}."
    )
