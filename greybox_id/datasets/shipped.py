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

    Returns
    -------
    Path
        A CSV file, to be read with the column map "roboracer".

    Raises
    ------
    BadInput : no recording of that name, or its file is missing from the installation.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.shipped("racer_train").name
    'racer_train.csv'
    """
    if name not in SHIPPED:
        raise BadInput(f"There is no shipped recording {name!r}; there are {', '.join(SHIPPED)}.")
    path = FOLDER / f"{name}.csv"
    if not path.is_file():
        raise BadInput(f"{path} is missing from this installation of greybox-id; install the package again.")
    return path
