"""A diagnosis as plain data and back: numbers and words, nothing that is executed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import inf, nan
from typing import Any

import numpy as np

from ...base.json_data import plain
from ...fitting.scores.horizons import Errors
from ...gap.estimation.strip import Strip
from ...gap.estimation.wandering import Wander
from ...gap.gap import Budget, CauseClass, Closure, Gap, Limit, Moved, Ranked, Share, Unnamed, Where


def as_plain_data(gap: Gap) -> dict[str, Any]:
    """Everything of a diagnosis but the closed model, in kinds that JSON knows."""
    body = gap.to_json() | {"strip": asdict(gap.strip) if gap.strip is not None else None}
    return {name: plain(value) for name, value in body.items()}


def from_plain_data(body: Mapping[str, Any]) -> Gap:
    """The diagnosis again, without its closed model.

    Raises
    ------
    KeyError, TypeError, ValueError : `body` was not made by `as_plain_data`.
    """
    where = body["where"]
    return Gap(
        model=str(body["model"]),
        recordings=_words(body["recordings"]),
        doubts=_words(body["doubts"]),
        gap_detected=bool(body["gap_detected"]),
        p_value=_number(body["p_value"]),
        unknown_probability=_number(body["unknown_probability"]),
        unknown=str(body["unknown"]),
        where=Where(
            channel=str(where["channel"]),
            regime=str(where["regime"]),
            equations=_numbers(where["equations"]),
            time=_numbers(where["time"]),
            channels=_numbers(where["channels"]),
            regimes={str(name): _pair(value) for name, value in where["regimes"].items()},
        ),
        ranking=tuple(_ranked(item) for item in body["ranking"]),
        applied=_words(body["applied"]),
        gap=_closure(body["gap"]),
        held_out=None if body["held_out"] is None else _closure(body["held_out"]),
        not_excited={str(name): str(size) for name, size in body["not_excited"].items()},
        absorbed=_words(body["absorbed"]),
        advice=_words(body["advice"]),
        strip=None if body["strip"] is None else _strip(body["strip"]),
        noise_stated=bool(body["noise_stated"]),
        limits={str(name): Limit(**_limit(item)) for name, item in body.get("limits", {}).items()},
        budget=_budget(body.get("budget", []), body),
        unnamed=_unnamed(body.get("model_error")),
        resembles=tuple(_wander(item) for item in body.get("resembles", ())),
        moved=tuple(_moved(item) for item in body.get("moved", ())),
        tried=_numbers(body.get("tried", {})),
        held=str(body.get("held", "")),
        classes=tuple(_class(item) for item in body.get("classes", ())),
    )


def _class(body: Mapping[str, Any]) -> CauseClass:
    members, probability = _words(body["members"]), _number(body["probability"])
    return CauseClass(members, probability, _numbers(body["each"]), str(body["applied"]))


def _moved(body: Mapping[str, Any]) -> Moved:
    stated, sd, value = (_number(body[name]) for name in ("stated", "sd", "value"))
    return Moved(str(body["name"]), str(body["unit"]), stated, sd, value)


def _ranked(body: Mapping[str, Any]) -> Ranked:
    since, until = (None if body.get(end) is None else float(body[end]) for end in ("since", "until"))
    return Ranked(
        str(body["effect"]), float(body["probability"]), _number(body["magnitude"], inf), str(body["unit"]),
        _pair(body["interval"]), _words(body["indistinguishable_from"]), _number(body["gain"]),
        str(body.get("reason", "")), since, until, str(body.get("within", "")),
        _numbers(body.get("others", {})),
    )  # fmt: skip


def _budget(rows: Sequence[Mapping[str, Any]], body: Mapping[str, Any]) -> Budget | None:
    if not rows:
        return None
    result = [
        Share(str(row.get("effect", "unnamed")), float(row["share" if "effect" in row else "unnamed"]),
              float(row["low"]), float(row["high"]))
        for row in rows
    ]  # fmt: skip
    on = body["held_out"] or body["gap"]
    return Budget(tuple(result[:-1]), result[-1], _words(on["recordings"]), body["held_out"] is not None)


def _unnamed(body: Mapping[str, Any] | None) -> Unnamed | None:
    if body is None:
        return None
    y, x = body["F_y"], body["F_x"]
    return Unnamed(
        _number(y["share"]), _number(x["share"]), _number(y["amplitude"]), _number(x["amplitude"]),
        _number(y["correlation_time"]), _number(x["correlation_time"]), _number(body["tolerances"]),
        (str(body["worst"]["name"]), _number(body["worst"]["sd"])),
        _numbers(body["noise"]), _number(body.get("expected") or None),
    )  # fmt: skip


def _wander(body: Mapping[str, Any]) -> Wander:
    sd, correlation_time, gain = (_number(body[name]) for name in ("sd", "correlation_time", "gain"))
    return Wander(str(body["effect"]), str(body["unit"]), sd, correlation_time, gain)


def _limit(body: Mapping[str, Any]) -> dict[str, Any]:
    return {name: str(value) if name == "unit" else _number(value, inf) for name, value in body.items()}


def _closure(body: Mapping[str, Any]) -> Closure:
    return Closure(
        before=_number(body["before"], inf),
        after=_number(body["after"], inf),
        floor=_number(body["floor"]),
        closed=_number(body["closed"]),
        closed_interval=_pair(body["closed_interval"]),
        recordings=_words(body["recordings"]),
        errors=tuple(_errors(item) for item in body["errors"]),
    )


def _errors(body: Mapping[str, Any]) -> Errors:
    horizon = body["horizon"]
    return Errors(
        str(body["channel"]), str(body["unit"]), None if horizon is None else float(horizon),
        *(_number(body[name], inf) for name in ("before", "after", "floor")),
    )  # fmt: skip


def _strip(body: Mapping[str, Any]) -> Strip:
    time, before, after, x, y, frequency = (
        np.array(body[name], dtype=float) for name in ("time", "before", "after", "x", "y", "frequency")
    )
    first, then, cells = (_arrays(body[name]) for name in ("spectrum_before", "spectrum_after", "map"))
    result = Strip(time, before, after, x, y, frequency, first, then, cells)
    spectra = [*result.spectrum_before.values(), *result.spectrum_after.values()]
    if result.time.ndim != 1 or not result.time.shape == result.before.shape == result.after.shape:
        raise ValueError("the lines of its picture do not belong together")
    if any(item.shape != result.frequency.shape for item in spectra):
        raise ValueError("the spectra of its picture do not belong to its frequencies")
    return result


def _arrays(body: Mapping[str, Any]) -> dict[str, Any]:
    return {str(name): np.array(item, dtype=float) for name, item in body.items()}


def _words(body: Any) -> tuple[str, ...]:
    if not isinstance(body, list):
        raise TypeError(f"{body!r} is no list of words")
    return tuple(str(item) for item in body)


def _number(value: Any, unknown: float = nan) -> float:
    """A number; where it was printed for readers who know none that are not finite, what null stands for."""
    return unknown if value is None else float(value)


def _numbers(body: Mapping[str, Any]) -> dict[str, float]:
    return {str(name): _number(value) for name, value in body.items()}


def _pair(body: Any) -> tuple[float, float]:
    low, high = body
    return _number(low, -inf), _number(high, inf)
