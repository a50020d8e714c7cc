"""Columns of a file as stored, before a column map assigns signals and units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from ..base.errors import BadInput
from ..base.shorthands import Array

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


@dataclass(frozen=True)
class RawTable:
    """Columns of a file.

    Attributes
    ----------
    where : the file as the user named it.
    names : column names, in the file's order.
    columns : the values, one series each.
    first_row : row number of the first values, counted from 1: 2 below a header line, else 1.
    units : column -> unit, for columns whose unit the file states.
    """

    where: str
    names: tuple[str, ...]
    columns: tuple[pd.Series[Any], ...]
    first_row: int
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0

    def column(self, name: str) -> pd.Series[Any]:
        """(n,) values of a column as the file holds them."""
        return self.columns[self.names.index(name)]

    def numbers(self, name: str) -> Array:
        """(n,) values of a column; NaN for empty cells.

        Raises
        ------
        BadInput
            A cell is not a number: the error names the row and the cell.
        """
        column = self.column(name)
        if pd.api.types.is_numeric_dtype(column.dtype) and not pd.api.types.is_bool_dtype(column.dtype):
            return column.to_numpy(dtype=float, na_value=np.nan)
        text = column.astype("string").str.strip()
        values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        strange = np.isnan(values) & text.notna().to_numpy() & (text != "").fillna(False).to_numpy(dtype=bool)
        if strange.any():
            row = int(np.argmax(strange))
            result = str(text.iloc[row])
            advice = (
                'Set decimal = "," in the column map, and separator to what stands between columns.'
                if _DECIMAL_COMMA.fullmatch(result)
                else "Mend the cell, or leave it empty if the value is missing."
            )
            raise BadInput(
                f'{self.where}: column "{name}", row {row + self.first_row}: {result!r:.60} is not a number. {advice}'
            )
        return values

    def turned(self) -> RawTable:
        """The table with its rows in reverse order."""
        return replace(self, columns=tuple(column.iloc[::-1].reset_index(drop=True) for column in self.columns))

    def labels(self, name: str) -> list[str]:
        """(n,) values of a column as text, to compare rows by."""
        return [str(value) for value in self.column(name).tolist()]
