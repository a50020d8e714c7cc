"""Numbers as people write them, "3.5kg", "30 ms" or "6±3 1/rad", in the SI unit of what they stand for."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite

from ..errors import BadInput
from ..units import to_si

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?:inity)?"
_WRITTEN = re.compile(rf"\s*({_NUMBER})\s*(.*?)\s*", re.IGNORECASE)


@dataclass(frozen=True)
class Belief:
    """A number as written, in its SI unit: value, and standard deviation where one was written."""

    value: float
    sd: float | None = None


def named(pair: str, what: str) -> tuple[str, str]:
    """NAME and what is written behind its equals sign."""
    name, equals, text = pair.partition("=")
    if not equals or not name.strip() or not text.strip():
        raise BadInput(f"{pair!r} is not {what}.")
    return name.strip(), text.strip()


def number(text: str, unit: str, where: str) -> float:
    """A number with or without a unit, in SI.

    Parameters
    ----------
    text : "3.5", "3.5kg", "30 ms".
    unit : the SI unit of what it stands for, which a bare number is taken to be in.
    where : what it stands for, for the sentence of an error.

    Raises
    ------
    BadInput : it is no number, or its unit measures something else.
    """
    value, written = _split(text, where)
    factor, offset = _conversion(written, unit, where)
    return factor * value + offset


def belief(text: str, unit: str, where: str) -> Belief:
    """A number that may have a standard deviation: "6", "6±3", "6+-3 1/rad", "6 +/- 3", "31±3 ms".

    The unit stands at the end, for both; where each has its own, both count.

    Raises
    ------
    BadInput : one of the two is no number, a unit measures something else, or the standard deviation is not above zero.
    """
    mean, *rest = re.split(r"\s*(?:±|\+/-|\+-)\s*", text.strip())
    if not rest:
        return Belief(number(mean, unit, where))
    if len(rest) > 1:
        raise BadInput(f"{where}: {text!r} is not MEAN±SD, as in 6±3.")
    (value, own), (sd, written) = _split(mean, where), _split(rest[0], where)
    factor, offset = _conversion(own or written, unit, where)
    spread = _conversion(written, unit, where)[0] * sd
    if not (spread > 0 and isfinite(spread)):
        raise BadInput(f"{where}: the standard deviation in {text!r} must be a number above zero.")
    if not isfinite(value):
        raise BadInput(f"{where}: the mean in {text!r} must be a finite number.")
    return Belief(factor * value + offset, spread)


def _split(text: str, where: str) -> tuple[float, str]:
    """The number, and the unit behind it."""
    found = _WRITTEN.fullmatch(text.replace("−", "-"))
    if found is None:
        raise BadInput(f"{where}: {text!r} is no number; write 3.5 or, with a unit, 3.5kg.")
    return float(found[1]), found[2]


def _conversion(written: str, unit: str, where: str) -> tuple[float, float]:
    """Factor and offset to the SI unit."""
    if not written or written == unit:
        return 1.0, 0.0
    try:
        found = to_si(written, unit)
    except BadInput as error:
        raise BadInput(f"{where}: {error}.") from error
    return found.factor, found.offset
