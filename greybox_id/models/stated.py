"""One number as engineers state it: its value, how well it is known, and who says so."""

from __future__ import annotations

from dataclasses import dataclass
from math import isinf, isnan
from numbers import Real

from ..base.errors import BadInput


@dataclass(frozen=True)
class Stated:
    """One number as stated, in the SI unit of what it stands for.

    Attributes
    ----------
    value : the number; None for a tolerance about an effect's null value.
    sd : how well it is known, one standard deviation; None where nothing is said.
    min, max : what it can be at all; None where nothing is said.
    source : who says so.

    Raises
    ------
    BadInput : the value is no finite number, sd is negative, or min is above max.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.Stated(1457.2, sd=4.4, source="scale").plain
    False
    """

    value: float | None = None
    sd: float | None = None
    min: float | None = None
    max: float | None = None
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("value", "sd", "min", "max"):
            value = getattr(self, name)
            if value is not None and (
                not isinstance(value, Real) or isnan(value) or (name == "value" and isinf(value))
            ):
                raise BadInput(f"Stated, {name}: a number or None is needed, not {value!r:.40}.")
        if self.sd is not None and self.sd < 0.0:
            raise BadInput(f"Stated, sd: a standard deviation cannot be negative, but it is {self.sd:g}.")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise BadInput(f"Stated: min = {self.min:g} is above max = {self.max:g}.")

    @property
    def plain(self) -> bool:
        """Whether nothing but the number is stated."""
        return self.sd is None and self.min is None and self.max is None
