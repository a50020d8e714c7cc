"""The synthetic racer's recordings as CSV files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ...files import write_atomically
from .drive import RUNS, drive
from .sensors import COLUMNS

SEED = 20240
"""Of the recordings that come with the package."""

_FORMATS = ("%.2f", "%.1f", "%.5f", "%.5f", "%.3f", "%.5f", "%.4f", "%.4f", "%.4f", "%.5f")
"""Of each column: some digits finer than its noise."""


def run_table(name: str, number: int, seed: int = SEED) -> dict[str, np.ndarray]:
    """Columns of one run of a recording, unrounded, in the file's units.

    Parameters
    ----------
    name : of the recording, a key of `RUNS`.
    number : of the run, from 0. Each run has its own random numbers: it can be made without the others.
    seed : of the recordings.
    """
    rng = np.random.default_rng([seed, list(RUNS).index(name), number])
    return drive(RUNS[name][number], rng)


def make(folder: str | os.PathLike[str], seed: int = SEED) -> tuple[Path, ...]:
    """Write `racer_train.csv` (about 2 min) and `racer_valid.csv` (about 1 min), 20 Hz.

    The same seed writes the same bytes on the same machine. A file is complete or not there.

    Parameters
    ----------
    folder : where to write; made if need be.
    seed : of lines, noise and sensor faults.

    Returns
    -------
    The files' paths.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    return tuple(_write(target / f"{name}.csv", name, seed) for name in RUNS)


def _write(path: Path, name: str, seed: int) -> Path:
    lines = [",".join(COLUMNS)]
    for number in range(len(RUNS[name])):
        table = run_table(name, number, seed)
        for row in zip(*(table[column].tolist() for column in COLUMNS), strict=True):
            # Adding zero turns the -0.0 of rounding into 0.0.
            lines.append(",".join(f % (round(v, int(f[2])) + 0.0) for f, v in zip(_FORMATS, row, strict=True)))
    return write_atomically(path, "\n".join(lines) + "\n")
