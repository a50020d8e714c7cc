"""Vehicle files: what is known of a vehicle, in TOML or in JSON with the same keys.

    name = "full-size car"
    steer_max = 0.5
    tyre_file = "tyre.tir"                            # optional: B, C, D, E of both axles, where they are not stated
    [parameters]                                      # SI units, a number or a table
    m = { value = 1457.2, sd = 4.4, source = "scale" }
    l_f = 1.296
    [effects]                                         # tolerances: small effects known to be there
    steering_lag = { sd = 0.003 }
    [noise]                                           # sensor standard deviations
    yaw_rate = 0.01
    [model_error]                                     # optional: how far its forces are off, as `greybox gap` left it
    F_y = { share = 0.02, amplitude = 0.05, correlation_time = 0.4 }    # 1, m/s^2, s
    [model]                                           # optional: the model that describes it best
    name = "single_track"
    tyre = "pacejka"
    effects = { steering_delay = { value = 0.03, sd = 0.002 } }
    [tracking]                                        # optional: what `greybox track` tracks of it
    parameters = ["C_alpha_f", "C_alpha_r"]
    disturbances = ["road_bank"]
    noise = { walk_v_y = 0.05 }

Shipped ones lie in `vehicles/`.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Collection, Mapping
from importlib import resources
from math import inf, isfinite
from pathlib import Path
from typing import Any

from ..errors import BadInput, near
from ..files import near_file
from ..guard import protect
from ..signals import SIGNALS
from ..vehicle import ChosenModel, Stated, StatedModelError, TrackingPlan, Vehicle
from .tyre_file import read_tyre_file

KEYS = ("name", "about", "steer_max", "tyre_file", "parameters", "effects", "noise", "model_error", "model", "tracking")
TRACKING_KEYS = ("parameters", "disturbances", "noise")
FORCES = ("F_y", "F_x")
MODEL_ERROR_KEYS = ("share", "amplitude", "correlation_time")
STATED_KEYS = ("value", "sd", "min", "max", "source")


def shipped_vehicles() -> tuple[str, ...]:
    """Names of the vehicles that come with the package."""
    folder = resources.files(__package__).joinpath("vehicles")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def vehicle(wanted: str | Path | Vehicle, parameters: Collection[str] = (), effects: Collection[str] = ()) -> Vehicle:
    """The vehicle that is meant: a shipped one by name, a user's by the path of its file, or the vehicle itself.

    Parameters
    ----------
    wanted : name, path ending in .toml or .json, or vehicle.
    parameters, effects : names that mean something to models; others are refused. Empty refuses none.

    Raises
    ------
    BadInput
        There is no such vehicle, or its file is no valid vehicle file.
    """
    if isinstance(wanted, Vehicle):
        return wanted
    name = str(wanted)
    if name in shipped_vehicles():
        entry = resources.files(__package__).joinpath("vehicles", f"{name}.toml")
        return parse_vehicle(entry.read_text("utf-8"), Path(f"{name}.toml"), parameters, effects)
    if Path(name).suffix.lower() not in (".toml", ".json"):
        raise BadInput(
            f'There is no vehicle "{name}".{near(name, shipped_vehicles()) or near_file(Path(name))} Shipped vehicles: '
            f"{', '.join(shipped_vehicles())}; your own is named by the path of its .toml or .json file."
        )
    protect(name)
    try:
        text = Path(name).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{name}: this vehicle file is not UTF-8 text; save it as UTF-8.") from error
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "no valid path"
        raise BadInput(
            f"{name}: the vehicle file cannot be read ({reason}).{near_file(Path(name))} Check the path."
        ) from error
    return parse_vehicle(text, Path(name), parameters, effects)


def parse_vehicle(text: str, path: Path, parameters: Collection[str] = (), effects: Collection[str] = ()) -> Vehicle:
    """A vehicle from TOML or, where the path says so, JSON text.

    Raises
    ------
    BadInput
        The text cannot be parsed, or a key or number in it cannot be used.
    """
    where = str(path)
    table = _parsed(text, path)
    for key in table:
        if key in KEYS:
            continue
        if key in parameters:
            raise BadInput(f"{where}: {key} is a parameter and belongs under [parameters].")
        raise BadInput(f'{where}: there is no key "{key}".{near(key, KEYS)} Known are {", ".join(KEYS)}.')
    stated, tolerated, sensors = (_table(table, key, where) for key in ("parameters", "effects", "noise"))
    _all_known(stated, parameters, "parameter", f"{where}: [parameters]")
    _all_known(tolerated, effects, "effect", f"{where}: [effects]")
    _all_known(sensors, SIGNALS, "signal", f"{where}: [noise]")
    tyres = _tyres(table, path) if "tyre_file" in table else {}
    return Vehicle(
        name=_text(table, "name", where, path.stem),
        values=tyres | {key: _with_value(entry, f"{where}: [parameters] {key}") for key, entry in stated.items()},
        effects={key: _tolerance(entry, f"{where}: [effects] {key}") for key, entry in tolerated.items()},
        noise={key: _above_zero(entry, f"{where}: [noise] {key}") for key, entry in sensors.items()},
        steer_max=_above_zero(table["steer_max"], f"{where}: steer_max") if "steer_max" in table else None,
        model=_model(_table(table, "model", where), effects, f"{where}: [model]") if "model" in table else None,
        tracking=_tracking(_table(table, "tracking", where), f"{where}: [tracking]") if "tracking" in table else None,
        model_error=_model_errors(_table(table, "model_error", where), f"{where}: [model_error]"),
        about=_text(table, "about", where, ""),
        path=path,
    )


def _parsed(text: str, path: Path) -> Mapping[str, Any]:
    kind = "JSON" if path.suffix.lower() == ".json" else "TOML"
    try:
        table = json.loads(text, object_pairs_hook=_once) if kind == "JSON" else tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also integers of thousands of digits
        raise BadInput(f"{path}: not valid {kind}: {error}. Mend that line.") from error
    if not isinstance(table, dict):
        raise BadInput(f"{path}: a vehicle file is a table of keys, {', '.join(KEYS)}; this one is {table!r:.60}.")
    return table


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """JSON lets a later key replace an earlier one in silence."""
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [key for key, _ in pairs]
        raise ValueError(f'the key "{next(n for n in names if names.count(n) > 1)}" is there twice')
    return table


def _tyres(table: Mapping[str, Any], path: Path) -> dict[str, Stated]:
    """Tyre coefficients of a .tir file beside the vehicle file."""
    named = table["tyre_file"]
    if not isinstance(named, str) or Path(named).suffix.lower() != ".tir":
        raise BadInput(f"{path}: tyre_file must be the path of a .tir file in quotes, not {named!r:.60}.")
    return read_tyre_file(path.parent / named).stated()


def _model(table: Mapping[str, Any], effects: Collection[str], where: str) -> ChosenModel:
    if "name" not in table:
        raise BadInput(f'{where} has no name; say which model it is, for example name = "single_track".')
    added = _table(table, "effects", where)
    _all_known(added, effects, "effect", f"{where} effects")
    return ChosenModel(
        name=_text(table, "name", where, ""),
        settings={key: value for key, value in table.items() if key not in ("name", "effects")},
        effects={key: _with_value(entry, f"{where} effects {key}") for key, entry in added.items()},
    )


def _tracking(table: Mapping[str, Any], where: str) -> TrackingPlan:
    for key in table:
        if key not in TRACKING_KEYS:
            hint = near(key, TRACKING_KEYS)
            raise BadInput(f'{where}: there is no key "{key}".{hint} Known are {", ".join(TRACKING_KEYS)}.')
    sizes = _table(table, "noise", where)
    return TrackingPlan(
        parameters=_names(table, "parameters", where),
        disturbances=_names(table, "disturbances", where),
        noise={key: _above_zero(entry, f"{where} noise {key}") for key, entry in sizes.items()},
    )


def _model_errors(table: Mapping[str, Any], where: str) -> dict[str, StatedModelError]:
    found = dict[str, StatedModelError]()
    for force in table:
        if force not in FORCES:
            hint = near(force, FORCES)
            raise BadInput(f'{where}: there is no force "{force}".{hint} Known are {", ".join(FORCES)}.')
        own = _table(table, force, where)
        for key in own:
            if key not in MODEL_ERROR_KEYS:
                hint = near(key, MODEL_ERROR_KEYS)
                raise BadInput(
                    f'{where} {force}: there is no key "{key}".{hint} Known are {", ".join(MODEL_ERROR_KEYS)}.'
                )
        found[force] = StatedModelError(**{key: _above_zero(own[key], f"{where} {force} {key}") for key in own})
    return found


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
    for key in entry:
        if key not in STATED_KEYS:
            hint = near(key, STATED_KEYS)
            raise BadInput(f'{where}: there is no key "{key}".{hint} Known are {", ".join(STATED_KEYS)}.')
    given = {key: _number(entry[key], f"{where}: {key}", key) for key in STATED_KEYS[:-1] if key in entry}
    low, high, value, sd = given.get("min", -inf), given.get("max", inf), given.get("value"), given.get("sd")
    if sd is not None and sd <= 0:
        raise BadInput(f"{where}: sd = {sd:g} must be above zero; leave sd out of what is known.")
    if low > high:
        raise BadInput(f"{where}: min = {low:g} is above max = {high:g}; mend one of them.")
    if value is not None and not low <= value <= high:
        side, limit = ("below min", low) if value < low else ("above max", high)
        raise BadInput(f"{where}: value = {value:g} is {side} = {limit:g}; mend one of them.")
    return Stated(**given, source=_text(entry, "source", where, ""))


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


def _all_known(table: Mapping[str, Any], names: Collection[str], what: str, where: str) -> None:
    for key in table:
        if names and key not in names:
            raise BadInput(
                f'{where} {key}: there is no {what} "{key}".{near(key, names)} Mend its name or take it out.'
            )


def _table(parent: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    value = parent.get(key, {})
    if not isinstance(value, dict):
        raise BadInput(f'{where}: "{key}" must be a table, not {value!r:.60}.')
    return value


def _text(table: Mapping[str, Any], key: str, where: str, default: str) -> str:
    value = table.get(key, default)
    if not isinstance(value, str) or (key == "name" and not value.strip()):
        raise BadInput(f"{where}: {key} must be text in quotes, not {value!r:.60}.")
    return value
