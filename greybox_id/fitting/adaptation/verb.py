"""The verb `adapt`: a fit, a new recording of a car that may have changed, and what of the fit is to change with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ...base.errors import BadInput
from ...datasets.recording import Recording
from ...models.kinds import by_kind
from ...models.model import Model
from ..fit import Fit
from ..how import Say, quiet
from ..scores.timing import calibrated_seconds, must_have_timing
from ..scores.verdict import doubted
from .outcome import Adaptation


@dataclass(frozen=True)
class AdaptTask:
    """What is adapted to, and how; as of `adapt`, but for the seconds of motion that tell a run's delay.

    Attributes
    ----------
    fit, recording, seconds, free, validate, trained, say : as of `adapt`.
    calibrate : s of motion in which every run that is scored tells its delay; None for none.
    """

    fit: Fit
    recording: Recording
    seconds: float
    free: str
    validate: Recording | None
    calibrate: float | None
    trained: Sequence[Recording] | None
    say: Say


@by_kind
def adapted(model: Model, task: AdaptTask) -> Adaptation:
    """A fit's model adapted as its kind is; of kinds that keep no uncertainty, none."""
    raise BadInput(
        f"A fit of {model.name} cannot be adapted: it keeps no uncertainty that would hold what the new seconds do not "
        "show. Fit it to the new recording together with the old ones."
    )


def adapt(
    fit: Fit,
    recording: Recording,
    *,
    seconds: float = 20.0,
    free: str = "auto",
    validate: Recording | None = None,
    calibrate: str | Sequence[str] = (),
    trained: Sequence[Recording] | None = None,
    say: Say = quiet,
) -> Adaptation:
    """Adapt a fit of a map with memory, or of equations of motion, to the first seconds of a new recording.

    The estimate is the most likely one with priors about the fit, of the shapes that the model's own priors have, and
    of a strength that blocked cross-validation on the new seconds alone chooses, as it chooses what moves and whether
    time is aligned. The fit as it was is always a candidate. Equations of motion: see `motion`.

    Parameters
    ----------
    seconds : of motion to adapt to.
    free : "auto", or which parameters move: "F", "few", "paper", "physical", "all", names, several with commas.
    validate : what is scored in place of the rest of the recording.
    calibrate : "timing" or "timing=8s": every run that is scored tells its delay in its first 5 s, or 8 s, of motion,
        which are then not scored.
    trained : the recordings that the fit was made from, where they are at hand: what they say of a weight that the new
        seconds hardly move keeps it. Without them, its standard deviation stands in.
    say : told what is being done, and why the recordings are not to be trusted, if they are not.

    Raises
    ------
    BadInput : the fit is of another kind, the recording lacks a signal or is shorter than that, a word stands for
        nothing.
    """
    if not (isinstance(seconds, int | float) and 0 < seconds < np.inf):
        raise BadInput(f"‹seconds›: a number above zero is needed, not {seconds!r:.40}.")
    calibrated = calibrated_seconds(calibrate)
    if calibrated is not None:
        must_have_timing(fit.model)
    doubts = doubted(fit.model, [recording] if validate is None else [recording, validate])
    for doubt in doubts:
        say(doubt)
    with threadpool_limits(1):  # the matrices are small
        task = AdaptTask(fit, recording, float(seconds), free, validate, calibrated, trained, say)
        return replace(adapted(fit.model, task), doubts=doubts)
