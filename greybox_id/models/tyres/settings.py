"""Which tyre a model stands on, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

from ...errors import BadInput, near
from . import TYRES, Tyre

FORMS = ("exact", "uncertain")


@dataclass(frozen=True)
class TyreSettings:
    """Hyperparameters of models whose only choice is the tyre.

    Attributes
    ----------
    tyre : one of `TYRES`.
    form : "exact", or "uncertain": a fit estimates the error of the equations' form along (`models.form`).
    """

    tyre: str = "pacejka"
    form: str = "exact"

    def __post_init__(self) -> None:
        if self.tyre not in TYRES:
            raise BadInput(f"There is no tyre {self.tyre!r}; there are {', '.join(TYRES)}.{near(self.tyre, TYRES)}")
        if self.form not in FORMS:
            raise BadInput(f"The form is {' or '.join(FORMS)}, not {self.form!r}.{near(self.form, FORMS)}")
        if self.form == "uncertain" and self.tyre == "linear":
            raise BadInput("A linear tyre has no curve whose form could be uncertain; choose another tyre.")

    @property
    def model(self) -> Tyre:
        """The tyre model of that name."""
        return TYRES[self.tyre]
