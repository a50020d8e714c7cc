"""Public recordings, listed in `public.toml`, and their download, which is resumed and checked by SHA-256.

Also synthetic recordings, which installed packages generate from a seed; the laboratory has three.
"""

from __future__ import annotations

import http.client
import json
import tomllib
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..base.errors import BadInput, near_or_all
from ..base.extensions import RECORDINGS, extensions
from ..base.files import cache_folder, replacing, writable, write_atomically
from ..base.guard import permit
from ..base.shorthands import Say
from ..base.version import __version__
from .formats import hash_of


@dataclass(frozen=True)
class Remote:
    """A file at its source.

    Attributes
    ----------
    name : of the local file.
    address : URL.
    sha256 : of its bytes; empty if unknown. The hash of the first download is then saved and later ones must match it.
    """

    name: str
    address: str
    sha256: str = ""


@dataclass(frozen=True)
class PublicDataset:
    """Recordings of one source.

    Attributes
    ----------
    name : in commands.
    about : what was recorded.
    source : the authors' page.
    licence : as the authors state it.
    reference : what to cite.
    columns : the shipped column map that fits; empty if a benchmark reads the files without one.
    files : downloadable files; empty if they have no known address.
    joined : name of a CSV file to make if each file is one column of it; empty if each file is a recording.
    """

    name: str
    about: str
    source: str
    licence: str
    reference: str
    columns: str = ""
    files: tuple[Remote, ...] = field(default=())
    joined: str = ""


def _dataset(name: str, table: dict[str, Any]) -> PublicDataset:
    at, files = table.pop("at", ""), table.pop("files", ())
    remotes = tuple(Remote(file["name"], at + file["path"], file.get("sha256", "")) for file in files)
    return PublicDataset(name, files=remotes, **table)


_TABLES = tomllib.loads(Path(__file__).with_name("public.toml").read_text("utf-8"))
PUBLIC = {name: _dataset(name, table) for name, table in _TABLES.items()}
"""Datasets by name, as `greybox datasets` lists them."""


def public(name: str) -> PublicDataset:
    """A dataset by name. Raises `BadInput` if there is none."""
    if name not in PUBLIC:
        raise BadInput(f'There is no public dataset "{name}".{near_or_all(name, PUBLIC)}')
    return PUBLIC[name]


CHUNK = 1 << 16
SECONDS = 30
"""Seconds without data after which a connection has failed."""
ATTEMPTS = 5
"""Number of connections tried for one file; each resumes the transfer."""
HASHES = "sha256.json"
"""File with the hashes of first downloads, for files whose hash `public.toml` does not state."""


def fetch(dataset: PublicDataset, folder: Path | None = None, say: Say = lambda _: None) -> tuple[Path, ...]:
    """Download those of a dataset's files that are not in the folder yet.

    Parameters
    ----------
    dataset : the dataset.
    folder : target; None takes the folder `datasets` of the cache.
    say : called with lines about progress.

    Returns
    -------
    The recordings' paths.

    Raises
    ------
    BadInput
        The source cannot be reached or does not have the file, or the file has another hash than expected.
    """
    if not dataset.files:
        raise BadInput(
            f"The files of {dataset.name} have no known address on the web; fetch them from {dataset.source} "
            f"yourself and read them with ‹columns› {dataset.columns}."
        )
    target = folder or folder_of(dataset)
    known = _known(target)
    paths = []
    for remote in dataset.files:
        path = target / remote.name
        expected = remote.sha256 or known.get(remote.name, "")
        if path.is_file() and (not expected or hash_of(path) == expected):
            say(f"{remote.name} is there")
        else:
            _fetched(remote, path, expected, say)
        if not remote.sha256:
            known[remote.name] = hash_of(path)
            write_atomically(target / HASHES, json.dumps(known, indent=1) + "\n", continued=True)
        paths.append(path)
    return (_joined(paths, target / dataset.joined),) if dataset.joined else tuple(paths)


def folder_of(dataset: PublicDataset) -> Path:
    """A dataset's folder in the cache."""
    return cache_folder() / "datasets" / dataset.name


def _fetched(remote: Remote, path: Path, expected: str, say: Say) -> None:
    part = path.with_name(f"{path.name}.part")
    with writable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        for attempt in range(1, ATTEMPTS + 1):
            if _transferred(remote, part, say):
                break
            say(
                f"the download of {remote.name} broke off after {part.stat().st_size} bytes, attempt {attempt} of "
                f"{ATTEMPTS}"
            )
        else:
            raise BadInput(
                f"The download of {remote.address} broke off {ATTEMPTS} times. The part that arrived is kept in "
                f"{part}; repeat the "
                "command to continue."
            )
        result = hash_of(part)
        if expected and result != expected:
            part.unlink()
            raise BadInput(
                f"{remote.address} is not the expected file: its SHA-256 is {result}, not {expected}. The file was "
                "not kept. Its authors may have changed it, or it was damaged on the way."
            )
        permit(part, path)
        part.replace(path)


def _transferred(remote: Remote, part: Path, say: Say) -> bool:
    """Download the missing rest of a file; False if the connection broke off before its end."""
    have = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(remote.address, headers={"User-Agent": f"greybox-id/{__version__}"})
    if have:
        request.add_header("Range", f"bytes={have}-")
    try:
        with urllib.request.urlopen(request, timeout=SECONDS) as answer:
            if answer.status != http.client.PARTIAL_CONTENT:
                have = 0  # the server sends all of it again
            length = answer.headers.get("Content-Length")
            whole = have + int(length) if length else None
            size = f", {whole / 1e6:.2f} MB" if whole else ""
            say(f"{'going on with' if have else 'fetching'} {remote.name}{size}")
            with part.open("ab" if have else "wb") as opened:
                while chunk := answer.read(CHUNK):
                    opened.write(chunk)
        return whole is None or part.stat().st_size >= whole
    except urllib.error.HTTPError as error:
        if error.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE and have:
            return True  # the part is already complete; its hash is checked next
        raise BadInput(f"{remote.address} answers {error.code} {error.reason}; has it moved?") from error
    except (urllib.error.URLError, TimeoutError, ConnectionError, http.client.HTTPException) as error:
        if part.exists() and part.stat().st_size > have:
            return False
        reason = getattr(error, "reason", error)
        raise BadInput(
            f"{remote.address} cannot be reached ({reason}). Is this machine online? Repeat the command when it is; "
            "the part that has arrived is kept."
        ) from error


def _known(folder: Path) -> dict[str, Any]:
    try:
        known = json.loads((folder / HASHES).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def _joined(paths: list[Path], target: Path) -> Path:
    """Write one CSV file from files that hold one column each."""
    columns = {}
    for path in paths:
        try:
            columns[path.stem] = np.loadtxt(path, ndmin=1)
        except (ValueError, OSError) as error:
            raise BadInput(f"{path} holds no column of numbers ({error}). Remove it and fetch again.") from error
    lengths = {len(values) for values in columns.values()}
    if len(lengths) != 1:
        raise BadInput(f"{target}: its columns have {sorted(lengths)} rows. Remove {target.parent} and fetch again.")
    with replacing(target) as beside:
        pd.DataFrame(columns).to_csv(beside, index=False)
    return target


Make = Callable[[Path, int | None], tuple[Path, ...]]
"""Writes recordings into a folder, from a seed; None takes the recording's default seed."""


def made() -> Mapping[str, tuple[str, Make]]:
    """Name -> (description, function that writes the recordings)."""
    return {name: entry for table in extensions(RECORDINGS).values() for name, entry in table.items()}


def make(name: str, folder: Path, seed: int | None = None) -> tuple[Path, ...]:
    """Write synthetic recordings to a folder; the same seed gives the same recordings.

    Parameters
    ----------
    name : one of `made`.
    folder : made if it does not exist.
    seed : of all random numbers; None takes the recording's default.

    Raises
    ------
    BadInput
        There is no such recording, or the folder cannot be written to.
    """
    known = made()
    if name not in known:
        raise BadInput(f'There is no synthetic recording "{name}".{near_or_all(name, known)}')
    try:
        return known[name][1](folder, seed)
    except OSError as error:
        raise BadInput(f"{folder} cannot be written to: {error.strerror}. Name another folder with ‹out›.") from error
