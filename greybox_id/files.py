"""Writing files so that nothing already on disk is lost."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import BadInput


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
