"""A folder of generated files that appears whole or not at all, with a manifest of what it holds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.errors import BadInput
from ..base.files import new_folder
from ..base.guard import claim, permit_folder
from ..base.json_data import read_json, without_nan

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
    claim(folder)
    _must_be_replaceable(folder, _words(about))
    manifest = {"format": FORMAT, **about, "files": {name: _sha256(content) for name, content in files.items()}}
    text = json.dumps(without_nan(manifest), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    with new_folder(folder) as made:
        for name, content in {**files, MANIFEST: text.encode()}.items():
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes(content)
    return [folder / name for name in (*files, MANIFEST)]


def _must_be_replaceable(folder: Path, becomes: str) -> None:
    if not folder.exists() and not folder.is_symlink():
        return
    if not folder.is_dir() or folder.is_symlink():
        raise BadInput(f"{folder} is no folder. Name another place with ‹out›.")
    held = {str(file.relative_to(folder)): file for file in folder.rglob("*") if not file.is_dir()}
    if not held:
        return
    body = _manifest(folder / MANIFEST) if MANIFEST in held else None
    known = body.get("files") if body is not None else None
    if known is None or body is None:
        raise BadInput(f"{folder} holds files that are no export. Name a new folder with ‹out›.")
    one = [name for name, file in held.items() if name != MANIFEST and known.get(name) != _sha256(file.read_bytes())]
    if one:
        raise BadInput(
            f"{folder} holds {', '.join(sorted(one)[:3])}, which the export there did not write or which was changed "
            "since; it would be lost. Name another place with ‹out›, or move it away."
        )
    permit_folder(folder, _words(body), becomes)


def _manifest(file: Path) -> Mapping[str, Any] | None:
    """What an export wrote of itself; None where this is no manifest of one."""
    try:
        body = read_json(file)
    except BadInput:
        return None
    value = isinstance(body, dict) and body.get("format") == FORMAT and isinstance(body.get("files"), dict)
    return body if value else None


def _words(about: Mapping[str, Any]) -> str:
    """What an export is of: another model or target is another export."""
    model = about.get("model")
    named = model.get("name") if isinstance(model, Mapping) else None
    return f"an export of {named} for {about.get('target')}"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
