"""Vehicles that other tools state: tyre property files, Autoware's, f1tenth_gym's and CommonRoad's parameter files.

YAML of strangers: plain data of bounded size and depth, without aliases, tags or keys that are there twice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite, sqrt
from pathlib import Path
from typing import Any

from greybox_id.base.errors import BadInput
from greybox_id.base.files import small_file
from greybox_id.datasets.formats import needed
from greybox_id.models.parameter import Stated
from greybox_id.models.tyre_file import DIGITS, read_tyre_file
from greybox_id.models.vehicle import ChosenModel, Vehicle

DEEPEST, MOST = 20, 20_000
"""Tables within tables, and entries in all."""


def read_yaml(path: str | Path) -> Any:
    """The data of a YAML file.

    Raises
    ------
    BadInput : it cannot be read, is no YAML, too large or too deep, holds aliases or tags, or PyYAML is not installed.
    """
    held = small_file(path, "parameter file")
    try:
        return parse_yaml(held.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: not UTF-8 text; save it as UTF-8.") from error


def parse_yaml(text: str, where: str) -> Any:
    """The data of a YAML text. Raises `BadInput` as `read_yaml` does."""
    yaml = needed("yaml", "yaml", where, "YAML")
    try:
        _bounded(yaml.parse(text, Loader=yaml.SafeLoader), where, yaml)
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        _no_key_twice(node, where, yaml)
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f" (line {mark.line + 1})" if mark is not None else ""
        problem = " ".join(str(getattr(error, "problem", None) or "it is no valid text").split())
        raise BadInput(f"{where}: not valid YAML{place}: {problem:.100}. Mend that line.") from error
    except (ValueError, OverflowError, RecursionError) as error:  # dates that are none, numbers of thousands of digits
        raise BadInput(f"{where}: not valid YAML: {str(error) or 'a value cannot be read':.100}. Mend it.") from error


def _bounded(events: Any, where: str, yaml: Any) -> None:
    depth = 0
    for count, event in enumerate(events):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            line = event.start_mark.line + 1
            raise BadInput(f"{where}: line {line}: anchors and aliases are not followed; write the value out.")
        if getattr(event, "tag", None):
            raise BadInput(f"{where}: line {event.start_mark.line + 1}: tags are not followed; remove it.")
        if isinstance(event, yaml.MappingStartEvent | yaml.SequenceStartEvent):
            depth += 1
        elif isinstance(event, yaml.MappingEndEvent | yaml.SequenceEndEvent):
            depth -= 1
        if depth > DEEPEST or count > MOST:
            raise BadInput(
                f"{where}: tables are nested deeper than {DEEPEST} or there are more than {MOST} entries; this is "
                "not a parameter file."
            )


def _no_key_twice(node: Any, where: str, yaml: Any) -> None:
    """A later key would replace an earlier one in silence."""
    if isinstance(node, yaml.MappingNode):
        seen = set()
        for key, value in node.value:
            if key.value.__hash__ is None or key.value in seen:
                raise BadInput(
                    f"{where}: line {key.start_mark.line + 1}: this key is there twice, or is not text; correct it."
                )
            seen.add(key.value)
            _no_key_twice(value, where, yaml)
    elif isinstance(node, yaml.SequenceNode):
        for value in node.value:
            _no_key_twice(value, where, yaml)


G = 9.81
SUFFIXES = (".tir", ".yaml", ".yml")


@dataclass(frozen=True)
class ImportedVehicle:
    """What was made of a file.

    Attributes
    ----------
    vehicle : what it states, each number with its source.
    kind : what the file is, for people.
    notes : sentences for the user.
    """

    vehicle: Vehicle
    kind: str
    notes: tuple[str, ...]


def import_vehicle(path: str | Path) -> ImportedVehicle:
    """A vehicle from a file of another tool.

    Parameters
    ----------
    path : a .tir file, or a .yaml file: Autoware's vehicle_info.param.yaml, f1tenth_gym's parameters, CommonRoad's
        vehicle or tyre parameters.

    Raises
    ------
    BadInput : it is none of these, or a number in it is none or cannot be.
    """
    file = Path(path)
    if file.suffix.lower() == ".tir":
        return _of_tyre(file)
    table = _inner(read_yaml(path))
    if not isinstance(table, Mapping):
        raise BadInput(f"{path}: no table of parameters; {_KNOWN}")
    for keys, read in _KINDS:
        if keys <= {key for key in table if isinstance(key, str)}:
            return read(table, file)
    raise BadInput(f"{path}: not understood; {_KNOWN}")


_KNOWN = (
    "these files can be imported: Autoware's vehicle_info.param.yaml (wheel_base, wheel_tread, ...), f1tenth_gym's "
    "parameters (mu, "
    "C_Sf, lf, lr, m, I) and CommonRoad's (m, a, b, I_z, or tire)."
)


def _inner(table: Any) -> Any:
    """What lies under the names of a ROS node."""
    for _ in range(4):
        if isinstance(table, Mapping) and len(table) == 1:
            ((key, inner),) = table.items()
            if isinstance(inner, Mapping) and key != "tire":
                table = inner
    return table


class _Numbers:
    """Numbers of a table, each with the file and key it comes from."""

    def __init__(self, table: Mapping[str, Any], file: Path, kind: str) -> None:
        self.table, self.file, self.kind, self.used = table, file, kind, set[str]()

    def has(self, key: str) -> bool:
        return key in self.table

    def of(self, key: str, above: float | None = 0.0) -> float:
        value = self.table.get(key)
        self.used.add(key)
        if isinstance(value, str):  # YAML 1.1 takes 10e3 for a text
            try:
                value = float(value)
            except ValueError:
                value = None
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value) or abs(value) > 1e12:
            raise BadInput(f"{self.file}: {key} must be a finite number, not {self.table.get(key)!r:.60}; mend it.")
        if above is not None and value <= above:
            raise BadInput(f"{self.file}: {key} = {value:g} must be above {above:g}; mend it.")
        return float(value)

    def stated(self, key: str) -> Stated:
        return Stated(self.of(key), source=self.source(key))

    def source(self, words: str) -> str:
        return f"{self.kind} {self.file.name}: {words}"

    def left(self) -> list[str]:
        return sorted(str(key) for key in self.table if key not in self.used)

    def notes(self) -> list[str]:
        left = self.left()
        more = f" and {len(left) - 12} more" if len(left) > 12 else ""
        return [f"ignored: {', '.join(left[:12])}{more}"] if left else []


def _of_tyre(file: Path) -> ImportedVehicle:
    tyre = read_tyre_file(file)
    notes = [f"ignored: {', '.join(tyre.ignored)}"] if tyre.ignored else []
    notes.append("both axles have this tyre; mass, inertia and lengths are not in such a file: state them")
    vehicle = Vehicle(file.stem, tyre.stated(), about=f"tyres of {file.name}, Magic Formula {tyre.version}")
    return ImportedVehicle(vehicle, f"tyre property file, Magic Formula {tyre.version}", tuple(notes))


def _of_autoware(table: Mapping[str, Any], file: Path) -> ImportedVehicle:
    value = _Numbers(table, file, "Autoware")
    base = value.of("wheel_base")
    between = Stated(base / 2, base / sqrt(12), 0.0, base, value.source("wheel_base; anywhere between the axles"))
    values = {"l_f": between, "l_r": between}
    values |= {name: value.stated("wheel_tread") for name in ("track_f", "track_r") if value.has("wheel_tread")}
    if value.has("wheel_radius"):
        values["wheel_radius"] = value.stated("wheel_radius")
    limit = value.of("max_steer_angle") if value.has("max_steer_angle") else None
    notes = [
        "the file says how far apart the axles are, not where the centre of gravity lies: state l_f and l_r",
        "mass, inertia and tyres are not in such a file: state them",
        *value.notes(),
    ]
    vehicle = Vehicle(file.name.partition(".")[0], values, steer_max=limit, about=f"from Autoware's {file.name}")
    return ImportedVehicle(vehicle, "Autoware's vehicle_info", tuple(notes))


def _of_gym(table: Mapping[str, Any], file: Path) -> ImportedVehicle:
    value = _Numbers(table, file, "f1tenth_gym")
    names = {"m": "m", "I": "I_z", "lf": "l_f", "lr": "l_r", "h": "h_cg"}
    values = {name: value.stated(key) for key, name in names.items() if value.has(key)}
    m, l_f, l_r, mu = value.of("m"), value.of("lf"), value.of("lr"), value.of("mu")
    for suffix, other in (("f", l_r), ("r", l_f)):
        stiffness = mu * value.of(f"C_S{suffix}") * m * G * other / (l_f + l_r)
        values[f"C_alpha_{suffix}"] = Stated(stiffness, source=value.source(f"mu C_S{suffix} times the static load"))
        values[f"mu_{suffix}"] = value.stated("mu")
    limit = value.of("s_max") if value.has("s_max") else None
    effects = {"steering_rate_limit": value.stated("sv_max")} if value.has("sv_max") else {}
    model = ChosenModel("single_track", {"tyre": "linear"}, effects)
    vehicle = Vehicle(file.stem, values, steer_max=limit, model=model, about=f"from f1tenth_gym's {file.name}")
    return ImportedVehicle(vehicle, "f1tenth_gym's parameters", tuple(value.notes()))


def _of_commonroad(table: Mapping[str, Any], file: Path) -> ImportedVehicle:
    value = _Numbers(table, file, "CommonRoad")
    names = {"m": "m", "I_z": "I_z", "a": "l_f", "b": "l_r", "h_cg": "h_cg", "T_f": "track_f", "T_r": "track_r",
             "R_w": "wheel_radius", "I_y_w": "I_w"}  # fmt: skip
    values = {name: value.stated(key) for key, name in names.items() if value.has(key)}
    if value.has("T_sb"):
        values["brake_split_front"] = value.stated("T_sb")
    if value.has("T_se"):
        values["drive_split_front"] = Stated(value.of("T_se", above=None), source=value.source("T_se"))
    limit, model = None, None
    steering = table.get("steering")
    if isinstance(steering, Mapping):
        value.used.add("steering")
        inner = _Numbers(steering, file, "CommonRoad")
        limit = inner.of("max") if inner.has("max") else None
        if inner.has("v_max"):
            model = ChosenModel("single_track", {}, {"steering_rate_limit": inner.stated("v_max")})
    tyres = table.get("tire")
    if isinstance(tyres, Mapping):
        value.used.add("tire")
        values |= _tyres(tyres, file)
    notes = [] if isinstance(tyres, Mapping) else ["tyres are in CommonRoad's parameters_tire.yaml: import that, too"]
    vehicle = Vehicle(file.stem, values, steer_max=limit, model=model, about=f"from CommonRoad's {file.name}")
    return ImportedVehicle(vehicle, "CommonRoad's vehicle parameters", (*notes, *value.notes()))


def _of_commonroad_tyre(table: Mapping[str, Any], file: Path) -> ImportedVehicle:
    held = table.get("tire", table)
    if not isinstance(held, Mapping):
        raise BadInput(f"{file}: tire must be a table of parameters; mend it.")
    values = _tyres(held, file)
    notes = (
        "ignored: longitudinal and combined slip, camber, shifts of the curve",
        "mass, inertia and lengths are not in this file: state them",
    )
    return ImportedVehicle(
        Vehicle(file.stem, values, about=f"tyres of CommonRoad's {file.name}"), "CommonRoad's tyre parameters", notes
    )


def _tyres(table: Mapping[str, Any], file: Path) -> dict[str, Stated]:
    """B, C, D, E from coefficients of the Magic Formula at the nominal load; K = p_ky1 F_z."""
    entry = _Numbers(table, file, "CommonRoad")
    C, D, E, K = entry.of("p_cy1"), entry.of("p_dy1"), entry.of("p_ey1", above=None), abs(entry.of("p_ky1", above=None))
    if not K:
        raise BadInput(f"{file}: p_ky1 must not be zero; mend it.")
    result = {"B": (float(f"{K / (C * D):.{DIGITS}g}"), "p_ky1 over p_cy1 p_dy1"), "C": (C, "p_cy1"),
             "D": (D, "p_dy1"), "E": (E, "p_ey1")}  # fmt: skip
    return {
        f"{letter}_{suffix}": Stated(value, source=entry.source(words))
        for letter, (value, words) in result.items()
        for suffix in "fr"
    }


_KINDS: tuple[tuple[set[str], Callable[[Mapping[str, Any], Path], ImportedVehicle]], ...] = (
    ({"wheel_base"}, _of_autoware),
    ({"mu", "C_Sf", "C_Sr", "lf", "lr", "m"}, _of_gym),
    ({"m", "a", "b", "I_z"}, _of_commonroad),
    ({"tire"}, _of_commonroad_tyre),
    ({"p_cy1", "p_ky1"}, _of_commonroad_tyre),
)
"""Keys that tell a kind of file -> how it is read."""
