"""JSON that knows numbers which are not finite, and checksums of what it holds."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .errors import BadInput
from .files import near_file

NOT_FINITE = "not_finite"
"""JSON has no word for numbers that are not finite; they are written as {"not_finite": "nan"}, "inf" or "-inf"."""


def without_nan(value: Any) -> Any:
    """Plain data in which numbers that are not finite are written out in words."""
    if isinstance(value, Mapping):
        return {name: without_nan(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return {NOT_FINITE: str(float(value))}
    return value


def plain(value: Any) -> Any:
    """Plain data without numpy's own kinds of number."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    return value


def finite(value: Any) -> Any:
    """Plain data as readers expect it who know nothing of NaN and infinities: they become null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(inner) for inner in value]
    return value


def _with_nan(body: dict[str, Any]) -> Any:
    if set(body) == {NOT_FINITE} and body[NOT_FINITE] in ("nan", "inf", "-inf"):
        return float(body[NOT_FINITE])
    return body


def read_json(file: Path) -> Any:
    """What a file written with `without_nan` holds."""
    try:
        return json.loads(file.read_text(encoding="utf-8"), object_hook=_with_nan)
    except OSError as error:
        raise BadInput(f"{file} cannot be read: {error.strerror}.{near_file(file)}") from error
    except (ValueError, RecursionError) as error:
        if _begins(file) not in (b"{", b"[", b""):
            raise BadInput(f"{file} is not JSON; name a file that greybox-id wrote, such as fit.json.") from error
        raise BadInput(f"{file} is damaged: it is not JSON ({error}). Restore it, or make it again.") from error


def _begins(file: Path) -> bytes:
    """The first character of a file that is no blank."""
    with file.open("rb") as stream:
        return stream.read(1000).lstrip()[:1]


def checksum(body: Mapping[str, Any]) -> str:
    """Hash of plain data, whatever the order of its keys."""
    plain = json.dumps(body, sort_keys=True, allow_nan=True, default=list)
    return hashlib.sha256(plain.encode()).hexdigest()
