"""Recordings that come with the package.

`racer_train` and `racer_valid` are made by `greybox_id.datasets.synthetic_racer`: a synthetic 1:10 car in
the columns and units of the RoboRacer recordings.
"""

from pathlib import Path

from ..errors import BadInput

FOLDER = Path(__file__).parent / "shipped"

SHIPPED = ("racer_train", "racer_valid")
"""Names `shipped` understands."""


def shipped(name: str) -> Path:
    """Path of a recording that comes with the package.

    Parameters
    ----------
    name : one of `SHIPPED`.

    Raises
    ------
    BadInput : no recording of that name, or its file is missing from the installation.
    """
    if name not in SHIPPED:
        raise BadInput(f"There is no shipped recording {name!r}; there are {', '.join(SHIPPED)}.")
    path = FOLDER / f"{name}.csv"
    if not path.is_file():
        raise BadInput(f"{path} is missing from this installation of greybox-id; install the package again.")
    return path
