"""The kinds of files that recordings lie in, behind one door: `contents` reads what is there, `write` writes.

A file's content says what it is; its name decides where the content says nothing. Each kind has a module with
`contents(file, mapping)` and `write(columns, path)`, which is all that a new one needs.
"""

from __future__ import annotations

import hashlib
from importlib import import_module
from pathlib import Path

from ...base.errors import BadInput
from ...base.files import near_file, replacing
from ...base.guard import protect
from ..column_map import ColumnMap
from ..recording import Recording
from .contents import Contents, Group, columns_of, few_enough

__all__ = ["SUFFIXES", "WRITTEN", "Contents", "Group", "bare_name", "contents", "hash_of", "write"]

SUFFIXES = {
    ".csv": "text", ".csv.gz": "text", ".txt": "text", ".tsv": "text", ".dat": "text", ".log": "text",
    ".jsonl": "json_lines", ".json": "json_lines", ".ndjson": "json_lines", ".json.gz": "json_lines",
    ".vbo": "racelogic", ".xrk": "aim", ".xrz": "aim", ".erg": "carmaker", ".parquet": "parquet",
    ".mat": "matlab", ".h5": "hdf5", ".hdf5": "hdf5",
    ".mf4": "mdf", ".mdf": "mdf", ".mcap": "ros", ".db3": "ros", ".bag": "ros",
}  # fmt: skip
"""How a file's name ends -> the module that reads it."""
WRITTEN = (".csv", ".parquet", ".mat", ".h5", ".mf4", ".mcap")
"""What can be written."""
MAGIC = (
    (b"PAR1", "parquet"), (b"\x89HDF\r\n\x1a\n", "hdf5"), (b"MATLAB ", "matlab"), (b"MDF ", "mdf"),
    (b"UnFinMF ", "mdf"), (b"CM-ERG", "carmaker"), (b"\x89MCAP0\r\n", "ros"), (b"SQLite format 3\0", "ros"),
    (b"#ROSBAG V", "ros"),
)  # fmt: skip
"""How content begins -> the module that reads it."""
BAG = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
"""What lies in the folder of a ROS 2 bag."""


def contents(file: Path, mapping: ColumnMap) -> Contents:
    """What is in a file, or in a folder with a ROS 2 bag.

    Raises
    ------
    BadInput
        The file cannot be read, is damaged or of no known kind, or an extra is missing: the sentence says which.
    """
    head = _head(file)
    protect(file)
    suffix = _suffix(file)
    module = next((kind for magic, kind in MAGIC if head.startswith(magic)), None)
    module = "ros" if file.is_dir() else module or (SUFFIXES[suffix] if suffix else None)
    if module is None:
        raise BadInput(f"{file}: cannot tell the kind of file from its name; {', '.join(SUFFIXES)} can be read.")
    result: Contents = import_module(f".{module}", __name__).contents(file, mapping)
    few_enough(len(result.names), str(file))
    return result


def write(recording: Recording, path: Path) -> None:
    """Write a recording under the canonical names, in SI units, as the file's name says.

    Raises
    ------
    BadInput
        No such kind can be written, the place cannot be written to, or an extra is missing.
    """
    suffix = _suffix(path)
    if suffix not in WRITTEN:
        raise BadInput(f"{path}: recordings are written as {', '.join(WRITTEN)}; name such a file with ‹out›.")
    with replacing(path) as beside:
        import_module(f".{SUFFIXES[suffix]}", __name__).write(columns_of(recording), beside)


def bare_name(file: Path) -> str:
    """The file's name without what says its kind."""
    suffix = "" if file.is_dir() else _suffix(file) or ""
    return file.name[: len(file.name) - len(suffix)] or file.name


def hash_of(file: Path) -> str:
    """SHA-256 of a file's bytes; of a folder, of the names and hashes of the files in it."""
    if file.is_dir():
        inside = sorted(file for file in file.rglob("*") if file.is_file())
        lines = [f"{item.relative_to(file).as_posix()} {hash_of(item)}\n" for item in inside]
        return hashlib.sha256("".join(lines).encode()).hexdigest()
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _suffix(file: Path) -> str | None:
    fitting = [suffix for suffix in SUFFIXES if file.name.lower().endswith(suffix)]
    return max(fitting, key=len) if fitting else None


def _head(file: Path) -> bytes:
    """How the file begins, or a sentence why it cannot be read."""
    try:
        if file.is_dir():
            if not any(path.name.endswith(BAG) for path in file.iterdir()):
                raise BadInput(f"{file} is a folder; name a file in it, or the folder of a ROS 2 bag.")
            return b""
        with file.open("rb") as opened:
            head = opened.read(16)
    except FileNotFoundError as error:
        raise BadInput(f"{file}: there is no such file.{near_file(file)} Check the path.") from error
    except PermissionError as error:
        raise BadInput(f"{file} may not be read: permission denied. Change its permissions.") from error
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "no valid path"
        raise BadInput(f"{file} cannot be read ({reason}). Check the path.") from error
    if not head:
        raise BadInput(f"{file} is empty (0 bytes). Name a file with a recording in it.")
    return head
