"""Options of the verb `fit`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, get_args

from ..base.errors import BadInput, must_be_one_of, must_be_whole, near_or_all
from ..base.signals import unit_of, unit_of_quantity
from ..base.units import Quantity, number
from ..engine.motion.shooting import Starts
from ..models.model import Model, by_kind
from .scores.timing import calibrated_seconds, must_have_timing

Solver = Literal["auto", "gauss-newton", "ipopt"]


class Say(Protocol):
    """Receives progress, one line at a time; a passing line is replaced by the next one."""

    def __call__(self, line: str, passing: bool = False) -> None:
        """Show a line."""


def quiet(line: str, passing: bool = False) -> None:
    """Ignore progress."""
    del line, passing


FOR_MOTION: Mapping[str, object] = {"‹horizon›": None, "‹start_from›": "free", "‹robust›": None, "‹noise›": {}}
"""Options of fitting equations of motion, and their defaults."""
FOR_MEMORY = ("‹early_stopping|strengths›", "‹strength|strengths›")
"""Options of fitting models with memory."""


@by_kind
def refused(model: Model, option: str) -> str:
    """Why an option cannot be used with a kind of model; empty if it can."""
    return f"{option} cannot be used with {model.name}, which is {model.called}. Omit it."


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes
    ----------
    strengths : "cross-validation", "early stopping", or a factor on every prior that has a strength.
    solver : "auto" solves with Gauss-Newton and certifies with Ipopt, "gauss-newton" skips the certificate,
        "ipopt" solves with Ipopt from the start.
    starts : number of starting points; all but the first are drawn around the nominal values.
    seed : seed of those draws.
    jobs : number of processes for starting points and compared structures; results do not depend on it.
    horizon : for motion models, s predicted from one start; None for whole runs.
    start_from : for motion models, "free" estimates initial states, "measured" takes them from readings.
    robust : for motion models, Huber threshold in standard deviations, beyond which residuals count linearly.
    noise : for motion models, output -> standard deviation of its readings, if known: a number in SI, or a text with a
        unit.
    calibrate : for models with memory, "timing" or "timing=8s": training runs are aligned by their delays before the
        model is fitted to them; in the validation recording, the first 5 s, or 8 s, of motion of each run determine its
        delay, and the rest is scored. None: no alignment.

    Raises
    ------
    BadInput : a value cannot be used.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.FitOptions(horizon=2.0, starts=8, seed=1).horizon
    2.0
    >>> gb.FitOptions(horizon=-1)
    Traceback (most recent call last):
    ...
    greybox_id.base.errors.BadInput: horizon: seconds above zero are needed, or None for whole runs, not -1.
    """

    strengths: Literal["cross-validation", "early stopping"] | float = "cross-validation"
    solver: Solver = "auto"
    starts: int = 1
    seed: int = 0
    jobs: int = 1
    horizon: float | None = None
    start_from: Starts = "free"
    robust: float | None = None
    noise: Mapping[str, Any] = field(default_factory=dict)
    calibrate: str | None = None

    def __post_init__(self) -> None:
        for name, what in (("horizon", "seconds above zero are needed, or None for whole runs"),
                           ("robust", "standard deviations above zero are needed, or None")):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not above_zero(value):
                raise BadInput(f"‹{name}›: {what}, not {value!r:.40}.")
        for name, least in (("starts", 1), ("jobs", 1), ("seed", 0)):
            must_be_whole(getattr(self, name), name, least)
        for name, words in (("solver", get_args(Solver)), ("start_from", get_args(Starts))):
            must_be_one_of(words, getattr(self, name), f"‹{name}›: there is no")
        if self.strengths not in ("cross-validation", "early stopping") and not above_zero(self.strengths):
            raise BadInput(
                f'strengths: "cross-validation", "early stopping" or a factor above zero, not {self.strengths!r:.40}.'
            )
        object.__setattr__(self, "noise", {name: _sd(name, value) for name, value in self.noise.items()})
        calibrated_seconds(self.calibrate)
        if self.strengths == "early stopping" and self.solver == "ipopt":
            raise BadInput(
                "‹early_stopping|strengths› needs the steps of the solver gauss_newton; omit the ‹solver› ipopt."
            )

    def must_suit(self, model: Model) -> None:
        """Raise `BadInput` for options that this kind of model does not have."""
        if self.calibrate is not None:
            must_have_timing(model)
        chosen = {
            **{name: getattr(self, name.strip("‹›")) != item for name, item in FOR_MOTION.items()},
            FOR_MEMORY[0]: self.strengths == "early stopping", FOR_MEMORY[1]: not isinstance(self.strengths, str),
        }  # fmt: skip
        for name in (name for name, sentence in chosen.items() if sentence):
            if why := refused(model, name):
                raise BadInput(why)
        for name in self.noise:
            if name not in model.outputs:
                raise BadInput(f"‹noise› {name}: {model.name} has no output {name}.{near_or_all(name, model.outputs)}")

    @property
    def mode(self) -> str:
        """How the strength of regularisation is chosen, in words."""
        return self.strengths if isinstance(self.strengths, str) else "given"


def _sd(name: str, value: Quantity) -> float:
    """The standard deviation of a signal's readings, in its unit."""
    result = number(value, unit_of(name, unit_of_quantity(name)), f"‹noise› {name}")
    if not above_zero(result):
        raise BadInput(f"‹noise› {name}={value}: a standard deviation is a number above zero.")
    return result


def above_zero(value: object) -> bool:
    """Whether a value is a finite number above zero."""
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < float("inf")
