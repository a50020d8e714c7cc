"""The fit that a command builds on."""

from __future__ import annotations

from pathlib import Path

from ..fit import Fit, load
from ..models.registry import build
from ..verdict import NOT_USABLE
from .terminal import tell


def fit_of(file: str | Path) -> Fit:
    """The fit of a file; where its verdict is that it cannot be used, a warning says so. Raises `BadInput`."""
    found = load(file, build)
    if found.verdict is not None and found.verdict.usability == NOT_USABLE:
        tell(
            f"warning: {file} is {NOT_USABLE}: {' '.join(found.verdict.reasons[:1])} What follows from it is no better."
        )
    return found
