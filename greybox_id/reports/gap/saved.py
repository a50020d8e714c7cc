"""Provenance of a diagnosis, and its file.

Conversion of a diagnosis to plain data and back: numbers and words, nothing that is executed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from math import inf, nan
from pathlib import Path
from typing import Any, cast, get_type_hints

from ...base.declared import of_plain
from ...base.json_data import Kind, plain
from ...fitting.provenance import DataRecord
from ...fitting.scores.horizons import Errors
from ...gap.estimation.strip import Strip
from ...gap.gap import Budget, Closure, Gap, Limit, Ranked, Share, Unnamed
from ...models.effects import EFFECTS
from ...models.model import Model
from ...models.vehicle import Vehicle


def as_plain_data(gap: Gap) -> dict[str, Any]:
    """A diagnosis without the closed model, as values that JSON supports."""
    body = gap.to_json() | {"strip": asdict(gap.strip) if gap.strip is not None else None}
    return {name: plain(value) for name, value in body.items()}


def from_plain_data(body: Mapping[str, Any]) -> Gap:
    """Rebuild a diagnosis, without its closed model.

    Raises
    ------
    KeyError, TypeError, ValueError : if `body` was not made by `as_plain_data`.
    """
    kinds, other = get_type_hints(Gap), {
        "ranking": tuple(_ranked(item) for item in body["ranking"]),
        "gap": _closure(body["gap"]),
        "held_out": None if body["held_out"] is None else _closure(body["held_out"]),
        "closed": None,
        "strip": None if body["strip"] is None else _strip(body["strip"]),
        "limits": of_plain(Mapping[str, Limit], body.get("limits", {}), "limits", null=inf),
        "budget": _budget(body.get("budget", []), body),
        "unnamed": _unnamed(body.get("model_error")),
    }  # fmt: skip
    plain = {
        item.name: of_plain(kinds[item.name], body[item.name], item.name, null=nan)
        for item in fields(Gap)
        if item.name in body and item.name not in other
    }
    return Gap(**plain, **other)


def _ranked(body: Mapping[str, Any]) -> Ranked:
    low, high = body["interval"]
    filled = {**body, "magnitude": _number(body["magnitude"], inf), "interval": _interval(low, high)}
    return cast(Ranked, of_plain(Ranked, filled, "ranking", null=nan))


def _closure(body: Mapping[str, Any]) -> Closure:
    ends = {name: _number(body[name], inf) for name in ("before", "after")}
    errors = of_plain(tuple[Errors, ...], body["errors"], "errors", null=inf)
    rest = {**body, **ends, "closed_interval": _interval(*body["closed_interval"]), "errors": ()}
    return replace(cast(Closure, of_plain(Closure, rest, "gap", null=nan)), errors=errors)


def _budget(rows: Sequence[Mapping[str, Any]], body: Mapping[str, Any]) -> Budget | None:
    if not rows:
        return None
    named = [{"effect": "unexplained", "share": row.get("unnamed"), **row} for row in rows]
    *shares, rest = of_plain(tuple[Share, ...], named, "budget")
    on = body["held_out"] or body["gap"]
    recordings = of_plain(tuple[str, ...], on["recordings"], "recordings")
    return Budget(tuple(shares), rest, recordings, body["held_out"] is not None)


def _unnamed(body: Mapping[str, Any] | None) -> Unnamed | None:
    if body is None:
        return None
    ends = {"share": "share", "floor": "amplitude", "memory": "correlation_time"}
    forces = {f"{name}_{axis}": body[f"F_{axis}"][key] for name, key in ends.items() for axis in "yx"}
    worst = (body["worst"]["name"], body["worst"]["sd"])
    known = {name: _number(body.get(name), nan) for name in ("expected", "over_usual")}
    sizes = tuple(_number(body[force].get("size"), nan) for force in ("F_y", "F_x"))
    filled = {**body, **forces, **known, "worst": worst, "sizes": sizes}
    return cast(Unnamed, of_plain(Unnamed, filled, "model_error", null=nan))


def _strip(body: Mapping[str, Any]) -> Strip:
    result = cast(Strip, of_plain(Strip, body, "strip"))
    spectra = [*result.spectrum_before.values(), *result.spectrum_after.values()]
    if result.time.ndim != 1 or not result.time.shape == result.before.shape == result.after.shape:
        raise ValueError("the lines of its figure do not match")
    if any(item.shape != result.frequency.shape for item in spectra):
        raise ValueError("the spectra of its figure do not match its frequencies")
    return result


def _number(value: Any, unknown: float) -> Any:
    """A number; null stands for `unknown`, since JSON has only finite numbers."""
    return unknown if value is None else value


def _interval(low: Any, high: Any) -> tuple[Any, Any]:
    return _number(low, -inf), _number(high, inf)


KIND = Kind("greybox-gap", 1, "a diagnosis", "greybox gap", "diagnose again")


@dataclass(frozen=True)
class Number:
    """A stated number: `sd` is None if it is exact, `value` is None for a tolerance around no effect."""

    name: str
    value: float | None
    sd: float | None
    unit: str
    source: str


@dataclass(frozen=True)
class Made:
    """Provenance of a diagnosis.

    Attributes
    ----------
    vehicle : its name.
    command : reproduces the diagnosis.
    seed, version : of random numbers; of greybox-id.
    data : recordings; held-out ones have the role "validate".
    settings : of the model.
    effects : of the model, with their magnitudes.
    stated : numbers of the vehicle that the model has, and tolerances on effects.
    """

    vehicle: str
    command: str
    seed: int
    version: str
    data: tuple[DataRecord, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    effects: Mapping[str, float] = field(default_factory=dict)
    stated: tuple[Number, ...] = ()


def stated_numbers(vehicle: Vehicle, model: Model) -> tuple[Number, ...]:
    """The stated numbers of a vehicle that its model has, and tolerances on effects."""
    numbers = [
        Number(name, value.value, value.sd, model[name].unit, value.source)
        for name, value in vehicle.values.items()
        if name in model and model[name].shape == ()
    ]
    tolerances = [
        Number(name, effect.value, effect.sd, EFFECTS[name].parameter.unit, effect.source)
        for name, effect in vehicle.effects.items()
        if name in EFFECTS and effect.sd is not None
    ]
    return (*numbers, *tolerances)


def as_text(gap: Gap, made: Made) -> str:
    """Content of the file."""
    return KIND.text({**as_plain_data(gap), **asdict(made)})


def load_gap(path: str | Path) -> tuple[Gap, Made]:
    """Read a diagnosis, without its closed model, which is a separate vehicle file.

    Raises
    ------
    BadInput : if the file is not a diagnosis, is damaged, or was written by another version.
    """
    return KIND.load(path, lambda body: (from_plain_data(body), of_plain(Made, body, "diagnosis")))
