"""A vehicle as stated by engineers: values of its parameters, their uncertainty and their sources.

It names parameters, effects and signals; each model uses those that it has.
Its file is TOML, or JSON with the same keys.

    name = "full-size car"
    steer_max = 0.5
    tyre_file = "tyre.tir"                            # optional: B, C, D, E of both axles, unless stated below
    [parameters]                                      # SI units, a number or a table
    m = { value = 1457.2, sd = 4.4, source = "scale" }
    l_f = 1.296
    [effects]                                         # tolerances: small effects known to be present
    steering_lag = { sd = 0.003 }
    [noise]                                           # sensor standard deviations
    yaw_rate = 0.01
    [model_error]                                     # optional: error of its forces, as written by `greybox gap`
    F_y = { share = 0.02, amplitude = 0.05, correlation_time = 0.4 }    # 1, m/s^2, s
    [model]                                           # optional: the model that describes it best
    name = "single_track"
    tyre = "pacejka"
    effects = { steering_delay = { value = 0.03, sd = 0.002 } }
    [tracking]                                        # optional: what `greybox track` tracks
    parameters = ["C_alpha_f", "C_alpha_r"]
    disturbances = ["road_bank"]
    noise = { walk_v_y = 0.05 }

Shipped vehicle files are in `vehicles/`.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..base.errors import BadInput, near
from ..base.files import write_atomically
from ..base.guard import VEHICLE_MARK
from ..base.signals import SIGNALS
from ..base.toml_file import key_of, must_know, parse_toml, quoted, table_of, text_of
from ..base.version import __version__
from ..datasets.shipped import named_text, shipped_files
from .parameter import Stated
from .tyre_file import read_tyre_file


@dataclass(frozen=True)
class ChosenModel:
    """The model that describes a vehicle best, as chosen by a diagnosis or an engineer.

    Attributes
    ----------
    name : of the model.
    settings : the model's hyperparameters as plain data, for example its tyre.
    effects : effects that are part of it, with their magnitudes.
    """

    name: str
    settings: Mapping[str, object] = field(default_factory=dict)
    effects: Mapping[str, Stated] = field(default_factory=dict)


@dataclass(frozen=True)
class TrackingPlan:
    """What to track of a vehicle while it drives, by default.

    Attributes
    ----------
    parameters : tracked as random walks.
    disturbances : tracked as mean-reverting processes.
    noise : name of a noise -> its size; noises not stated are tuned on the recording.
    """

    parameters: tuple[str, ...] = ()
    disturbances: tuple[str, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StatedModelError:
    """Stated model error of a model's forces; None where nothing is stated.

    Attributes
    ----------
    share : standard deviation of unknown forces relative to the force, 1.
    amplitude : standard deviation of further unknown forces over the mass, m/s^2.
    correlation_time : of the unknown forces, s.
    """

    share: float | None = None
    amplitude: float | None = None
    correlation_time: float | None = None


@dataclass(frozen=True)
class Vehicle:
    """Stated data of a vehicle.

    Attributes
    ----------
    name : for people.
    values : parameter name -> number.
    effects : effect name -> tolerance: small effects known to be present at this size, with their sd.
    noise : signal name -> standard deviation of its sensor.
    steer_max : largest road-wheel angle, rad; None if not stated.
    model : the model that describes it best; None if open.
    tracking : what to track; None if open.
    model_error : "F_y", "F_x" -> error of a model's lateral and longitudinal forces.
    about : for people.
    path : the file it was read from.
    """

    name: str
    values: Mapping[str, Stated] = field(default_factory=dict)
    effects: Mapping[str, Stated] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    steer_max: float | None = None
    model: ChosenModel | None = None
    tracking: TrackingPlan | None = None
    model_error: Mapping[str, StatedModelError] = field(default_factory=dict)
    about: str = ""
    path: Path | None = field(default=None, compare=False)


KEYS = ("name", "about", "steer_max", "tyre_file", "parameters", "effects", "noise", "model_error", "model", "tracking")
TRACKING_KEYS = ("parameters", "disturbances", "noise")
FORCES = ("F_y", "F_x")
MODEL_ERROR_KEYS = ("share", "amplitude", "correlation_time")
STATED_KEYS = ("value", "sd", "min", "max", "source")


def shipped_vehicles() -> tuple[str, ...]:
    """Names of the vehicles that come with the package."""
    return shipped_files("vehicles")


def vehicle(target: str | Path | Vehicle, parameters: Collection[str] = (), effects: Collection[str] = ()) -> Vehicle:
    """A vehicle: a shipped one by name, a user's by the path of its file, or the vehicle itself.

    Parameters
    ----------
    target : name, path ending in .toml or .json, or vehicle.
    parameters, effects : names that models know; others are refused. Empty refuses none.

    Raises
    ------
    BadInput
        There is no such vehicle, or its file is not a valid vehicle file.
    """
    if isinstance(target, Vehicle):
        return target
    text, file = named_text(str(target), "vehicles", "vehicle", (".toml", ".json"))
    return parse_vehicle(text, file, parameters, effects)


def parse_vehicle(text: str, path: Path, parameters: Collection[str] = (), effects: Collection[str] = ()) -> Vehicle:
    """A vehicle from TOML or, if the path ends in .json, JSON text.

    Raises
    ------
    BadInput
        The text cannot be parsed, or a key or number in it is not valid.
    """
    where = str(path)
    table = _parsed(text, path)
    if misplaced := [key for key in table if key in parameters and key not in KEYS]:
        raise BadInput(f"{where}: {misplaced[0]} is a parameter and belongs under [parameters].")
    must_know(table, KEYS, where)
    stated, tolerated, sensors = (table_of(table, key, where) for key in ("parameters", "effects", "noise"))
    _all_known(stated, parameters, "parameter", f"{where}: [parameters]", {"effects": effects})
    _all_known(tolerated, effects, "effect", f"{where}: [effects]", {"parameters": parameters})
    _all_known(sensors, SIGNALS, "signal", f"{where}: [noise]")
    tyres = _tyres(table, path) if "tyre_file" in table else {}
    return Vehicle(
        name=text_of(table, "name", where, path.stem),
        values=tyres | {key: _with_value(entry, f"{where}: [parameters] {key}") for key, entry in stated.items()},
        effects={key: _tolerance(entry, f"{where}: [effects] {key}") for key, entry in tolerated.items()},
        noise={key: _above_zero(entry, f"{where}: [noise] {key}") for key, entry in sensors.items()},
        steer_max=_above_zero(table["steer_max"], f"{where}: steer_max") if "steer_max" in table else None,
        model=_model(table_of(table, "model", where), effects, f"{where}: [model]") if "model" in table else None,
        tracking=_tracking(table_of(table, "tracking", where), f"{where}: [tracking]") if "tracking" in table else None,
        model_error=_model_errors(table_of(table, "model_error", where), f"{where}: [model_error]"),
        about=text_of(table, "about", where),
        path=path,
    )


def _parsed(text: str, path: Path) -> Mapping[str, Any]:
    if path.suffix.lower() != ".json":
        return parse_toml(text, str(path))
    try:
        table = json.loads(text, object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:  # ValueError: also integers of thousands of digits
        raise BadInput(f"{path}: not valid JSON: {error}. Mend that line.") from error
    if not isinstance(table, dict):
        raise BadInput(f"{path}: a vehicle file is a table of keys, {', '.join(KEYS)}; this one is {table!r:.60}.")
    return table


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Table of a JSON object; raises `ValueError` for a repeated key, which JSON would silently overwrite."""
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [key for key, _ in pairs]
        raise ValueError(f'the key "{next(n for n in names if names.count(n) > 1)}" is there twice')
    return table


def _tyres(table: Mapping[str, Any], path: Path) -> dict[str, Stated]:
    """Tyre coefficients of a .tir file, whose path is relative to the vehicle file."""
    named = table["tyre_file"]
    if not isinstance(named, str) or Path(named).suffix.lower() != ".tir":
        raise BadInput(f"{path}: tyre_file must be the path of a .tir file in quotes, not {named!r:.60}.")
    return read_tyre_file(path.parent / named).stated()


def _model(table: Mapping[str, Any], effects: Collection[str], where: str) -> ChosenModel:
    if "name" not in table:
        raise BadInput(f'{where} has no name; say which model it is, for example name = "single_track".')
    added = table_of(table, "effects", where)
    _all_known(added, effects, "effect", f"{where} effects")
    return ChosenModel(
        name=text_of(table, "name", where),
        settings={key: value for key, value in table.items() if key not in ("name", "effects")},
        effects={key: _with_value(entry, f"{where} effects {key}") for key, entry in added.items()},
    )


def _tracking(table: Mapping[str, Any], where: str) -> TrackingPlan:
    must_know(table, TRACKING_KEYS, where)
    sizes = table_of(table, "noise", where)
    return TrackingPlan(
        parameters=_names(table, "parameters", where),
        disturbances=_names(table, "disturbances", where),
        noise={key: _above_zero(entry, f"{where} noise {key}") for key, entry in sizes.items()},
    )


def _model_errors(table: Mapping[str, Any], where: str) -> dict[str, StatedModelError]:
    result = dict[str, StatedModelError]()
    must_know(table, FORCES, where, "force")
    for force in table:
        value = table_of(table, force, where)
        must_know(value, MODEL_ERROR_KEYS, f"{where} {force}")
        result[force] = StatedModelError(**{key: _above_zero(value[key], f"{where} {force} {key}") for key in value})
    return result


def _names(table: Mapping[str, Any], key: str, where: str) -> tuple[str, ...]:
    names = table.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BadInput(f'{where}: {key} must be a list of names, as in {key} = ["C_alpha_f"], not {names!r:.60}.')
    return tuple(names)


def _with_value(entry: object, where: str) -> Stated:
    stated = _stated(entry, where)
    if stated.value is None:
        raise BadInput(f"{where} has no value; add one, as in {{ value = 1.0, sd = 0.1 }}.")
    return stated


def _tolerance(entry: object, where: str) -> Stated:
    if not isinstance(entry, Mapping) or "sd" not in entry:
        raise BadInput(
            f"{where} is a tolerance and needs its standard deviation, as in {{ sd = 0.003 }}; an effect that is part "
            "of the model goes under [model] effects."
        )
    return _stated(entry, where)


def _above_zero(entry: object, where: str) -> float:
    value = _with_value(entry, where).value
    assert value is not None
    if value <= 0:
        raise BadInput(f"{where} = {value:g} must be above zero.")
    return value


def _stated(entry: object, where: str) -> Stated:
    """A number, or a table of value, sd, min, max and source."""
    if not isinstance(entry, Mapping):
        return Stated(_number(entry, where))
    must_know(entry, STATED_KEYS, where)
    given = {key: _number(entry[key], f"{where}: {key}", key) for key in STATED_KEYS[:-1] if key in entry}
    low, high, value, sd = given.get("min", -inf), given.get("max", inf), given.get("value"), given.get("sd")
    if sd is not None and sd <= 0:
        raise BadInput(f"{where}: sd = {sd:g} must be above zero; omit sd if the value is known exactly.")
    if low > high:
        raise BadInput(f"{where}: min = {low:g} is above max = {high:g}; mend one of them.")
    if value is not None and not low <= value <= high:
        side, limit = ("below min", low) if value < low else ("above max", high)
        raise BadInput(f"{where}: value = {value:g} is {side} = {limit:g}; mend one of them.")
    return Stated(**given, source=text_of(entry, "source", where))


def _number(value: object, where: str, key: str = "value") -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadInput(
            f"{where} must be a number in the SI unit, not {value!r:.60}; "
            "write 1457.2 or { value = 1457.2, sd = 4.4 }."
        )
    unlimited = key in ("min", "max") and abs(value) == inf
    if not unlimited and not (abs(value) < 1e100 and isfinite(value)):
        raise BadInput(f"{where} must be a finite number, not {value!r:.60}.")
    return float(value)


def _all_known(
    table: Mapping[str, Any],
    names: Collection[str],
    what: str,
    where: str,
    others: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> None:
    """Refuse unknown keys; the error names the table to which a key belongs, if known."""
    for key in table:
        if names and key not in names:
            if elsewhere := [other for other, item in others.items() if key in item]:
                raise BadInput(f"{where} {key}: that is no {what} and belongs under [{elsewhere[0]}].")
            raise BadInput(
                f'{where} {key}: there is no {what} "{key}".{near(key, names)} Correct the name or remove it.'
            )


def write_vehicle(vehicle: Vehicle, path: str | Path) -> Path:
    """Write a vehicle as TOML or, if the path ends in .json, as JSON; atomically.

    Comments of the original file are lost, sources are kept.

    Raises
    ------
    BadInput : the file cannot be written.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in (".toml", ".json"):
        raise BadInput(f"{file}: a vehicle file ends in .toml or .json; name it so.")
    if suffix == ".json":
        return write_atomically(file, json.dumps(as_plain(vehicle), indent=1, ensure_ascii=False) + "\n")
    return write_atomically(file, vehicle_text(vehicle))


def vehicle_text(vehicle: Vehicle, comments: Mapping[str, str] = MappingProxyType({})) -> str:
    """The text of its TOML file; `comments` are appended to the entry, or table, of that name."""
    lines = [f"{VEHICLE_MARK} {__version__}", *_toml(as_plain(vehicle))]
    behind = {line: comments.get(line.partition(" =")[0].strip("\n[]"), "") for line in lines}
    return "\n".join(f"{line}  # {behind[line]}" if behind[line] else line for line in lines).strip() + "\n"


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
        force: {key: value for key, value in vars(item).items() if value is not None}
        for force, item in vehicle.model_error.items()
    }
    if vehicle.tracking is not None:
        tracking = vehicle.tracking
        plan = {
            "parameters": list(tracking.parameters),
            "disturbances": list(tracking.disturbances),
            "noise": dict(tracking.noise),
        }
        plain["tracking"] = {key: value for key, value in plan.items() if value}
    return {key: value for key, value in plain.items() if value != {}}


def _plainly(stated: Mapping[str, Stated]) -> dict[str, Any]:
    return {name: _plain(item) for name, item in stated.items()}


def _plain(stated: Stated) -> float | dict[str, float | str]:
    if stated.plain and not stated.source and stated.value is not None:
        return stated.value
    return {key: value for key, value in vars(stated).items() if value is not None and value != ""}


def _toml(plain: Mapping[str, Any]) -> Iterator[str]:
    """Lines: first the keys outside of tables, then one table after the other, one entry per line."""
    tables = {key: value for key, value in plain.items() if isinstance(value, Mapping)}
    for key, value in plain.items():
        if key not in tables:
            yield f"{key_of(key)} = {_inline(value)}"
    for key, table in tables.items():
        yield f"\n[{key_of(key)}]"
        for name, value in table.items():
            yield f"{key_of(name)} = {_inline(value)}"


def _inline(value: Any) -> str:
    if isinstance(value, Mapping):
        entries = [f"{key_of(key)} = {_inline(item)}" for key, item in value.items() if item is not None]
        return f"{{ {', '.join(entries)} }}" if entries else "{}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_inline(item) for item in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    return quoted(str(value))
