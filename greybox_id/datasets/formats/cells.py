"""Cells of text: recognising numbers, instants, units and missing values, and converting columns of them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from ...base.units import known_unit

MOSTLY = 0.8
"""Share of a column's cells that must be numbers for the column to be numeric."""
NOTHING = frozenset(("", "-", "--", "n/a", "na", "none", "#", "[]", "()", "?", "unitless", "no unit", "null"))
"""Cells in a row of units of columns without a unit."""
MISSING = frozenset(NOTHING - {"#"} | {"---", "nan", "#n/a", "missing", "invalid"})
"""Cells that mean a missing value."""
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_INSTANT = re.compile(
    r"\d{4}[-/.]\d\d?[-/.]\d\d?([ T].*)?|\d{1,2}[./]\d{1,2}[./]\d{4}( .*)?|\d+:\d\d(:\d\d)?([.,]\d+)?"
)
_FORTRAN = re.compile(r"^([+-]?[\d.,]+)[dD]([+-]?\d+)$")
_THREE_BEHIND = re.compile(r"[+-]?\d{1,3},\d{3}")
_WITH_UNIT = re.compile(r"([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*([^\W\d][^\s]{0,10}|[°%][^\s]{0,10})")
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")


def is_value(cell: str) -> bool:
    """Whether a cell is a number or an instant."""
    return bool(_NUMBER.fullmatch(cell) or _INSTANT.fullmatch(cell))


def stated_unit(cell: str) -> str:
    """A unit as a column map writes it; empty if the cell is not a unit."""
    bare = cell.strip("[]() ")
    return "" if bare.lower() in NOTHING else known_unit(bare)


def unit_behind(cell: str) -> str:
    """The unit after a number in a cell; empty without one."""
    parts = _WITH_UNIT.fullmatch(cell)
    return parts[2] if parts and known_unit(parts[2]) else ""


def as_numbers(frame: pd.DataFrame, decimal: str) -> tuple[pd.DataFrame, dict[int, str], int]:
    """The rows with text converted to numbers, units in cells by column, and the number of non-numeric rows.

    Non-numeric rows between numbers are blanked: names repeated when a logger restarted, and its closing remarks.
    """
    texts: dict[Any, pd.Series[Any]] = {
        k: _cells_of(column) for k, column in frame.items() if not is_numeric_dtype(column.dtype)
    }
    known = {k: _numbers_in(text, decimal) for k, text in texts.items()}
    mostly = {k: v for k, (v, _) in known.items() if v.notna().sum() > MOSTLY * texts[k].notna().sum()}
    blank = np.empty(0, dtype=int)
    if mostly:
        words = np.any([(v.isna() & texts[k].notna()).to_numpy(dtype=bool) for k, v in mostly.items()], axis=0)
        numbers = [v.notna().to_numpy() for v in mostly.values()]
        numbers.append(frame.drop(columns=list(texts)).notna().any(axis=1).to_numpy())
        blank = np.flatnonzero(words & ~np.any(numbers, axis=0))
        others = [k for k in texts if k not in mostly]
        blank = np.array(
            [row for row in blank if not any(is_value(str(texts[k].iloc[row])) for k in others)], dtype=int
        )
    if len(blank):
        frame.iloc[blank] = None
        for text in texts.values():
            text.iloc[blank] = None
    units = dict[Any, str]()
    for k, text in texts.items():
        if known[k][0].notna().sum() == text.notna().sum() > 0:
            frame[k] = known[k][0].where(text.notna())
            units |= {k: known[k][1]} if known[k][1] else {}
    return frame, units, len(blank)


def _cells_of(column: pd.Series[Any]) -> pd.Series[Any]:
    """Texts of cells, with missing values as NA; Fortran's 1.0D+02 and the minus sign of print are converted."""
    text = column.astype("string").str.strip().str.replace("\N{MINUS SIGN}", "-", regex=False)
    text = text.str.replace(_FORTRAN, r"\1e\2", regex=True)
    return text.mask(text.str.lower().isin(MISSING).fillna(False))


def _numbers_in(text: pd.Series[Any], decimal: str) -> tuple[pd.Series[Any], str]:
    """(n,) numbers of cells, NaN for other cells, and the unit that follows all numbers.

    If a cell contains both "." and ",", the one that is not the decimal mark separates thousands.
    """
    if text.dropna().str.fullmatch(DECIMAL_COMMA).all() and not text.dropna().str.fullmatch(_THREE_BEHIND).all():
        decimal = ","  # in quoted cells also if commas separate columns
    unit, first = "", text.dropna().head(1)
    behind = unit_behind(first.iloc[0]) if len(first) else ""
    if behind and text.dropna().str.endswith(behind).all():
        text, unit = text.str.removesuffix(behind).str.strip(), known_unit(behind)
    other = "." if decimal == "," else ","
    thousands = rf"[+-]?(?:\d{{1,3}}(?:[{other}]\d{{3}})+|\d+)(?:[{decimal}]\d*)?"
    both = text.str.contains(rf"\d[{other}]\d{{3}}[{decimal}]", regex=True).any()
    if both and text.dropna().str.fullmatch(thousands).all():
        text = text.str.replace(other, "", regex=False)
    text = text.str.replace(",", ".", regex=False) if decimal == "," else text
    return pd.to_numeric(text, errors="coerce").astype(float), unit
