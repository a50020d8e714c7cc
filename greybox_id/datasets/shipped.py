"""Recordings, vehicles and column maps that come with the package.

`racer_train` and `racer_valid` were made by `greybox_lab.virtual.synthetic_racer`: a synthetic 1:10 car in
the columns and units of the RoboRacer recordings.
"""

from pathlib import Path

from ..base.errors import BadInput, near
from ..base.files import near_file
from ..base.toml_file import small_text

FOLDER = Path(__file__).parent / "shipped"

SHIPPED = ("racer_train", "racer_valid")
"""Names that `shipped` accepts."""


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
    >>> gb.datasets.shipped("racer_train").name
    'racer_train.csv'
    """
    if name not in SHIPPED:
        raise BadInput(f"There is no shipped recording {name!r}; choose one of {', '.join(SHIPPED)}.")
    path = FOLDER / f"{name}.csv"
    if not path.is_file():
        raise BadInput(f"{path} is missing from this installation of greybox-id; install the package again.")
    return path


def shipped_files(folder: str) -> tuple[str, ...]:
    """Names of the TOML files that come with the package in a subfolder of this one."""
    return tuple(sorted(file.stem for file in (FOLDER.parent / folder).glob("*.toml")))


def named_text(text: str, folder: str, what: str, suffixes: tuple[str, ...] = (".toml",)) -> tuple[str, Path]:
    """The text of a shipped file with this name or of a user's file at this path, and the file's name or path.

    Parameters
    ----------
    folder : of the shipped files.
    what : kind of file, for errors; "column map" or a word to which " file" is added.
    suffixes : allowed for a user's file.

    Raises
    ------
    BadInput : there is no such file.
    """
    names = shipped_files(folder)
    if text in names:
        return (FOLDER.parent / folder / f"{text}.toml").read_text("utf-8"), Path(f"{text}.toml")
    if Path(text).suffix.lower() not in suffixes:
        raise BadInput(
            f'There is no {what} "{text}".{near(text, names) or near_file(Path(text))} '
            f"Shipped {what.split()[-1]}s: {', '.join(names)}; "
            f"name your own by the path of its {' or '.join(suffixes)} file."
        )
    return small_text(text, what if what.endswith("map") else f"{what} file"), Path(text)
