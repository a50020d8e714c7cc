"""Vehicles written back as files that `vehicle_file` reads."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import BadInput
from ..files import write_atomically
from ..guard import VEHICLE_MARK
from ..vehicle import Stated, Vehicle

BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def write_vehicle(vehicle: Vehicle, path: str | Path) -> Path:
    """Write a vehicle as TOML or, where the path ends in .json, as JSON; atomically.

    Comments of the file it was read from are not kept, sources are.

    Raises
    ------
    BadInput : the file cannot be written there.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in (".toml", ".json"):
        raise BadInput(f"{file}: a vehicle file ends in .toml or .json; name it so.")
    if suffix == ".json":
        return write_atomically(file, json.dumps(as_plain(vehicle), indent=1, ensure_ascii=False) + "\n")
    return write_atomically(file, vehicle_text(vehicle))


def vehicle_text(vehicle: Vehicle) -> str:
    """The text of its TOML file."""
    return "\n".join([f"{VEHICLE_MARK} {__version__}", *_toml(as_plain(vehicle))]).strip() + "\n"


def as_plain(vehicle: Vehicle) -> dict[str, Any]:
    """A vehicle as plain data, with the keys of a vehicle file."""
    plain: dict[str, Any] = {"name": vehicle.name}
    if vehicle.about:
        plain["about"] = vehicle.about
    if vehicle.steer_max is not None:
        plain["steer_max"] = vehicle.steer_max
    if vehicle.model is not None:
        chosen = vehicle.model
        settings = {key: value for key, value in chosen.settings.items() if value is not None}
        plain["model"] = {"name": chosen.name, **settings}
        if chosen.effects:
            plain["model"]["effects"] = _plainly(chosen.effects)
    plain["parameters"] = _plainly(vehicle.values)
    plain["effects"] = _plainly(vehicle.effects)
    plain["noise"] = dict(vehicle.noise)
    plain["model_error"] = {
        force: {key: value for key, value in vars(own).items() if value is not None}
        for force, own in vehicle.model_error.items()
    }
    if vehicle.tracking is not None:
        own = vehicle.tracking
        plan = {"parameters": list(own.parameters), "disturbances": list(own.disturbances), "noise": dict(own.noise)}
        plain["tracking"] = {key: value for key, value in plan.items() if value}
    return {key: value for key, value in plain.items() if value != {}}


def _plainly(stated: Mapping[str, Stated]) -> dict[str, Any]:
    return {name: _plain(own) for name, own in stated.items()}


def _plain(stated: Stated) -> float | dict[str, float | str]:
    if stated.plain and not stated.source and stated.value is not None:
        return stated.value
    return {key: value for key, value in vars(stated).items() if value is not None and value != ""}


def _toml(plain: Mapping[str, Any]) -> Iterator[str]:
    """Lines: first what belongs to no table, then one table after the other, an entry each line."""
    tables = {key: value for key, value in plain.items() if isinstance(value, Mapping)}
    for key, value in plain.items():
        if key not in tables:
            yield f"{_key(key)} = {_inline(value)}"
    for key, table in tables.items():
        yield f"\n[{_key(key)}]"
        for name, value in table.items():
            yield f"{_key(name)} = {_inline(value)}"


def _key(name: str) -> str:
    return name if BARE_KEY.fullmatch(name) else _quoted(name)


def _inline(value: Any) -> str:
    if isinstance(value, Mapping):
        entries = [f"{_key(key)} = {_inline(own)}" for key, own in value.items() if own is not None]
        return f"{{ {', '.join(entries)} }}" if entries else "{}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_inline(own) for own in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    return _quoted(str(value))


def _quoted(text: str) -> str:
    """A TOML basic string; JSON's escapes are its own but for the one character JSON leaves as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
