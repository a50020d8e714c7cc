"""Numbers with or without a unit and a standard deviation: 3.5, "3.5 kg", (6, 3), "31±3 ms"."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import Any, TypeAlias

from .errors import BadInput
from .units import to_si

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?:inity)?"
_WRITTEN = re.compile(rf"\s*({_NUMBER})\s*(.*?)\s*", re.IGNORECASE)

Quantity: TypeAlias = float | str
"""A number in the SI unit, or a text that may have a unit: 3.5, "3.5 kg"."""


@dataclass(frozen=True)
class Belief:
    """A number as written, in its SI unit: value, and standard deviation where one was written."""

    value: float
    sd: float | None = None


def number(given: Quantity, unit: str, where: str) -> float:
    """A number with or without a unit, in SI.

    Parameters
    ----------
    given : 3.5, "3.5", "3.5kg", "30 ms".
    unit : the SI unit of what it stands for, which a bare number is taken to be in.
    where : what it stands for, for the sentence of an error.

    Raises
    ------
    BadInput : it is no number, or its unit measures something else.
    """
    if not isinstance(given, str):
        if isinstance(given, bool) or not isinstance(given, Real):
            raise BadInput(f"{where}: a number or a text such as '3.5kg' is needed, not {given!r:.60}.")
        return float(given)
    value, written = _split(given, where)
    factor, offset = _conversion(written, unit, where)
    return factor * value + offset


def belief(given: Quantity | tuple[float, float], unit: str, where: str) -> Belief:
    """A number that may have a standard deviation: 6, (6, 3), "6", "6±3", "6+-3 1/rad", "6 +/- 3", "31±3 ms".

    In a text the unit stands at the end, for both; where each has its own, both count.

    Raises
    ------
    BadInput : one of the two is no number, a unit measures something else, or the standard deviation is not above zero.
    """
    if isinstance(given, Iterable) and not isinstance(given, str):
        try:
            value, spread = (number(one, unit, where) for one in given)
        except ValueError as error:
            raise BadInput(f"{where}: (mean, sd) or a text such as '6±3' is needed, not {given!r:.60}.") from error
    elif not isinstance(given, str):
        return Belief(number(given, unit, where))
    else:
        mean, *rest = re.split(r"\s*(?:±|\+/-|\+-)\s*", given.strip())
        if not rest:
            return Belief(number(mean, unit, where))
        if len(rest) > 1:
            raise BadInput(f"{where}: {given!r} is not MEAN±SD, as in 6±3.")
        (value, entry), (sd, written) = _split(mean, where), _split(rest[0], where)
        factor, offset = _conversion(entry or written, unit, where)
        value, spread = factor * value + offset, _conversion(written, unit, where)[0] * sd
    if not (spread > 0 and isfinite(spread)):
        raise BadInput(f"{where}: the standard deviation in {given!r} must be a number above zero.")
    if not isfinite(value):
        raise BadInput(f"{where}: the mean in {given!r} must be a finite number.")
    return Belief(value, spread)


def pairs(written: Iterable[str], what: str, *, alone: bool = False) -> dict[str, Any]:
    """NAME=VALUE texts, as command lines and tables write them, by name.

    Parameters
    ----------
    written : texts.
    what : what each is to be, for the sentence of an error.
    alone : whether a NAME may stand without a value; its value is None.

    Raises
    ------
    BadInput : a text is not of this form.
    """
    result: dict[str, Any] = {}
    for text in written:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not name or (equals and not value) or not (equals or alone):
            raise BadInput(f"{text!r} is not {what}.")
        result[name] = value or None
    return result


def _split(text: str, where: str) -> tuple[float, str]:
    """The number, and the unit behind it."""
    result = _WRITTEN.fullmatch(text.replace("−", "-"))
    if result is None:
        raise BadInput(f"{where}: {text!r} is no number; write 3.5 or, with a unit, 3.5kg.")
    return float(result[1]), result[2]


def _conversion(written: str, unit: str, where: str) -> tuple[float, float]:
    """Factor and offset to the SI unit."""
    if not written or written == unit:
        return 1.0, 0.0
    try:
        result = to_si(written, unit)
    except BadInput as error:
        raise BadInput(f"{where}: {error}.") from error
    return result.factor, result.offset
