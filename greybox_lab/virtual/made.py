"""Making the synthetic recordings from a seed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from greybox_id.base.errors import BadInput, near_or_all
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
    "racer": ("synthetic 1:10 car, two recordings in the columns of roboracer; the shipped seed is 20240", _racer),
    "simrod": ("synthetic SimRod, steps and sines, the tyres' true forces in a folder beside", _simrod),
    "virtual_lap": ("a lap of a vehicle drawn by the seed, double-track, in canonical columns", _virtual_lap),
}
"""Name -> what it is, and what writes it to a folder."""


def make(name: str, folder: Path, seed: int | None = None) -> tuple[Path, ...]:
    """Write synthetic recordings to a folder; the same seed writes the same.

    Parameters
    ----------
    name : one of `MADE`.
    folder : is made if need be.
    seed : of all that is random; None takes the recording's own.

    Raises
    ------
    BadInput
        There is no such recording, or the folder cannot be written to.
    """
    if name not in MADE:
        raise BadInput(f'There is no synthetic recording "{name}".{near_or_all(name, MADE)}')
    try:
        return MADE[name][1](folder, seed)
    except OSError as error:
        raise BadInput(f"{folder} cannot be written to: {error.strerror}. Name another folder with ‹out›.") from error
