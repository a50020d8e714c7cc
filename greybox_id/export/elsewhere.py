"""Results that are no models, such as a policy; packages write them by the entry point `greybox.exporters`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from ..base.errors import BadInput
from ..base.extensions import EXPORTERS, extensions
from ..base.saved import format_of


class Exporter(Protocol):
    """Writes one kind of result.

    Attributes
    ----------
    format : of its files, `base.saved.Kind.format`.
    what : it is called, for people: "policy".
    targets : name -> what is written.
    """

    format: str
    what: str
    targets: Mapping[str, str]

    def load(self, path: str | Path) -> Any:
        """The result that a file holds."""

    def takes(self, result: object) -> bool:
        """Whether a value is such a result."""

    def write(self, result: Any, named: ForeignResult, target: str, to: str | Path) -> list[Path]:
        """Write it for a target into a folder; the files."""


@dataclass(frozen=True)
class ForeignResult:
    """What files and functions are called after, where the result comes from, and the command, for the manifest."""

    name: str
    source: str = ""
    command: str = ""


def exporter_of_file(path: str | Path) -> Exporter | None:
    """Who writes what a file holds; None where it is a fit or nobody knows it."""
    kind = format_of(path)
    return (
        next((extension for extension in extensions(EXPORTERS).values() if extension.format == kind), None)
        if kind
        else None
    )


def exporter_of(result: object) -> Exporter:
    """Who writes a value. Raises `BadInput` where nobody does."""
    for exporter in extensions(EXPORTERS).values():
        if exporter.takes(result):
            return exporter  # type: ignore[no-any-return]
    raise BadInput(f"model: a Fit, a Model, its name or a saved policy is needed, not {result!r:.60}.")
