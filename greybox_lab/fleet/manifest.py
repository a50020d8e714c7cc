"""Which recordings a fleet has: of which vehicle, from when, at which odometer; what is wrong with an entry is said."""

from __future__ import annotations

import hashlib
import math
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from glob import has_magic
from pathlib import Path
from typing import Any

from greybox_id.base.errors import BadInput
from greybox_id.base.files import near_file
from greybox_id.base.units import number
from greybox_id.datasets.formats import SUFFIXES, hash_of
from greybox_id.fitting.requested_model import named_vehicle

from .plan import FleetPlan, content_of, vehicle_named
from .statuses import FIT
from .unit import MADE_BY

COLUMNS = ("path", "vehicle", "time", "odometer", "tags")
"""Columns of a manifest; all but the path may be missing."""
PLACE = re.compile(r"\{(vehicle|time|odometer)\}")
TABLES = (".csv", ".parquet")


@dataclass(frozen=True)
class FleetEntry:
    """A recording of the fleet.

    Attributes
    ----------
    path : as the user wrote it, or as it was found, seen from the plan's folder.
    file : where it lies.
    vehicle : name of the vehicle.
    vehicle_file : what is stated of it: a file or a shipped one; "" where nothing is.
    time : s since 1970, UTC; NaN where it is not known.
    odometer : m; NaN where it is not known.
    tags : further words on it.
    sha256 : of its bytes; "" where it cannot be read.
    size, changed : bytes, and when it was changed in ns since 1970.
    key : of its results: what they follow from.
    problem : why it cannot be used, in a sentence; "" where it can.
    """

    path: str
    file: Path
    vehicle: str = ""
    vehicle_file: str = ""
    time: float = math.nan
    odometer: float = math.nan
    tags: str = ""
    sha256: str = ""
    size: int = -1
    changed: int = -1
    key: str = ""
    problem: str = ""


def entries(plan: FleetPlan, known: Mapping[str, tuple[int, int, str]] | None = None) -> list[FleetEntry]:
    """All recordings of a fleet, each once, with their keys.

    Parameters
    ----------
    plan : the fleet.
    known : path -> size, time of change and hash of an earlier run: a file of which the first two are as they were is
        not read; None reads all of them.

    Raises
    ------
    BadInput : the manifest cannot be read, or there are no recordings.
    """
    listed = list(_listed(plan))
    if not listed:
        raise BadInput(f"{plan.file}: no recordings match {', '.join(plan.recordings)}.")
    vehicles: dict[str, tuple[str, str]] = {}
    result = [_keyed(plan, entry, known or {}, vehicles) for entry in _without_contradictions(listed)]
    return _once(result)


def _listed(plan: FleetPlan) -> Iterator[FleetEntry]:
    table = _manifest_of(plan)
    if table is not None:
        yield from _rows(plan, *table)
        return
    for pattern in plan.recordings:
        yield from _matching(plan, pattern)


def _manifest_of(plan: FleetPlan) -> tuple[str, list[dict[str, Any]]] | None:
    """The rows of a manifest, where recordings names one."""
    if len(plan.recordings) != 1 or has_magic(plan.recordings[0]) or PLACE.search(plan.recordings[0]):
        return None
    file = plan.folder / plan.recordings[0]
    if file.suffix.lower() not in TABLES:
        return None
    import pandas as pd

    try:
        if file.suffix.lower() == ".csv":
            if "path" not in pd.read_csv(file, nrows=0).columns.str.strip():
                return None
            table = pd.read_csv(file, dtype=str, keep_default_na=False)
        else:
            import pyarrow.parquet as pq

            if "path" not in pq.read_schema(file).names:
                return None
            table = pd.read_parquet(file)
    except OSError as error:
        raise BadInput(f"{file}: the manifest cannot be read: {error.strerror or error}.{near_file(file)}") from error
    except Exception as error:  # parsers fail over damage in ways nobody has listed
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        raise BadInput(f"{file}: the manifest cannot be read ({reason:.100}); write it again.") from error
    table.columns = [str(name).strip() for name in table.columns]
    if strangers := [name for name in table.columns if name not in COLUMNS]:
        raise BadInput(f"{file}: a manifest has the columns {', '.join(COLUMNS)}, not {', '.join(strangers[:4])}.")
    if len(set(table.columns)) < len(table.columns):
        raise BadInput(f"{file}: two columns of the manifest have one name.")
    return str(file), [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]


def _rows(plan: FleetPlan, name: str, rows: Sequence[Mapping[str, Any]]) -> Iterator[FleetEntry]:
    for count, row in enumerate(rows, 2 if name.lower().endswith(".csv") else 1):
        path = _text(row.get("path"))
        entry = FleetEntry(path or f"row {count} of {Path(name).name}", plan.folder / path)
        if not path:
            yield replace(entry, problem=f"Row {count} of {name} names no path.")
            continue
        if "\0" in path:
            yield replace(entry, problem=f"Row {count} of {name}: its path holds a null byte.")
            continue
        entry = replace(entry, vehicle=_text(row.get("vehicle")), tags=_text(row.get("tags")))
        yield _measured(entry, row.get("time"), row.get("odometer"), f"Row {count} of {name}")


def _measured(entry: FleetEntry, time: Any, odometer: Any, where: str) -> FleetEntry:
    """The entry with time and odometer, or with what is wrong with them."""
    try:
        return replace(entry, time=_instant(time, where), odometer=_distance(odometer, where))
    except BadInput as error:
        return replace(entry, problem=str(error))


def _matching(plan: FleetPlan, pattern: str) -> Iterator[FleetEntry]:
    """Files of a pattern, in which {vehicle}, {time} and {odometer} stand for parts of names."""
    place = PLACE.search(pattern)
    plain = PLACE.sub("*", pattern)
    shape = re.compile(_expression(pattern)) if place else None
    if has_magic(plain):
        base = Path(plain).anchor
        folder = Path(base) if base else plan.folder
        files = sorted(folder.glob(plain[len(base) :] if base else plain))
        files = [file for file in files if place or file.name.lower().endswith(tuple(SUFFIXES)) or not file.is_dir()]
    else:
        files = [plan.folder / plain]
    for file in files:
        path = file.as_posix() if Path(plain).is_absolute() else file.relative_to(plan.folder).as_posix()
        entry = FleetEntry(path, file)
        matched = shape.fullmatch(path) if shape is not None else None
        if shape is not None and matched is None:
            continue
        parts = matched.groupdict() if matched is not None else {}
        entry = replace(entry, vehicle=parts.get("vehicle", ""))
        yield _measured(entry, parts.get("time"), parts.get("odometer"), path)


def _expression(pattern: str) -> str:
    """The regular expression of a pattern with places: they and * stand for anything but a slash, ** for anything."""
    result, seen = "", set[str]()
    for part in re.split(r"(\{(?:vehicle|time|odometer)\}|\*\*/|\*\*|\*|\?|\[[^\]]*\])", pattern):
        if PLACE.fullmatch(part):
            name = part[1:-1]
            result += f"(?P={name})" if name in seen else f"(?P<{name}>[^/]+)"
            seen.add(name)
        elif part.startswith("**"):
            result += "(?:.*/)?" if part.endswith("/") else ".*"
        elif part in ("*", "?"):
            result += "[^/]" + (part if part == "*" else "")
        else:
            result += part if part.startswith("[") and part.endswith("]") else re.escape(part)
    return result


def _instant(value: Any, where: str) -> float:
    """s since 1970 of an ISO date, a number of seconds or a timestamp of a table; without a zone it is UTC."""
    if value is None or (isinstance(value, float) and math.isnan(value)) or str(value).strip() in ("", "NaT", "nan"):
        return math.nan
    text = str(value).strip()
    try:
        result = float(text)
        if math.isfinite(result):
            return result
    except ValueError:
        pass
    try:
        read = datetime.fromisoformat(text)
    except ValueError as error:
        raise BadInput(
            f"{where}: time {text!r:.40} is not a date; write 2026-03-01T08:00:00, or s since 1970."
        ) from error
    return (read if read.tzinfo else read.replace(tzinfo=UTC)).timestamp()


def _distance(value: Any, where: str) -> float:
    if value is None or str(value).strip() in ("", "nan", "<NA>", "None"):
        return math.nan
    result = number(str(value), "m", f"{where}: odometer")
    if not math.isfinite(result) or result < 0:
        raise BadInput(f"{where}: odometer {str(value)!r:.40} is not a distance; write metres, or 12000 km.")
    return result


def _text(value: Any) -> str:
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else str(value).strip()


def _without_contradictions(listed: Sequence[FleetEntry]) -> Iterator[FleetEntry]:
    """Entries; where a file is said to be of several vehicles, none of them is taken."""
    of: dict[str, set[str]] = {}
    for entry in listed:
        of.setdefault(str(entry.file), set()).add(entry.vehicle)
    known = set[str]()
    for entry in listed:
        names = of[str(entry.file)]
        if len(names) == 1:
            yield entry
        elif str(entry.file) not in known:
            known.add(str(entry.file))
            words = " and ".join(sorted(name or "no vehicle" for name in names))
            yield replace(entry, problem=f"{entry.path} is listed for {words}; a recording is of one vehicle.")


def _once(fleet_entries: Sequence[FleetEntry]) -> list[FleetEntry]:
    """Entries without repetition: the same bytes of the same vehicle are one recording."""
    kept: dict[str, FleetEntry] = {}
    by_bytes: dict[str, FleetEntry] = {}
    for entry in fleet_entries:
        first = by_bytes.setdefault(entry.sha256, entry) if entry.sha256 and not entry.problem else entry
        if first is not entry and first.vehicle != entry.vehicle:
            words = f"{entry.path} holds the same bytes as {first.path}, a recording of {first.vehicle}"
            entry = _with_problem(entry, f"{words}; a recording is of one vehicle.")
        kept.setdefault(entry.key, entry)
    return list(kept.values())


def _keyed(
    plan: FleetPlan,
    entry: FleetEntry,
    known: Mapping[str, tuple[int, int, str]],
    vehicles: dict[str, tuple[str, str]],
) -> FleetEntry:
    """The entry with the vehicle's file, the hash of its bytes and its key; or with what is wrong with it."""
    if entry.problem:
        return _with_problem(entry, entry.problem)
    try:
        named = _vehicle_of(plan, entry)
        if named not in vehicles:
            vehicles[named] = _stated(plan, named)
        place, content = vehicles[named]
        entry = replace(entry, vehicle=entry.vehicle or Path(named).stem or "fleet", vehicle_file=place)
        entry = _hashed(entry, known)
    except BadInput as error:
        return _with_problem(entry, str(error))
    parts = (entry.sha256, entry.vehicle, content, plan.computing, MADE_BY)
    return replace(entry, key=hashlib.sha256("\0".join(parts).encode()).hexdigest())


def _with_problem(entry: FleetEntry, problem: str) -> FleetEntry:
    """An entry that cannot be used; its key follows from what is wrong, so that mending it makes another one."""
    parts = ("problem", entry.path, entry.vehicle, problem, MADE_BY)
    return replace(entry, problem=problem, key=hashlib.sha256("\0".join(parts).encode()).hexdigest())


def _vehicle_of(plan: FleetPlan, entry: FleetEntry) -> str:
    """The vehicle file of an entry: by its vehicle's name, else by the first pattern that its name or path fits."""
    if entry.vehicle in plan.vehicle:
        return plan.vehicle[entry.vehicle]
    for pattern, named in plan.vehicle.items():
        if fnmatchcase(entry.vehicle, pattern) or fnmatchcase(entry.path, pattern):
            return named.replace("{vehicle}", entry.vehicle)
    if plan.vehicle:
        whose = f"vehicle {entry.vehicle!r}" if entry.vehicle else entry.path
        raise BadInput(f'{plan.file}: no entry of [vehicle] fits {whose}; add one, or a general one: "*" = ...')
    return ""


def _stated(plan: FleetPlan, named: str) -> tuple[str, str]:
    """Place and hash of a vehicle's file, which is read once."""
    if not named:
        return "", ""
    place = vehicle_named(plan, named)
    vehicle = named_vehicle(place)
    if FIT in plan.steps and "model" not in plan.options.get(FIT, {}) and (vehicle is None or vehicle.model is None):
        raise BadInput(
            f'{place} names no model, and neither does {plan.file}: add one to [fit], as in model = "lateral".'
        )
    return place, content_of(place)


def _hashed(entry: FleetEntry, known: Mapping[str, tuple[int, int, str]]) -> FleetEntry:
    try:
        value = entry.file.stat()
        if entry.file.is_dir():
            return replace(entry, sha256=hash_of(entry.file))
        if not stat.S_ISREG(value.st_mode):
            raise BadInput(f"{entry.path} is not a regular file, and cannot be read twice; copy it to a file.")
        before = known.get(entry.path)
        same = before is not None and before[:2] == (value.st_size, value.st_mtime_ns)
        digest = before[2] if before is not None and same else hash_of(entry.file)
        return replace(entry, sha256=digest, size=value.st_size, changed=value.st_mtime_ns)
    except OSError as error:
        near = near_file(entry.file)
        raise BadInput(f"{entry.path} cannot be read: {error.strerror or error}.{near}") from error
