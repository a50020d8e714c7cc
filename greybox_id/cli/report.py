"""`greybox report`: a report of a fit, a diagnosis or a track, or a comparison of fits, as PDF or HTML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from .options import FILE, JSON_AND_OWN, argument, command, option
from .output import console, print_json, working


@command("report")
def report(
    files: Sequence[str] = argument("FIT|GAP|TRACK...", type=FILE, required=True),
    train: Sequence[str] = option("New path of a training recording, if it was moved; repeatable.", "FILE"),
    validate: str | None = option("New path of the validation recording, if it was moved.", "FILE"),
    columns: str | None = option("Column map; default: the one that the fit names.", "MAP"),
    kind: Literal["pdf", "html"] | None = option(
        "Format of the report; default: by the ending of --out, else pdf.", name="--format"
    ),
    out: str | None = option("File to write; default: next to the first file.", "FILE"),
    posterior: str | None = option(
        "File of draws that greybox sample wrote. A report of one FIT then also has uncertainty bands and a corner "
        "plot.",
        "FILE",
    ),
    figures: str | None = option("Also write the figures to this folder, as SVG.", "FOLDER"),
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Write a report with figures on a FIT, a GAP or a TRACK, or compare several FITs.

    FIT is a fit.json; GAP is the gap.json of greybox gap --out; TRACK is the .json that greybox track writes next to
    its table.

    \b
    greybox report run/fit.json
    greybox report run/fit.json --format html
    greybox report run/fit.json --posterior posterior.parquet
    greybox report gap/gap.json --out gap.html
    greybox report estimates.json
    greybox report run/fit.json other/fit.json --out comparison.pdf

    The recordings of a FIT are read from their former paths and must be unchanged.
    """
    from ..api.reporting import beside, reported  # imports the typesetter, which --help does not need

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
