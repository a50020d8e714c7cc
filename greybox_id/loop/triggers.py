"""When it is time to learn anew: by counts of rows, as published, or by evidence that the vehicle is another one."""

from __future__ import annotations

from dataclasses import dataclass

FIRST, EVERY, LEAST = 5_000, 10_000, 2_000
"""Rows before the first time, between times, and since the last time at least, as published."""
EXCESS = 1.5
"""How many times the foretold path error is too much."""


@dataclass
class RowCounts:
    """Rows as they come.

    Attributes
    ----------
    first, every, least : see `FIRST`.
    last : rows when it was learned last; 0 before.
    """

    first: int = FIRST
    every: int = EVERY
    least: int = LEAST
    last: int = 0

    def due(self, rows: int) -> str:
        """Why it is time after so many rows in all; "" where it is not."""
        wanted = self.first if self.last == 0 else self.every
        if rows - self.last >= wanted:
            return f"{rows - self.last} rows since the last time"
        return ""

    def allowed(self, rows: int) -> bool:
        """Whether evidence may ask for it: there are enough new rows."""
        return rows - self.last >= self.least

    def done(self, rows: int) -> None:
        """It was learned."""
        self.last = rows


def path_error_beyond(path_error: float, foretold: float) -> str:
    """Why a path error over a lap, m, is more than what was foretold; "" where it is not."""
    if foretold > 0 and path_error > EXCESS * foretold:
        return f"path error {path_error:.3f} m, {foretold:.3f} m were foretold"
    return ""
