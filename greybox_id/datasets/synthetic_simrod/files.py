"""The synthetic SimRod's recordings as CSV files, the truth in a folder of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from ...files import at_once, write_atomically
from .drive import make
from .manoeuvres import Array

TRUTH = "truth"


def write(folder: str | Path, seed: int = 0) -> tuple[Path, ...]:
    """Write a recording per manoeuvre, and what is true of it to the folder `truth` inside under the same name.

    The recordings have the columns of the column map "canonical".

    Parameters
    ----------
    folder : where to write; made if need be.
    seed : of the sensors' noise.

    Returns
    -------
    The recordings' paths.
    """
    target, written = Path(folder), []
    (target / TRUTH).mkdir(parents=True, exist_ok=True)
    with at_once():
        for number, test in enumerate(make(seed), 1):
            part = test.manoeuvre.part.replace(" ", "_")
            name = f"{part}_{number:02d}_{test.manoeuvre.kind}.csv"
            recorded = {"time": test.recording.time, **test.recording.signals}
            written.append(write_atomically(target / name, _csv(recorded)))
            write_atomically(target / TRUTH / name, _csv(test.truth.columns()))
    return tuple(written)


def _csv(columns: Mapping[str, Array]) -> str:
    return str(pd.DataFrame(dict(columns)).to_csv(index=False, float_format="%.8g", lineterminator="\n"))
