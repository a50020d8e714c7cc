"""Column maps: which column of a file holds which signal, in which unit and with which sign.

A column map is a TOML file; the shipped ones are in `columns/`. It alone defines how a file's units, signs and names
are converted to ISO 8855 axes, SI units and names of `base/signals.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..base.errors import BadInput, near
from ..base.shorthands import Array
from ..base.signals import SIGNALS
from ..base.toml_file import must_know, parse_toml, quoted, table_of, text_of
from ..base.units import DEGREES_AND_MINUTES, degrees_of, to_si
from .shipped import named_text, shipped_files

NOTHING = ("", "nan", "None", "<NA>")
"""Texts of empty cells."""
HOLDS = ("zero", "linear")
SEPARATORS = (",", ";", "\t", "|")
MAP_KEYS = (
    "name",
    "about",
    "source",
    "hold",
    "rate",
    "separator",
    "decimal",
    "time",
    "signals",
    "extra",
    "runs",
    "start",
    "poses",
)
COLUMN_KEYS = (
    "column", "unit", "scale", "divide_by", "lookup", "sign", "offset", "optional", "sign_column", "negative",
    "missing",
)  # fmt: skip
RESTS = {"nanoseconds": "ns", "microseconds": "us", "milliseconds": "ms"}
"""Keys that name the column with the fraction of a second, and its unit."""
POSES_KEYS = ("forward", "left", "heading", "if_column")


@dataclass(frozen=True)
class Column:
    """Conversion of one column of a file to a signal.

    Attributes
    ----------
    signal : name of the signal.
    column : name in the file.
    unit : unit of the file's values after multiplication by `scale`, or of the values of `lookup`.
    si_unit : unit after conversion.
    scale : factor applied first (for counts, electrical speeds and the like).
    lookup : points (x, y), x increasing: linear interpolation from x to y, constant beyond the first and last point.
        Empty for none.
    sign : -1 turns a clockwise-positive or reversed axis into ISO 8855.
    offset : added last, in the SI unit.
    optional : whether the column may be missing.
    otherwise : alternative names of the column in other files; the first one in the file is used.
    other_units : units under the alternative names, if not `unit`.
    rest : of a time column: the column with the fraction of the second; empty for none.
    rest_unit : "ns", "us" or "ms" of that column.
    sign_column : the column that marks in which rows a magnitude is negative; empty for none.
    negative : value of the sign column in those rows, a number or a text.
    missing : numbers in the file that mean "no reading", such as -9999.
    """

    signal: str
    column: str
    unit: str
    si_unit: str
    scale: float = 1.0
    sign: int = 1
    offset: float = 0.0
    optional: bool = False
    lookup: tuple[tuple[float, float], ...] = ()
    otherwise: tuple[str, ...] = ()
    other_units: tuple[str, ...] = ()
    rest: str = ""
    rest_unit: str = "ns"
    sign_column: str = ""
    negative: float | str = 1.0
    missing: tuple[float, ...] = ()

    def sign_of(self, cell: str) -> float:
        """Factor on a magnitude for a text in the sign column; NaN for an empty cell."""
        text = cell.strip()
        if isinstance(self.negative, str):
            return np.nan if text in NOTHING else -1.0 if text == self.negative else 1.0
        try:
            value = float(text or "nan")
        except ValueError as error:
            raise BadInput(
                f'column "{self.sign_column}" holds the text {text!r:.60}, but the key "negative" of the column '
                "map is a number. If the column holds text, write that text in quotes."
            ) from error
        return np.nan if np.isnan(value) else -1.0 if value == self.negative else 1.0

    def convert(self, values: Array) -> Array:
        """File values (n,) converted to SI units (n,)."""
        conversion = to_si(self.unit, self.si_unit)
        values = np.where(np.isin(values, self.missing), np.nan, values) if self.missing else values
        scaled = self.scale * (degrees_of(values) if self.unit == DEGREES_AND_MINUTES else values)
        if self.lookup:
            scaled = np.interp(scaled, *np.array(self.lookup).T)
        return self.sign * (conversion.factor * scaled + conversion.offset) + self.offset

    def among(self, is_there: Callable[[str], object]) -> Column:
        """The column under the first of its names for which `is_there` is true; unchanged if none is."""
        return self.named(next(filter(is_there, (self.column, *self.otherwise)), self.column))

    def named(self, name: str) -> Column:
        """The column under one of its names, with the unit that belongs to that name."""
        units = dict(zip(self.otherwise, self.other_units, strict=False))
        return replace(self, column=name, unit=units.get(name, self.unit) if name != self.column else self.unit)

    @property
    def unit_field(self) -> str:
        """The unit key of a column map, with one unit or one per name."""
        if not self.other_units:
            return f"unit = {quoted(self.unit)}"
        return f"unit = [{', '.join(map(quoted, (self.unit, *self.other_units)))}]"

    @property
    def names(self) -> list[str]:
        """All columns of the file that are read for this one."""
        return [name for name in (self.column, self.rest, self.sign_column) if name]

    @property
    def sign_fields(self) -> list[str]:
        """The keys of a column map that mark negative rows."""
        if not self.sign_column:
            return []
        negative = quoted(self.negative) if isinstance(self.negative, str) else f"{self.negative:g}"
        return [f"sign_column = {quoted(self.sign_column)}", f"negative = {negative}"]

    @property
    def missing_fields(self) -> list[str]:
        """The key of a column map for numbers that mean "no reading"."""
        listed = ", ".join(f"{value:.15g}" for value in self.missing)
        return [f"missing = {listed if len(self.missing) == 1 else f'[{listed}]'}"] if self.missing else []

    @property
    def rest_fields(self) -> list[str]:
        """The key of a column map for the fraction of the second."""
        key = next(key for key, unit in RESTS.items() if unit == self.rest_unit)
        return [f"{key} = {quoted(self.rest)}"] if self.rest else []


@dataclass(frozen=True)
class Reference:
    """Mounting point of poses on the vehicle.

    Attributes
    ----------
    forward, left : position of the pose's point relative to the centre of gravity, m.
    heading : angle from the vehicle's x axis to the pose's x axis, to the left, rad.
    if_column : only for files with this column; empty for all files.
    """

    forward: float = 0.0
    left: float = 0.0
    heading: float = 0.0
    if_column: str = ""


@dataclass(frozen=True)
class ColumnMap:
    """Assignment of a file's columns to signals.

    Attributes
    ----------
    name : short name, kept in the recording's source.
    time : the time column; converted to seconds.
    signals : signal name -> column, for names of `greybox_id.base.signals.SIGNALS`.
    extra : name -> column, for further channels of the file.
    about, source : description for users: signs, pitfalls, origin of such files.
    hold : commands between rows, "zero" (held) or "linear".
    hold_stated : whether the map states `hold`; if not, fits and diagnoses compare both.
    rate : rows per second, Hz, of files without a time column; 0 for files with one.
    run_column : column whose change begins a new run; empty for none.
    run_column_optional : whether a file may lack it.
    start_column : column whose first non-zero value begins the recording; empty for none.
    start_column_optional : whether a file may lack it.
    poses : mounting points of x, y and yaw if the motion is to be estimated from them; the first one that applies to a
        file is used. Empty for none.
    where, text : name and text of a user's map; empty for shipped maps and those made in memory.
    separator, decimal : column separator and decimal sign of a text file; empty to detect them.
    """

    name: str
    time: Column
    signals: Mapping[str, Column]
    extra: Mapping[str, Column] = field(default_factory=dict)
    about: str = ""
    source: str = ""
    hold: Literal["zero", "linear"] = "zero"
    hold_stated: bool = True
    rate: float = 0.0
    run_column: str = ""
    run_column_optional: bool = False
    start_column: str = ""
    start_column_optional: bool = False
    poses: tuple[Reference, ...] = ()
    where: str = ""
    text: str = ""
    separator: str = ""
    decimal: str = ""

    @property
    def channels(self) -> tuple[Column, ...]:
        """All columns but time: signals first, then the extra ones."""
        return (*self.signals.values(), *self.extra.values())


def shipped_maps() -> tuple[str, ...]:
    """Names of the column maps that come with the package."""
    return shipped_files("columns")


def column_map(columns: str | Path | ColumnMap) -> ColumnMap:
    """A column map: a shipped one by name, a user's by path, or the map itself.

    Raises
    ------
    BadInput
        There is no such map, or the file is not a valid column map.
    """
    if isinstance(columns, ColumnMap):
        return columns
    text, file = named_text(str(columns), "columns", "column map")
    column_map = parse_column_map(text, str(file))
    return column_map if str(columns) in shipped_maps() else replace(column_map, where=str(columns), text=text)


def carried_map(columns: str, text: str) -> str | ColumnMap:
    """The map through which a recording was read: parsed from its stored text, else its name.

    Raises
    ------
    BadInput
        The stored text is not a valid column map.
    """
    return replace(parse_column_map(text, columns), where=columns, text=text) if text else columns or "canonical"


def parse_column_map(text: str, where: str) -> ColumnMap:
    """A column map from TOML text.

    Parameters
    ----------
    text : the TOML.
    where : file name for errors.

    Raises
    ------
    BadInput
        The text is not TOML, or a key, signal, unit or number in it is not valid.
    """
    table = parse_toml(text, where)
    must_know(table, MAP_KEYS, where)
    runs, start = (table_of(table, key, where) for key in ("runs", "start"))
    must_know(runs, ("column", "optional"), f"{where}: [runs]")
    must_know(start, ("column", "optional"), f"{where}: [start]")
    time, rate = _clock_of(table, where)
    signals = table_of(table, "signals", where)
    for name in signals:
        if name not in SIGNALS:
            raise BadInput(
                f'{where}: [signals.{name}]: there is no signal "{name}".{near(name, SIGNALS)} '
                f"Any other channel of the file goes under [extra.{name}]."
            )
    extra = table_of(table, "extra", where)
    for name in extra:
        if name in SIGNALS or name == "time":
            raise BadInput(f"{where}: [extra.{name}]: {name} is a known signal; write [signals.{name}].")
    if not signals and not extra:
        raise BadInput(f"{where}: no [signals.*] table names a column; add one, for example [signals.yaw_rate].")
    chosen = {
        "separator": _choice(table, "separator", SEPARATORS, where) if "separator" in table else "",
        "decimal": _choice(table, "decimal", (".", ","), where) if "decimal" in table else "",
    }
    if chosen["separator"] and chosen["separator"] == chosen["decimal"]:
        raise BadInput(f'{where}: decimal and separator are both ","; set separator = ";".')
    return ColumnMap(
        name=text_of(table, "name", where, Path(where).stem),
        about=text_of(table, "about", where),
        source=text_of(table, "source", where),
        time=time,
        rate=rate,
        signals={
            n: _column(table_of(signals, n, where), n, SIGNALS[n].unit, f"{where}: [signals.{n}]") for n in signals
        },
        extra={n: _column(table_of(extra, n, where), n, None, f"{where}: [extra.{n}]") for n in extra},
        run_column=text_of(runs, "column", f"{where}: [runs]"),
        run_column_optional=_truth(runs, "optional", f"{where}: [runs]"),
        start_column=text_of(start, "column", f"{where}: [start]"),
        start_column_optional=_truth(start, "optional", f"{where}: [start]"),
        poses=_poses(table["poses"], signals, f"{where}: [poses]") if "poses" in table else (),
        hold="linear" if _choice(table, "hold", HOLDS, where) == "linear" else "zero",
        hold_stated="hold" in table,
        **chosen,
    )


def _clock_of(table: Mapping[str, Any], where: str) -> tuple[Column, float]:
    """The time column, or the rows per second of a file without one."""
    entry = dict(table_of(table, "time", where))
    stated = [number for number in (table.get("rate"), entry.pop("rate", None)) if number is not None]
    if stated:
        rate = _number({"rate": stated[0]}, "rate", 0.0, where)
        if not 0 < rate < 1e6 or entry or len(stated) > 1:
            raise BadInput(
                f"{where}: rate must be one number above 0: the rows per second of a file without a time column. "
                f"State it once, and omit the time column."
            )
        return Column("time", "", "s", "s"), rate
    if "time" not in table:
        raise BadInput(
            f'{where}: there is no [time] table; add one, for example [time] column = "t", unit = "s", or rate = 20 '
            "for a file without time that has 20 rows a second."
        )
    return _time(entry, f"{where}: [time]"), 0.0


def _time(entry: Mapping[str, Any], where: str) -> Column:
    column = _column({key: value for key, value in entry.items() if key not in RESTS}, "time", "s", where)
    stated = [key for key in RESTS if key in entry]
    if len(stated) > 1:
        raise BadInput(f"{where}: {' and '.join(stated)} cannot both hold the fraction of the second; name one.")
    return replace(column, rest=text_of(entry, stated[0], where), rest_unit=RESTS[stated[0]]) if stated else column


def _column(entry: Mapping[str, Any], signal: str, si_unit: str | None, where: str) -> Column:
    must_know(entry, COLUMN_KEYS, where)
    if "unit" not in entry:
        raise BadInput(
            f'{where} has no unit; say in which unit the file holds it, for example unit = "{si_unit or 1}".'
        )
    column, *otherwise = _names(entry, signal, where)
    unit, *units = _units(entry, 1 + len(otherwise), where)
    try:
        converted = to_si(unit, si_unit).unit
        for other in units:
            to_si(other, si_unit or converted)
    except BadInput as error:
        raise BadInput(f"{where}: {error}.") from error
    divisor = _number(entry, "divide_by", 1.0, where)
    if divisor == 0.0:
        raise BadInput(f"{where}: divide_by must not be 0; it is the number of the file's units in one {unit}.")
    sign = _number(entry, "sign", 1.0, where)
    if abs(sign) != 1.0:
        raise BadInput(f"{where}: sign = {sign:g} must be 1 or -1; a factor belongs in scale or divide_by.")
    return Column(
        signal=signal,
        column=column,
        otherwise=tuple(otherwise),
        other_units=tuple(units),
        lookup=_lookup(entry, where),
        unit=unit,
        si_unit=converted,
        scale=_number(entry, "scale", 1.0, where) / divisor,
        sign=int(sign),
        offset=_number(entry, "offset", 0.0, where),
        optional=_truth(entry, "optional", where),
        sign_column=text_of(entry, "sign_column", where),
        negative=_negative(entry, where),
        missing=_missing(entry, where),
    )


def _missing(entry: Mapping[str, Any], where: str) -> tuple[float, ...]:
    """Numbers that mean "no reading": one, or a list."""
    values = entry.get("missing", [])
    return tuple(
        _number({"missing": v}, "missing", 0.0, where) for v in (values if isinstance(values, list) else [values])
    )


def _negative(entry: Mapping[str, Any], where: str) -> float | str:
    """Value of the sign column in negative rows."""
    if "negative" in entry and "sign_column" not in entry:
        raise BadInput(
            f"{where}: the key 'negative' says what the column 'sign_column' holds where the value is negative, but "
            f"'sign_column' is missing; name the column."
        )
    value = entry.get("negative", 1.0)
    return value.strip() if isinstance(value, str) else _number(entry, "negative", 1.0, where)


def _names(entry: Mapping[str, Any], signal: str, where: str) -> list[str]:
    """The names of a column."""
    names = entry.get("column", signal)
    if not isinstance(names, list):
        return [text_of(entry, "column", where, signal)]
    if not names or not all(isinstance(name, str) and name.strip() for name in names):
        raise BadInput(f"{where}: column must be a name in quotes or a list of names in quotes, not {names!r:.60}.")
    return names


def _units(entry: Mapping[str, Any], names: int, where: str) -> list[str]:
    """The unit of a column, or one per name."""
    units = entry["unit"]
    if not isinstance(units, list):
        return [text_of(entry, "unit", where)]
    if len(units) != names or not all(isinstance(unit, str) for unit in units):
        raise BadInput(
            f'{where}: unit must be one string, such as "m/s", or a list with one string for each name in column; '
            f"it is {units!r:.60}."
        )
    return units


def _lookup(entry: Mapping[str, Any], where: str) -> tuple[tuple[float, float], ...]:
    points = entry.get("lookup")
    if points is None:
        return ()
    advice = "write lookup = [[x, ...], [y, ...]], with at least two x, increasing, and one y for each"
    if not isinstance(points, list) or len(points) != 2 or not all(isinstance(row, list) for row in points):
        raise BadInput(f"{where}: lookup is {points!r:.60}; {advice}.")
    x, y = ([_number({"lookup": value}, "lookup", 0.0, where) for value in row] for row in points)
    if len(x) != len(y) or len(x) < 2 or any(b <= a for a, b in zip(x, x[1:], strict=False)):
        raise BadInput(
            f"{where}: lookup needs as many x as y values, and x must increase; it has {len(x)} x and "
            f"{len(y)} y values; {advice}."
        )
    return tuple(zip(x, y, strict=True))


def _poses(entries: object, signals: Mapping[str, Any], where: str) -> tuple[Reference, ...]:
    lacking = [name for name in ("x", "y", "yaw") if name not in signals]
    if lacking:
        raise BadInput(f"{where}: [poses] needs the signals x, y and yaw; map {', '.join(lacking)} under [signals].")
    given = entries if isinstance(entries, list) else [entries]
    tables: list[dict[str, Any]] = [table for table in given if isinstance(table, dict)]
    if not tables or len(tables) < len(given):
        raise BadInput(f"{where}: must be a table of {', '.join(POSES_KEYS)}, or several as [[poses]].")
    for table in tables:
        must_know(table, POSES_KEYS, where)
    return tuple(
        Reference(
            **{key: _number(table, key, 0.0, where) for key in POSES_KEYS[:3]},
            if_column=text_of(table, "if_column", where),
        )
        for table in tables
    )


def _choice(table: Mapping[str, Any], key: str, choices: tuple[str, ...], where: str) -> str:
    value = table.get(key, choices[0])
    if value not in choices:
        raise BadInput(f"{where}: {key} = {value!r:.60} must be one of {', '.join(map(repr, choices))}.")
    return str(value)


def _number(table: Mapping[str, Any], key: str, default: float, where: str) -> float:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e100 or math.isnan(value):
        raise BadInput(f"{where}: {key} must be a finite number, not {value!r:.60}.")
    return float(value)


def _truth(table: Mapping[str, Any], key: str, where: str) -> bool:
    value = table.get(key, False)
    if not isinstance(value, bool):
        raise BadInput(f"{where}: {key} must be true or false, not {value!r:.60}.")
    return value
