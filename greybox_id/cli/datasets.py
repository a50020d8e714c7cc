"""`greybox datasets`: public recordings and synthetic ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ..base.json_data import attributes
from ..datasets.public import PUBLIC, PublicDataset, fetch, folder_of, made, make, public
from ..reports.text.screen import plain_table
from .commands import CommandGroup
from .options import FROM_ZERO, JSON, argument, command, names, option
from .output import console, print_json, progress, working


@click.group(cls=CommandGroup)
def datasets() -> None:
    """Fetch public recordings from their authors, or make synthetic ones.

    \b
    greybox datasets list
    greybox datasets fetch roboracer
    greybox datasets make racer --out recordings
    """  # fmt: skip


@command("list", of=datasets)
def list_command(
    as_json: bool = JSON,
) -> None:
    """List the recordings that can be fetched or made, with source and licence.

    \b
    greybox datasets list
    """  # fmt: skip
    if as_json:
        synthetic = [{"name": name, "about": about} for name, (about, _) in made().items()]
        print_json({"public": [_as_dict(item) for item in PUBLIC.values()], "made": synthetic})
        return
    out = console()
    for title, rows in (
        ("to fetch", [(one.name, one.about, f"{one.source}; {one.licence}", _state(one)) for one in PUBLIC.values()]),
        ("to make", [(name, about, "generated from a seed", "") for name, (about, _) in made().items()]),
    ):
        table = plain_table(title, "what", "source and licence", "", fold=True)
        for row in rows:
            table.add_row(*row)
        out.print(table)
        out.print()


@command("fetch", of=datasets)
def fetch_command(
    name: str = argument("NAME", shell_complete=names(PUBLIC)),
    out: str | None = option("Folder to which the files are written; default: the cache ($GREYBOX_CACHE).", "FOLDER"),
    as_json: bool = JSON,
) -> None:
    """Download the recordings NAME from their authors.

    Their SHA-256 is checked. A download that was interrupted is continued.

    \b
    greybox datasets fetch roboracer
    """  # fmt: skip
    dataset = public(name)
    with progress() as say:
        paths = fetch(dataset, Path(out) if out else None, say)
    if as_json:
        print_json({"name": name, "columns": dataset.columns, "files": [str(path) for path in paths]})
        return
    screen = console()
    for path in paths:
        screen.print(path)
    screen.print(f"the recordings belong to their authors ({dataset.licence}); cite: {dataset.reference}")
    if dataset.columns:
        screen.print(f"next: greybox data check {paths[0]} --columns {dataset.columns}")
    else:
        screen.print(f"next: greybox data map {paths[0]} proposes a column map; greybox bench needs no map")


@command("make", of=datasets)
def make_command(
    name: str = argument("NAME", shell_complete=names(made)),
    out: str = option("Folder to which the recordings are written.", "FOLDER", default="."),
    seed: int | None = option("Seed of all random numbers.", type=FROM_ZERO),
    as_json: bool = JSON,
) -> None:
    """Make the synthetic recordings NAME; the same seed makes the same recordings.

    \b
    greybox datasets make virtual_lap --seed 7 --out recordings
    """  # fmt: skip
    with working(f"making {name}"):
        paths = make(name, Path(out), seed)
    if as_json:
        print_json({"name": name, "seed": seed, "files": [str(path) for path in paths]})
        return
    for path in paths:
        console().print(path)


def _state(dataset: PublicDataset) -> str:
    if not dataset.files:
        return "download by hand"
    return "in the cache" if all((folder_of(dataset) / file.name).is_file() for file in dataset.files) else ""


def _as_dict(dataset: PublicDataset) -> dict[str, Any]:
    return {
        **attributes(dataset, "name", "about", "source", "licence", "reference", "columns"),
        "cached": _state(dataset) == "in the cache",
        "files": [{"name": f.name, "address": f.address, "sha256": f.sha256 or None} for f in dataset.files],
    }
