"""The synthetic recordings for the entry point `greybox.recordings`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from greybox_id.datasets.formats import write as write_recording


def _racer(folder: Path, seed: int | None) -> tuple[Path, ...]:
    from .synthetic_racer.drive import SEED, make

    return make(folder, SEED if seed is None else seed)


def _simrod(folder: Path, seed: int | None) -> tuple[Path, ...]:
    from .synthetic_simrod import write

    return write(folder, seed or 0)


def _virtual_lap(folder: Path, seed: int | None) -> tuple[Path, ...]:
    from .virtual_vehicle import drive, random_vehicle

    chosen = seed or 0
    recording, _ = drive(random_vehicle(chosen), "laps", seed=chosen)
    path = folder / f"virtual_lap_{chosen}.csv"
    write_recording(recording, path)
    return (path,)


MADE: dict[str, tuple[str, Callable[[Path, int | None], tuple[Path, ...]]]] = {
    "racer": (
        "synthetic 1:10 car: two recordings with the columns of roboracer; those in the package have seed 20240",
        _racer,
    ),
    "simrod": (
        "synthetic SimRod (a small electric car): step and sine steers; a second folder has the true tyre forces",
        _simrod,
    ),
    "virtual_lap": ("a lap of a double-track vehicle with random parameters, in canonical columns", _virtual_lap),
}
"""Name -> description, and function that writes it to a folder."""
