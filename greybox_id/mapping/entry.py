"""One line of a proposal."""

from __future__ import annotations

from dataclasses import dataclass

from ..datasets.column_map import Column
from ..signals import SIGNALS
from ..units import to_si


@dataclass(frozen=True)
class MapEntry:
    """What a column is proposed to be.

    Attributes
    ----------
    signal : the signal it may hold.
    column : its full name in the file.
    unit : the file's unit; empty where nothing tells it.
    sign : -1 where it counts the other way round.
    divide_by : file units in one `unit`, for counts.
    decided : whether it may stand in the map as it is; otherwise the user is asked.
    reasons : what speaks for it, or why it is left open.
    units : what the unit may be, where that is open.
    """

    signal: str
    column: str
    unit: str
    sign: int = 1
    divide_by: float = 1.0
    decided: bool = True
    reasons: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def as_column(self) -> Column:
        """The entry as a column map holds it; an unknown unit is taken as SI."""
        target = SIGNALS[self.signal].unit if self.signal in SIGNALS else "s"
        return Column(self.signal, self.column, self.unit or target, target, 1 / self.divide_by, self.sign)

    @property
    def factor(self) -> float:
        """SI value of one of the file's units, without the sign."""
        column = self.as_column()
        return to_si(column.unit, column.si_unit).factor * column.scale
