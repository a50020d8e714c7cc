"""`greybox report`: what a fit, a diagnosis, a track or several fits side by side say, as PDF or HTML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from .options import json_option, own_option
from .output import console, print_json, working


@click.command(name="report")
@click.argument("files", nargs=-1, required=True, metavar="FIT|GAP|TRACK...", type=click.Path())
@click.option(
    "--train", multiple=True, metavar="FILE", help="New path of a training recording that was moved; repeatable."
)
@click.option("--validate", metavar="FILE", help="New path of the validation recording if it was moved.")
@click.option("--columns", metavar="MAP", help="Column map; default: the one that the fit names.")
@click.option(
    "--format", "kind", type=click.Choice(["pdf", "html"]), help="Default: from the suffix of --out, else pdf."
)
@click.option("--out", metavar="FILE", help="File to write; default: beside the first file.")
@click.option("--posterior", metavar="FILE", help="Draws of greybox sample for one FIT: adds bands and a corner plot.")
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
    from ..api.reporting import beside, reported  # the typesetter, which --help does without

    target = Path(out) if out is not None else beside(files, kind or "pdf")
    moved = {"train": train, "validate": [validate] if validate else []}
    with working(f"writing {target}"):
        done = reported(files, target, kind, columns=columns, moved=moved, posterior=posterior, figures=figures)
    if as_json:
        figured = [str(file) for file in done.figures]
        print_json({"report": str(done.file), "figures": figured, "verdict": list(done.verdict)})
        return
    for sentence in done.verdict:
        console().print(sentence)
    for file in (done.file, *done.figures):
        console().print(f"written  {file}")
