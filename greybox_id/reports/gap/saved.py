"""The file of a diagnosis: what it says and what it was made with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...gap import Gap
from ...gap.saved import as_plain_data, from_plain_data
from ...provenance import DataRecord
from ...saved import Kind
from .content import Made, Number

KIND = Kind("greybox-gap", 1, "a diagnosis", "greybox gap", "diagnose again")


def as_text(gap: Gap, made: Made) -> str:
    """The text of the file."""
    return KIND.text({**as_plain_data(gap), **asdict(made)})


def load_gap(path: str | Path) -> tuple[Gap, Made]:
    """Read a diagnosis back, without its closed model, which is a vehicle file of its own.

    Raises
    ------
    BadInput : the file is no diagnosis, is damaged, or was written by another version.
    """
    return KIND.load(path, _from_plain_data)


def _from_plain_data(body: Mapping[str, Any]) -> tuple[Gap, Made]:
    made = Made(
        vehicle=str(body["vehicle"]),
        command=str(body["command"]),
        seed=int(body["seed"]),
        version=str(body["version"]),
        data=tuple(DataRecord(**record) for record in body["data"]),
        settings=dict(body["settings"]),
        effects={str(name): float(value) for name, value in body.get("effects", {}).items()},
        stated=tuple(Number(**own) for own in body.get("stated", ())),
    )
    return from_plain_data(body), made
