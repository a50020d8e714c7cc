"""Rows that a vehicle has driven last, on disk as recordings that every command reads."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from .. import __version__
from ..datasets.read import read
from ..files import replacing, write_atomically
from ..recording import Recording

ROWS = 20_000
"""Rows that are kept."""
FLUSHED, SECONDS = 500, 5.0
"""Rows, or s, after which they are written."""


class Buffer:
    """The last rows, in parts of a folder: part-000001.csv, and beside it part-000001.json with what drove.

    Parameters
    ----------
    folder : of the parts; those that are there count.
    rows : that are kept; the oldest parts are removed once they are not needed for so many.
    """

    def __init__(self, folder: Path, rows: int = ROWS) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._rows = folder, rows
        self._waiting: list[Mapping[str, float]] = []
        self._since = time.monotonic()
        self._parts = {own: _length(own) for own in self.parts()}
        self._next = 1 + max((int(own.stem.split("-")[1]) for own in self._parts), default=0)
        self.about: Mapping[str, Any] = {}

    def add(self, row: Mapping[str, float]) -> Path | None:
        """A row, name -> value in SI units, with its time and the number of its run; the part, when one was written."""
        self._waiting.append(dict(row))
        if len(self._waiting) >= FLUSHED or time.monotonic() - self._since >= SECONDS:
            return self.flush()
        return None

    def flush(self) -> Path | None:
        """Write what waits."""
        self._since = time.monotonic()
        if len(self._waiting) < 2:  # one row is no recording
            return None
        file = self._folder / f"part-{self._next:06d}.csv"
        about = {"software": __version__, "rows": len(self._waiting), **self.about}
        write_atomically(file.with_suffix(".json"), json.dumps(about) + "\n", continued=True)
        with replacing(file, continued=True) as beside:
            pd.DataFrame(self._waiting).to_csv(beside, index=False, float_format="%.9g")
        self._parts[file] = len(self._waiting)
        self._next, self._waiting = self._next + 1, []
        held = sum(self._parts.values())
        for old in sorted(self._parts):
            if held - self._parts[old] < self._rows:
                break
            held -= self._parts.pop(old)
            old.unlink(missing_ok=True)
            old.with_suffix(".json").unlink(missing_ok=True)
        return file

    def __len__(self) -> int:
        """Rows that are kept and that wait."""
        return sum(self._parts.values()) + len(self._waiting)

    def parts(self) -> list[Path]:
        """Files of rows, in order."""
        return sorted(self._folder.glob("part-[0-9]*.csv"))

    def recordings(self) -> list[Recording]:
        """What was written."""
        return [read(own) for own in self.parts()]


def _length(part: Path) -> int:
    """Rows of a part."""
    with part.open("rb") as opened:
        return sum(1 for _ in opened) - 1
