"""What `fleet.toml` asks for: which recordings, of which vehicles, through which steps, within which limits."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from greybox_id.base.errors import BadInput, must_be_one_of
from greybox_id.base.toml_file import must_know, read_toml
from greybox_id.datasets.column_map import column_map, shipped_maps
from greybox_id.fitting.requested_model import named_vehicle
from greybox_id.models.vehicle import shipped_vehicles

from .statuses import FIT, GAP, STEPS

KEYS = ("recordings", "vehicle", "columns", "steps", "limits", *STEPS)
LIMITS = ("seconds", "memory")
SECONDS, MEMORY = 120.0, "1GB"
"""What a recording may take where nothing is said: twenty times what a fit and a diagnosis of an hour's drive do."""
UNITS = {"kb": 1e3, "mb": 1e6, "gb": 1e9, "kib": 2.0**10, "mib": 2.0**20, "gib": 2.0**30}
LEAST_MEMORY = 50e6
"""Bytes below which no recording can be read."""


@dataclass(frozen=True)
class FleetPlan:
    """A fleet as asked for.

    Attributes
    ----------
    file : where it stands; names in it are seen from its folder.
    recordings : patterns of files, or the file of a manifest.
    vehicle : name or pattern of vehicles -> vehicle file or shipped vehicle.
    columns : column map: a shipped one or a file.
    steps : of "check", "fit", "gap", in this order.
    options : step -> its options.
    seconds, memory : what a recording may take: s of the processor's time, bytes.
    """

    file: Path
    recordings: tuple[str, ...]
    vehicle: Mapping[str, str]
    columns: str
    steps: tuple[str, ...]
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seconds: float = SECONDS
    memory: float = 1e9

    @property
    def folder(self) -> Path:
        """What names in the file are seen from."""
        return self.file.parent

    @cached_property
    def computing(self) -> str:
        """Hash of what is asked of every recording: steps, their options, the content of the column map."""
        # limits are left out: what succeeded within some succeeds within others
        body = {"steps": self.steps, "options": {name: self.options.get(name, {}) for name in self.steps}}
        return hashlib.sha256(
            (json.dumps(body, sort_keys=True, default=str) + content_of(self.columns)).encode()
        ).hexdigest()


def content_of(named: str) -> str:
    """Hash of a file's bytes, or a shipped thing's name: it changes with the version, which is in keys too."""
    file = Path(named)
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else named


def plan_of(path: str | Path) -> FleetPlan:
    """Read a fleet's file.

    Raises
    ------
    BadInput : it cannot be read, lacks something, or holds what is not known.
    """
    file = Path(path)
    body = read_toml(file, "fleet plan")
    must_know(body, KEYS, str(file))
    if "recordings" not in body:
        raise BadInput(f'{file} names no recordings; write recordings = "data/{{vehicle}}/*.parquet", or a manifest.')
    steps = _steps(file, body.get("steps", ["check", "fit"]))
    plan = FleetPlan(
        file=file,
        recordings=_patterns(file, body["recordings"]),
        vehicle=_vehicles(file, body.get("vehicle", {})),
        columns=_columns(file, body.get("columns", "canonical")),
        steps=steps,
        options=_options(file, body, steps),
        **_limits(file, body.get("limits", {})),
    )
    if isinstance(body.get("vehicle"), str) and "{" not in body["vehicle"]:
        try:
            named_vehicle(vehicle_named(plan, body["vehicle"]))  # it is that of all: better said once
        except BadInput as error:
            raise BadInput(f"{file}: {error.args[0]}") from error
    return plan


def _patterns(file: Path, value: Any) -> tuple[str, ...]:
    several = [value] if isinstance(value, str) else value
    if not isinstance(several, list) or not several or not all(isinstance(item, str) and item for item in several):
        raise BadInput(f"{file}: recordings is a pattern, a list of patterns, or a manifest's file, not {value!r:.60}.")
    return tuple(several)


def _vehicles(file: Path, value: Any) -> dict[str, str]:
    table = {"*": value} if isinstance(value, str) else value
    if not isinstance(table, Mapping) or not all(isinstance(item, str) and item for item in table.values()):
        raise BadInput(
            f'{file}: vehicle is a vehicle file, or a table of them, as in vehicle = {{"V1*" = "v1.toml"}}, not '
            f"{value!r:.60}."
        )
    return {str(name): item for name, item in table.items()}


def _columns(file: Path, value: Any) -> str:
    if not isinstance(value, str):
        raise BadInput(f"{file}: columns is a column map's name or file, not {value!r:.60}.")
    named = value if value in shipped_maps() else str((file.parent / value).resolve())
    try:
        column_map(named)
    except BadInput as error:
        raise BadInput(f"{file}: columns = {value!r} cannot be used. {error.args[0]}") from error
    return named


def _steps(file: Path, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not value:
        raise BadInput(f'{file}: steps is a list of {", ".join(STEPS)}, as in steps = ["check", "fit"].')
    for item in value:
        must_be_one_of(STEPS, item, f"{file}: there is no step")
    return tuple(item for item in STEPS if item in value)


def _options(file: Path, body: Mapping[str, Any], steps: tuple[str, ...]) -> dict[str, Mapping[str, Any]]:
    from .unit import OPTIONS, requested_of

    for step in STEPS:
        entry = body.get(step, {})
        if not isinstance(entry, Mapping):
            raise BadInput(f"{file}: [{step}] is a table of options, not {entry!r:.60}.")
        for name in entry:
            must_be_one_of(OPTIONS[step], name, f"{file}: [{step}] has no option")
    model = body.get(FIT, {}).get("model")
    if FIT in steps and (model is not None or not body.get("vehicle")):
        try:
            requested_of(body.get(FIT, {}), None)[0].model()  # what is wrong with it is better said once than of each
        except BadInput as error:
            raise BadInput(f"{file}: {error.args[0]}") from error
    if GAP in steps and not body.get("vehicle"):
        raise BadInput(f"{file}: the step gap compares with a vehicle's simulation; name its file: vehicle = ...")
    return {step: dict(body[step]) for step in steps if step in body}


def _limits(file: Path, value: Any) -> dict[str, float]:
    if not isinstance(value, Mapping) or not set(value) <= set(LIMITS):
        raise BadInput(f'{file}: limits is a table, as in limits = {{seconds = 120, memory = "1GB"}}.')
    seconds = value.get("seconds", SECONDS)
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0 < seconds < 1e7:
        raise BadInput(f"{file}: limits.seconds is a number above zero, not {seconds!r:.40}.")
    return {"seconds": float(seconds), "memory": _bytes(file, value.get("memory", MEMORY))}


def _bytes(file: Path, value: Any) -> float:
    text = str(value).strip().lower()
    number = text.rstrip("abcdefghijklmnopqrstuvwxyz ")
    factor = UNITS.get(text[len(number) :].strip()) if isinstance(value, str) else 1.0
    try:
        result = float(number) * (factor or float("nan"))
    except ValueError:
        result = float("nan")
    if not LEAST_MEMORY <= result < 1e15:
        raise BadInput(f'{file}: limits.memory is a size from 50 MB on, as in "1GB", not {value!r:.40}.')
    return result


def vehicle_named(plan: FleetPlan, named: str) -> str:
    """A vehicle's file as seen from the plan's folder, or the shipped one's name."""
    file = (plan.folder / named).resolve()
    return named if named in shipped_vehicles() and not file.is_file() else str(file)
