"""Files as tables of named columns, with the row numbers a person sees in the file."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from ..errors import BadInput
from ..recording import Array

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


@dataclass(frozen=True)
class RawTable:
    """Columns of a file.

    Attributes
    ----------
    where : the file as the user named it.
    names : column names, in the file's order.
    columns : the values, one series each.
    first_row : number of the first row of values as a person counts: 2 below a header line, else 1.
    units : units of columns, as far as the file states them.
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
        """(n,) values of a column; NaN where a cell is empty.

        Raises
        ------
        BadInput
            A cell holds something that is no number: names the row and the cell.
        """
        column = self.column(name)
        if pd.api.types.is_numeric_dtype(column.dtype) and not pd.api.types.is_bool_dtype(column.dtype):
            return column.to_numpy(dtype=float, na_value=np.nan)
        text = column.astype("string").str.strip()
        values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        strange = np.isnan(values) & text.notna().to_numpy() & (text != "").fillna(False).to_numpy(dtype=bool)
        if strange.any():
            row = int(np.argmax(strange))
            found = str(text.iloc[row])
            advice = (
                'Set decimal = "," in the column map, and separator to what stands between columns.'
                if _DECIMAL_COMMA.fullmatch(found)
                else "Mend the cell, or leave it empty if the value is missing."
            )
            raise BadInput(
                f'{self.where}: column "{name}", row {row + self.first_row}: {found!r:.60} is not a number. {advice}'
            )
        return values

    def labels(self, name: str) -> list[str]:
        """(n,) values of a column as text, for telling rows apart."""
        return [str(value) for value in self.column(name).tolist()]


def unique_names(names: tuple[str, ...], where: str) -> None:
    """Raise `BadInput` where two columns have one name."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise BadInput(
            f'{where}: column name "{twice[0]}" stands there {names.count(twice[0])} times. Rename all but one.'
        )


def one_column(names: tuple[str, ...]) -> str:
    """A hint for a header line that was not split; empty if it was."""
    found = max(";\t|", key=names[0].count) if len(names) == 1 else ""
    if not found or found not in names[0]:
        return ""
    return (
        f"The whole header line was read as one column, {names[0]!r:.80}; set separator = {json.dumps(found)} in the "
        "column map."
    )
