"""Which tyre a model stands on, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

from ...errors import BadInput, near
from . import TYRES, Tyre


@dataclass(frozen=True)
class TyreSettings:
    """Hyperparameters of models whose only choice is the tyre.

    Attributes
    ----------
    tyre : one of `TYRES`.
    """

    tyre: str = "pacejka"

    def __post_init__(self) -> None:
        if self.tyre not in TYRES:
            raise BadInput(f"There is no tyre {self.tyre!r}; there are {', '.join(TYRES)}.{near(self.tyre, TYRES)}")

    @property
    def model(self) -> Tyre:
        """The tyre model of that name."""
        return TYRES[self.tyre]
