"""A folder of generated files that appears whole or not at all, with a manifest of what it holds."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import BadInput
from ..json_data import read_json, without_nan

MANIFEST = "manifest.json"
FORMAT = "greybox-export"


def write_folder(folder: Path, files: Mapping[str, bytes], about: Mapping[str, Any]) -> list[Path]:
    """Write files and their manifest beside the folder's place, then put them there.

    A folder that is there already is replaced if it is an export that nobody has touched since, or empty.

    Parameters
    ----------
    files : path within the folder -> content.
    about : what the manifest says besides the files' SHA-256.

    Raises
    ------
    BadInput : the folder holds what would be lost, or cannot be written.
    """
    _must_be_replaceable(folder)
    manifest = {"format": FORMAT, **about, "files": {name: _sha256(content) for name, content in files.items()}}
    text = json.dumps(without_nan(manifest), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
        try:
            made = beside / "new"
            for name, content in {**files, MANIFEST: text.encode()}.items():
                (made / name).parent.mkdir(parents=True, exist_ok=True)
                (made / name).write_bytes(content)
            if folder.exists():
                folder.rename(beside / "old")
            made.rename(folder)
        finally:
            if (beside / "old").exists() and not folder.exists():
                (beside / "old").rename(folder)
            shutil.rmtree(beside, ignore_errors=True)
    except OSError as error:
        raise BadInput(f"{folder} cannot be written: {error.strerror}. Name another place with --out.") from error
    return [folder / name for name in (*files, MANIFEST)]


def _must_be_replaceable(folder: Path) -> None:
    if not folder.exists() and not folder.is_symlink():
        return
    if not folder.is_dir() or folder.is_symlink():
        raise BadInput(f"{folder} is no folder. Name another place with --out.")
    held = {str(file.relative_to(folder)): file for file in folder.rglob("*") if not file.is_dir()}
    if not held:
        return
    known = _files_of(folder / MANIFEST) if MANIFEST in held else None
    if known is None:
        raise BadInput(f"{folder} holds files that are no export. Name a new folder with --out.")
    own = [name for name, file in held.items() if name != MANIFEST and known.get(name) != _sha256(file.read_bytes())]
    if own:
        raise BadInput(
            f"{folder} holds {', '.join(sorted(own)[:3])}, which the export there did not write or which was changed "
            "since; it would be lost. Name another place with --out, or move it away."
        )


def _files_of(manifest: Path) -> Mapping[str, str] | None:
    """The files an export wrote; None where this is no manifest of one."""
    try:
        body = read_json(manifest)
    except BadInput:
        return None
    files = body.get("files") if isinstance(body, dict) and body.get("format") == FORMAT else None
    return files if isinstance(files, dict) else None


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
