"""Which tyre a model stands on, as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches

from ...errors import BadInput
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
            near = get_close_matches(self.tyre, list(TYRES), 1)
            hint = f" Did you mean {near[0]}?" if near else ""
            raise BadInput(f"There is no tyre {self.tyre!r}; there are {', '.join(TYRES)}.{hint}")

    @property
    def model(self) -> Tyre:
        """The tyre model of that name."""
        return TYRES[self.tyre]
