"""The verb `adapt`: a fit, a new recording of a car that may have changed, and what of the fit is to change with it.

What an adaptation found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ...base.errors import BadInput
from ...datasets.recording import Recording
from ...models.model import Model, by_kind
from ..fit import Fit
from ..how import Say, quiet
from ..scores.metrics import Error
from ..scores.timing import calibrated_seconds, moving, must_have_timing
from ..scores.verdict import doubted

MOVED = 2.0
"""A parameter has moved beyond so many of its standard deviations in the fit."""


@dataclass(frozen=True)
class Outcome:
    """How a model does after the new seconds.

    Attributes
    ----------
    name : what was done to the fit.
    rest : output -> error on what follows them; empty where nothing does.
    interval : output -> 95 % interval in which that error was expected before it was seen.
    """

    name: str
    rest: Mapping[str, Error]
    interval: Mapping[str, tuple[float, float]]

    def as_dict(self) -> dict[str, Any]:
        """As plain data; errors pooled, no window across a join."""
        return {
            "name": self.name,
            "rest": {
                output: {"rmse": item.rmse, "stderr": item.rmse_sd, "fvu": item.fvu, "samples": item.samples}
                for output, item in self.rest.items()
            },
            "interval": {output: list(item) for output, item in self.interval.items()},
        }


@dataclass(frozen=True)
class Adaptation:
    """What `adapt` found.

    Attributes
    ----------
    fit : the model as chosen, as a fit.
    chosen, zero_shot, adapted : how the choice, the fit as it was, and the best that was not the fit as it was do on
        the rest.
    choices : output -> what was chosen for it, in words.
    tried : output -> candidates with their cross-validated error, in noise standard deviations.
    delays : run of the new seconds -> output -> s by which readings are late; empty where time was not adapted.
    calibrated : the same of the rest's runs where that was asked for.
    moved : parameter -> how many of its entries moved beyond two of their standard deviations.
    seconds : of motion that were adapted to.
    in_sample : output -> pooled error on the new seconds themselves, as the paper tells it; no test.
    cpu_seconds : s.
    doubts : sentences on why the recordings are not to be trusted, which come before everything else.
    """

    fit: Fit
    chosen: Outcome
    zero_shot: Outcome
    adapted: Outcome
    choices: Mapping[str, str]
    tried: Mapping[str, Sequence[tuple[str, float]]]
    delays: Mapping[str, Mapping[str, float]]
    calibrated: Mapping[str, Mapping[str, float]]
    moved: Mapping[str, int]
    seconds: float
    in_sample: Mapping[str, Mapping[str, float]]
    cpu_seconds: float
    doubts: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """All of it but the fit, as plain data."""
        return {
            "model": self.fit.model.name,
            "seconds": self.seconds,
            "doubts": list(self.doubts),
            "chosen": self.chosen.as_dict(),
            "zero_shot": self.zero_shot.as_dict(),
            "adapted": self.adapted.as_dict(),
            "choices": dict(self.choices),
            "tried": {output: [list(item) for item in several] for output, several in self.tried.items()},
            "delays": {run: dict(delay) for run, delay in self.delays.items()},
            "calibrated": {run: dict(item) for run, item in self.calibrated.items()},
            "moved": dict(self.moved),
            "in_sample": {output: dict(item) for output, item in self.in_sample.items()},
            "cpu_seconds": self.cpu_seconds,
        }


def moved_from(fit: Fit, final: Model) -> dict[str, int]:
    """How many entries of each parameter are off by more than `MOVED` of their standard deviations in the fit."""
    result = {}
    for parameter in final.parameters:
        if parameter.name not in fit.model:
            result[parameter.name] = 1
            continue
        sd = np.asarray(fit.sd.get(parameter.name, np.nan))
        with np.errstate(invalid="ignore"):
            beyond = np.abs(parameter.array - fit.model[parameter.name].array) > MOVED * sd
        if np.any(beyond):
            result[parameter.name] = int(np.count_nonzero(beyond))
    return result


def parted(recording: Recording, seconds: float) -> tuple[Recording, Recording | None]:
    """The rows until so many seconds of motion are over, and the rest; None where nothing is left.

    Raises
    ------
    BadInput : the recording holds less motion than that.
    """
    recording.must_run()
    count = np.cumsum(moving(recording))
    needed = seconds / recording.sample_time
    if count[-1] < np.floor(needed * (1 - 1e-9)):
        raise BadInput(
            f"{recording.name} holds {count[-1] * recording.sample_time:.3g} s of motion, but {seconds:g} s were asked "
            "for (‹seconds›). Record more, or ask for less."
        )
    cut = int(np.searchsorted(count, np.ceil(needed * (1 - 1e-9)))) + 1
    first = recording.rows(0, cut)
    return first, recording.rows(cut, len(recording)) if cut < len(recording) else None


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
        f"A fit of {model.name} cannot be adapted: it keeps no uncertainty. Without it, nothing keeps parameters "
        f"near their estimates if the new data do not excite them. Fit it to the new recording together with "
        "the old ones."
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
