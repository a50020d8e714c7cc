"""Writing files so that nothing already on disk is lost."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import BadInput, nearest


def cache_folder() -> Path:
    """$GREYBOX_CACHE, else the folder greybox-id of $XDG_CACHE_HOME or ~/.cache; it need not be there.

    Raises `RuntimeError` where nobody's home is known.
    """
    named = os.environ.get("GREYBOX_CACHE")
    return Path(named) if named else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "greybox-id")


def write_atomically(path: Path, text: str) -> Path:
    """Write a text beside its target, then replace that. Raises `BadInput` where that is not allowed."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8")
    return path


def near_file(path: Path) -> str:
    """A question that names the file which was meant, of those where it was looked for; empty if nothing is near.

    Where the folder itself is not there, that is said; with a leading space.
    """
    try:
        if path.exists():
            return ""
        if not path.parent.is_dir():
            return f" There is no folder {path.parent}."
        found = nearest(path.name, (own.name for own in path.parent.iterdir()))
    except (OSError, ValueError):  # ValueError: a null byte in the path
        return ""
    return f" Did you mean {path.parent / found}?" if found is not None else ""


def ensure_writable(folder: Path) -> None:
    """Raise `BadInput` if nothing can be written to a folder, which is made; better before long work than after."""
    with replacing(folder / ".greybox") as beside:
        beside.touch()
    (folder / ".greybox").unlink(missing_ok=True)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A file beside the target to write to; it replaces the target when all went well, else it is gone."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix)
        os.close(handle)
        beside = Path(name)
        try:
            yield beside
            beside.chmod(0o644)
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise BadInput(f"{path} cannot be written: {error.strerror}. Name another place with --out.") from error
