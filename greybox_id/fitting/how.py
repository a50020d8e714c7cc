"""How to fit: what a user may choose about the verb `fit`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from ..engine.motion.shooting import Starts

Solver = Literal["auto", "gauss-newton", "ipopt"]


class Say(Protocol):
    """Where progress goes: one line at a time; a passing line is only worth showing until the next one."""

    def __call__(self, line: str, passing: bool = False) -> None:
        """Show a line."""


def quiet(line: str, passing: bool = False) -> None:
    """Say nothing."""
    del line, passing


@dataclass(frozen=True)
class How:
    """How to fit.

    Attributes
    ----------
    strengths : "cross-validation", "early stopping", or a factor on every prior that has a strength.
    solver : "auto" finds with Gauss-Newton and certifies with Ipopt, "gauss-newton" skips the certificate,
        "ipopt" solves with Ipopt from the start.
    starts : how many starting points; all but the first are drawn about the nominal values.
    seed : of those draws.
    jobs : processes at a time, for starting points and what cross-validation compares; results do not depend on it.
    horizon : for motion models, s predicted from one start; None for whole runs.
    start_from : for motion models, "free" starts deviate from their readings, "measured" ones do not.
    robust : for motion models, residuals beyond so many standard deviations count linearly.
    noise : for motion models, output -> standard deviation of its readings, where it is known.
    """

    strengths: Literal["cross-validation", "early stopping"] | float = "cross-validation"
    solver: Solver = "auto"
    starts: int = 1
    seed: int = 0
    jobs: int = 1
    horizon: float | None = None
    start_from: Starts = "free"
    robust: float | None = None
    noise: Mapping[str, float] = field(default_factory=dict)

    @property
    def mode(self) -> str:
        """How the strength of regularisation is chosen, in words."""
        return self.strengths if isinstance(self.strengths, str) else "given"
