"""Applying a repair that a check proposes: the column map with corrected signs, units and columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isclose
from typing import TYPE_CHECKING

from ..base.errors import BadInput
from ..base.numbers import exact
from ..base.toml_file import key_of, quoted
from ..base.units import to_si
from .column_map import Column, ColumnMap, carried_map, column_map
from .recording import Recording

if TYPE_CHECKING:
    from .checks.finding import Finding

SAME = 1e-3
"""Relative difference below which two factors are those of the same unit."""
UNITS = ("m/s", "km/h", "rad/s", "deg/s", "rpm", "rad", "deg", "m/s^2", "g", "m", "mm", "s", "ms", "us", "min")
TIME = "time"


@dataclass(frozen=True)
class Repaired:
    """A corrected column map.

    Attributes
    ----------
    mapping : the corrected map.
    changes : one phrase per change.
    """

    mapping: ColumnMap
    changes: tuple[str, ...]


def repaired(mapping: ColumnMap, findings: Sequence[Finding]) -> Repaired | None:
    """The map with the first repair that the findings propose; None if no proposed repair can be expressed in a map.

    Parameters
    ----------
    mapping : the map through which the recording was read.
    findings : of the check of that recording.
    """
    for finding in findings:
        if finding.repair and all(source in (*mapping.signals, TIME) for source, *_ in finding.repair.values()):
            return _with(mapping, finding.repair)
    return None


def in_words(recording: Recording, repair: Mapping[str, tuple[str, float, float]]) -> str:
    """Changes by a repair to the column map of a recording, in words; empty if that map is not known."""
    source = recording.source
    if not source.columns or not repair:
        return ""
    try:
        mapping = column_map(carried_map(source.columns, source.column_map))
    except BadInput:  # a map made in memory, such as a proposal, has neither text nor file
        return ""
    if not all(name in (*mapping.signals, TIME) for item, (of, *_) in repair.items() for name in (item, of)):
        return ""
    return "; ".join(_with(mapping, repair).changes)


def _with(mapping: ColumnMap, repair: Mapping[str, tuple[str, float, float]]) -> Repaired:
    signals, time, changes = dict(mapping.signals), mapping.time, []
    for name, (source, factor, offset) in repair.items():
        before = mapping.time if name == TIME else mapping.signals[name]
        after = _turned(
            replace(mapping.time if source == TIME else mapping.signals[source], signal=name), factor, offset
        )
        changes.append(f"{name}: {_changed(before, after)}")
        if name == TIME:
            time = after
        else:
            signals[name] = replace(after, optional=before.optional)
    return Repaired(replace(mapping, signals=signals, time=time), tuple(changes))


def _turned(column: Column, factor: float, offset: float) -> Column:
    """A column whose converted values are multiplied by `factor` and shifted by `offset`.

    The sign takes the factor's sign; its size changes the unit if one fits, else the scale.
    """
    sign = -1 if factor < 0 else 1
    size = abs(factor)
    target = to_si(column.unit, column.si_unit).factor * size
    unit, scale = column.unit, column.scale
    if abs(size - 1) > SAME:
        unit = next((item for item in UNITS if _converts(item, column.si_unit, target)), column.unit)
        scale = column.scale if unit != column.unit else column.scale * size
    return replace(column, sign=column.sign * sign, unit=unit, scale=scale, offset=column.offset * factor + offset)


def _converts(unit: str, target: str, factor: float) -> bool:
    try:
        return abs(to_si(unit, target).factor / factor - 1) < SAME
    except BadInput:
        return False


def _changed(before: Column, after: Column) -> str:
    words = []
    if before.column != after.column:
        words.append(f'from column "{after.column}" instead of "{before.column}"')
    if before.sign != after.sign:
        words.append(f"sign = {after.sign}")
    if before.unit != after.unit:
        words.append(f'unit = "{after.unit}" instead of "{before.unit}"')
    if before.scale != after.scale:
        words.append(f"scale = {exact(after.scale)} instead of {exact(before.scale)}")
    if not isclose(before.offset, after.offset):
        words.append(f"offset = {after.offset:.3g}" + (f" instead of {before.offset:.3g}" if before.offset else ""))
    return ", ".join(words) or "as it was"


def map_text(mapping: ColumnMap) -> str:
    """A column map as TOML text; parsing it gives the same map."""
    lines = [f"{key} = {quoted(value)}" for key, value in _words(mapping).items() if value]
    if mapping.rate:
        lines.append(f"rate = {mapping.rate!r}")
    else:
        lines += ["", "[time]", *column_fields(mapping.time), *mapping.time.rest_fields]
    for title, columns in (("signals", mapping.signals), ("extra", mapping.extra)):
        if columns:
            lines += [
                "",
                f"[{title}]",
                *(f"{key_of(n)} = {{ {', '.join(column_fields(c))} }}" for n, c in columns.items()),
            ]
    for title, column, optional in (
        ("runs", mapping.run_column, mapping.run_column_optional),
        ("start", mapping.start_column, mapping.start_column_optional),
    ):
        if column:
            lines += ["", f"[{title}]", f"column = {quoted(column)}", *(["optional = true"] if optional else [])]
    for pose in mapping.poses:
        numbers = [f"{key} = {getattr(pose, key)!r}" for key in ("forward", "left", "heading")]
        lines += ["", "[[poses]]", *numbers, *([f"if_column = {quoted(pose.if_column)}"] if pose.if_column else [])]
    return "\n".join(lines) + "\n"


def _words(mapping: ColumnMap) -> dict[str, str]:
    hold = mapping.hold if mapping.hold_stated else ""
    return {
        "name": mapping.name, "about": mapping.about, "source": mapping.source, "hold": hold,
        "separator": mapping.separator, "decimal": mapping.decimal,
    }  # fmt: skip


def column_fields(column: Column) -> list[str]:
    """The fields of a column's table in TOML."""
    names = [quoted(name) for name in (column.column, *column.otherwise)]
    listed = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
    fields = [f"column = {listed}", column.unit_field]
    fields += [f"scale = {column.scale!r}"] if column.scale != 1 else []
    fields += [f"sign = {column.sign}"] if column.sign != 1 else []
    fields += [f"offset = {column.offset!r}"] if column.offset else []
    fields += column.sign_fields + column.missing_fields
    if column.lookup:
        fields.append(f"lookup = [{', '.join(str(list(axis)) for axis in zip(*column.lookup, strict=True))}]")
    return fields + (["optional = true"] if column.optional else [])
