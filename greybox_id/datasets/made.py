"""Synthetic recordings, which installed packages make from a seed; the laboratory has three."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ..base.errors import BadInput, near_or_all
from ..base.extensions import RECORDINGS, extensions

Make = Callable[[Path, int | None], tuple[Path, ...]]
"""Writes recordings into a folder, from a seed; None takes the recording's own."""


def made() -> Mapping[str, tuple[str, Make]]:
    """Name -> what it is, and what writes it to a folder."""
    return {name: entry for table in extensions(RECORDINGS).values() for name, entry in table.items()}


def make(name: str, folder: Path, seed: int | None = None) -> tuple[Path, ...]:
    """Write synthetic recordings to a folder; the same seed writes the same.

    Parameters
    ----------
    name : one of `made`.
    folder : is made if need be.
    seed : of all that is random; None takes the recording's own.

    Raises
    ------
    BadInput
        There is no such recording, or the folder cannot be written to.
    """
    known = made()
    if name not in known:
        raise BadInput(f'There is no synthetic recording "{name}".{near_or_all(name, known)}')
    try:
        return known[name][1](folder, seed)
    except OSError as error:
        raise BadInput(f"{folder} cannot be written to: {error.strerror}. Name another folder with ‹out›.") from error
