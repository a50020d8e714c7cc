"""Units of files, converted to SI when read.

Only plain products of named units are understood (`m/s^2`, `deg/s`, `kg m^2`): anything longer is more often a
typing error than a unit.

Numbers with or without a unit and a standard deviation: 3.5, "3.5 kg", (6, 3), "31±3 ms".
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from .errors import BadInput
from .shorthands import Array
from .signals import SIGNALS

if TYPE_CHECKING:
    import pint

_FACTOR = r"(?:[^\W\d]\w{0,40}|[°%]|1)(?:\s*(?:\^|\*\*)\s*-?\d)?"
_EXPRESSION = re.compile(rf"\s*{_FACTOR}(?:\s*[*/·]\s*{_FACTOR}|\s+{_FACTOR}){{0,6}}\s*")
_SUPERSCRIPTS = str.maketrans({"²": "^2", "³": "^3", "·": "*"})

_COHERENT = frozenset(signal.unit for signal in SIGNALS.values()) - {"deg"}
"""Units of signals that are SI units without a factor."""


@dataclass(frozen=True)
class Conversion:
    """SI value = factor * value + offset.

    Attributes
    ----------
    unit : the SI unit, in pint's spelling.
    factor, offset : of the conversion; the offset is zero except for temperatures.
    """

    unit: str
    factor: float
    offset: float = 0.0


DEGREES_AND_MINUTES = "DDMM"
"""Latitude and longitude as NMEA 0183 writes them: 5224.5 is 52 degrees and 24.5 minutes."""


def degrees_of(values: Array) -> Array:
    """Values in DDMM (n,) converted to degrees (n,)."""
    whole = np.trunc(values / 100)
    return np.asarray(whole + (values - 100 * whole) / 60)


@functools.cache
def _registry() -> pint.UnitRegistry[Any]:
    # Imported and built on first use: this takes longer than reading most files.
    import pint

    return pint.UnitRegistry(cache_folder=None)


@functools.cache
def _not_a_unit() -> tuple[type[Exception], ...]:
    import pint

    return (
        pint.PintError,  # undefined units, dimensions that do not match, offset units in products
        ValueError,
        TypeError,
        AttributeError,  # pint attributes such as names that begin with an underscore
        KeyError,
        ArithmeticError,  # prefixes to the ninth power
    )


@functools.cache
def to_si(unit: str, target: str | None = None) -> Conversion:
    """How values in `unit` become values in SI.

    Parameters
    ----------
    unit : as written in a column map, for example "deg/s"; "g" means standard gravity where `target` is an
        acceleration.
    target : the SI unit wanted; None takes the SI unit of the same kind.

    Raises
    ------
    BadInput
        The unit is unknown, or of another kind than `target`. Angles count: "Hz" is not "rad/s".
    """
    if not _EXPRESSION.fullmatch(unit):
        raise BadInput(f'unit "{unit}" cannot be understood; write it like "m/s^2", "deg/s" or "rad"')
    spelled = "deg" if unit == DEGREES_AND_MINUTES else unit.translate(_SUPERSCRIPTS).strip()
    if spelled in ("g", "mg") and target == "m/s^2":
        spelled = f"{spelled}_0"  # to pint a plain g is a gram
    if spelled == target or (target is None and spelled in _COHERENT):  # most files: no need for pint's registry
        return Conversion(spelled, 1.0)
    if target is not None and (plain := _plain_factor(spelled, target)) is not None:
        return Conversion(target, plain)
    base = _base(spelled, unit)
    if target is None:
        factor, offset = _affine(spelled, base, unit)
        coherent = math.isclose(factor, 1.0, rel_tol=1e-12) and offset == 0.0
        return Conversion(spelled, 1.0) if coherent else Conversion(_plain(base), factor, offset)
    if base != _base(target, target):
        raise BadInput(f'unit "{unit}" is not a unit of this quantity, whose SI unit is {target}')
    return Conversion(target, *_affine(spelled, target, unit))


_TURN = math.pi / 180.0
_COMMON: dict[str, tuple[float, str]] = {
    "1": (1.0, ""), "%": (0.01, ""), "m": (1.0, "m"), "mm": (1e-3, "m"), "cm": (1e-2, "m"), "km": (1e3, "m"),
    "s": (1.0, "s"), "ms": (1e-3, "s"), "h": (3600.0, "s"), "kg": (1.0, "kg"), "g_0": (9.80665, "m s^-2"),
    "mg_0": (9.80665e-3, "m s^-2"),
    "rad": (1.0, "rad"), "mrad": (1e-3, "rad"), "deg": (_TURN, "rad"), "\u00b0": (_TURN, "rad"),
    "rpm": (math.tau / 60.0, "rad s^-1"), "N": (1.0, "kg m s^-2"), "kN": (1e3, "kg m s^-2"), "A": (1.0, "A"),
    "Hz": (1.0, "s^-1"), "V": (1.0, "kg m^2 s^-3 A^-1"), "W": (1.0, "kg m^2 s^-3"), "kW": (1e3, "kg m^2 s^-3"),
}  # fmt: skip
"""Common units: factor to SI, base units. They need no pint, which takes longer to load than most files to read."""


def _plain_factor(unit: str, target: str) -> float | None:
    """Factor to a target of the same dimension if both are products of common units; None leaves it to pint."""
    (factor, powers), (target_factor, target_powers) = _product(unit), _product(target)
    return factor / target_factor if powers is not None and powers == target_powers else None


def _product(unit: str) -> tuple[float, dict[str, int] | None]:
    """Factor to SI and powers of base units; None for the powers if one of the units is not common."""
    size, powers = 1.0, dict[str, int]()
    for sign, name, power in re.findall(r"([*/\s]*)([^\s*/^]+)(?:\s*(?:\^|\*\*)\s*(-?\d))?", unit):
        if name not in _COMMON:
            return size, None
        factor, parts = _COMMON[name]
        exponent = int(power or 1) * (-1 if "/" in sign else 1)
        size *= factor**exponent
        for part in parts.split():
            base, _, of_base = part.partition("^")
            powers[base] = powers.get(base, 0) + exponent * int(of_base or 1)
    return size, {base: power for base, power in powers.items() if power}


SPELLINGS = {
    "km/h": "kmh kph km/hr kmph km/h", "m/s": "mps m/sec m/s", "mph": "mph mi/h miles/h", "knot": "knots kn kt kts",
    "m/s^2": "m/s/s m/s2 m/sec2 m/s^2 m/s² mps2 m/(s^2) m/sec^2 ms-2", "g": "g gs g-force gforce",
    "mg": "mg", "mdeg/s": "mdps mdeg/s",
    "deg": "deg degree degrees ° º", "deg/s": "deg/s deg/sec degrees/s degrees/sec °/s º/s dps deg/second",
    "rad/s": "rad/s rad/sec radians/s", "rad": "rad radians", "s": "s sec secs second seconds unix_time unixtime",
    "ms": "ms msec millisecond milliseconds", "us": "us µs μs usec", "ns": "ns nsec", "rpm": "rpm 1/min rev/min u/min",
    "%": "% percent pct", "N m": "nm n*m n·m n.m", "degC": "c °c degc celsius", "degF": "f °f degf", "1": "1 ratio",
    "1/m": "1/m", "m": "m meter meters metres", "mm": "mm", "km": "km", "bar": "bar", "kPa": "kpa", "psi": "psi",
    "V": "v volt volts", "A": "a amp amps", "N": "n newton", "kN": "kn_force", "Hz": "hz", "kg": "kg", "l": "l liter",
    "mbar": "mbar", "l/h": "l/h", "min": "min", "lambda": "lambda la", "ft": "ft feet", "kW": "kw", "hp": "hp bhp",
}  # fmt: skip
"""Unit -> spellings in files, in lower case; "lambda" only helps to recognise a row of units and has no conversion."""
_SPELLED = {spelling: unit for unit, spellings in SPELLINGS.items() for spelling in spellings.split()}


def known_unit(text: str) -> str:
    """A unit stated in a file, as a column map writes it; empty if it is none of `SPELLINGS`."""
    return _SPELLED.get(re.sub(r"\s+", "_", text.strip()).lower(), "")


BASE = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd",
    "radian": "rad",
}  # fmt: skip
"""SI base units and the radian: pint's name -> symbol."""
_PRODUCT = re.compile(r"[A-Za-z0-9 /*^().·²³-]{1,40}")
_SIGNS = frozenset(("kg", "m", "s", "A", "K", "rad", "N", "J", "W", "V", "Pa", "Hz", "deg"))


@functools.cache
def si_exponents(unit: str) -> dict[str, int | float] | None:
    """A unit as powers of base units: "kg", "m", "s", "A", "K", "mol", "cd", "rad" -> exponent, and "factor" unless 1.

    None if the unit is not such a product, for example "N/unit".
    """
    recognised = all(word in _SIGNS for word in re.findall(r"[A-Za-z]+", unit))
    if not recognised or not _PRODUCT.fullmatch(unit) or re.search(r"\d\d", unit):
        return None
    try:
        base = _registry().Quantity(1, _registry().parse_units(unit.translate(_SUPERSCRIPTS))).to_base_units()
        powers = {BASE[name]: float(str(power)) for name, power in base.unit_items()}
        result: dict[str, int | float] = {name: int(power) for name, power in powers.items()}
        factor = float(base.magnitude)
    except _not_a_unit():
        return None
    if powers != result:
        return None
    return result | ({} if math.isclose(factor, 1.0, rel_tol=1e-12) else {"factor": factor})


def _base(spelled: str, written: str) -> str:
    registry = _registry()
    try:
        return str(registry.Quantity(1, registry.parse_units(spelled)).to_base_units().units)
    except _not_a_unit() as error:
        raise BadInput(f'unit "{written}" is not known; write it like "m/s^2", "deg/s" or "rad"') from error


def _affine(spelled: str, target: str, written: str) -> tuple[float, float]:
    quantity = _registry().Quantity
    try:
        at = [float(quantity(value, spelled).to(target).magnitude) for value in (0.0, 1.0, 2.0)]
    except _not_a_unit() as error:
        raise BadInput(f'unit "{written}" cannot be converted to {target}') from error
    factor = at[1] - at[0]
    if not math.isclose(at[2] - at[1], factor, rel_tol=1e-9):  # decibels and their like
        raise BadInput(f'unit "{written}" is not proportional to {target}; convert the column first')
    return factor, at[0]


def _plain(base: str) -> str:
    short = {"radian": "rad", "meter": "m", "second": "s", "kilogram": "kg", "ampere": "A", "kelvin": "K"}
    words = re.sub("|".join(short), lambda match: short[match.group()], base)
    return words.replace(" ** ", "^").replace(" / ", "/").replace(" * ", " ").replace("dimensionless", "1")


_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?:inity)?"
_WRITTEN = re.compile(rf"\s*({_NUMBER})\s*(.*?)\s*", re.IGNORECASE)

Quantity: TypeAlias = float | str
"""A number in the SI unit, or a text that may have a unit: 3.5, "3.5 kg"."""


@dataclass(frozen=True)
class Belief:
    """A number in its SI unit: value, and standard deviation if one was given."""

    value: float
    sd: float | None = None


def number(given: Quantity, unit: str, where: str) -> float:
    """A number with or without a unit, in SI.

    Parameters
    ----------
    given : 3.5, "3.5", "3.5kg", "30 ms".
    unit : the SI unit of the quantity, assumed for a bare number.
    where : the quantity's name in errors.

    Raises
    ------
    BadInput : not a number, or a unit of another dimension.
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

    In a text, a unit at the end holds for both numbers; each may also have a unit of its own.

    Raises
    ------
    BadInput : one of the two is not a number, a unit has another dimension, or the standard deviation is not positive.
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
        (value, unit_of_mean), (sd, unit_of_sd) = _split(mean, where), _split(rest[0], where)
        factor, offset = _conversion(unit_of_mean or unit_of_sd, unit, where)
        value, spread = factor * value + offset, _conversion(unit_of_sd, unit, where)[0] * sd
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
    what : the form expected of each text, for errors.
    alone : whether a NAME without a value is allowed; its value is None.

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
    """A text split into the number and the unit after it."""
    result = _WRITTEN.fullmatch(text.replace("−", "-"))
    if result is None:
        raise BadInput(f"{where}: {text!r} is not a number; write 3.5 or, with a unit, 3.5kg.")
    return float(result[1]), result[2]


def _conversion(written: str, unit: str, where: str) -> tuple[float, float]:
    """Factor and offset from the written unit to the SI unit."""
    if not written or written == unit:
        return 1.0, 0.0
    try:
        result = to_si(written, unit)
    except BadInput as error:
        raise BadInput(f"{where}: {error}.") from error
    return result.factor, result.offset
