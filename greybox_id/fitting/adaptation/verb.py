"""The verb `adapt`: adapt a fit to a new recording of a car that may have changed; `Adaptation` is its result."""

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
"""Change of a parameter, in its standard deviations in the fit, beyond which it counts as moved."""


@dataclass(frozen=True)
class Outcome:
    """Performance of a model after the new seconds.

    Attributes
    ----------
    name : how the fit was adapted.
    rest : output -> error on the data after them; empty if there are none.
    interval : output -> 95 % interval in which that error was expected beforehand.
    """

    name: str
    rest: Mapping[str, Error]
    interval: Mapping[str, tuple[float, float]]

    def as_dict(self) -> dict[str, Any]:
        """Plain data; errors pooled, without windows across joins."""
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
    """Result of `adapt`.

    Attributes
    ----------
    fit : the chosen model, as a fit.
    chosen, zero_shot, adapted : performance on the rest of the choice, of the unchanged fit, and of the best candidate
        other than the unchanged fit.
    choices : output -> the chosen candidate, in words.
    tried : output -> candidates with their cross-validated error, in noise standard deviations.
    delays : run of the new seconds -> output -> delay of its readings, s; empty if time was not aligned.
    calibrated : the same for the rest's runs, if requested.
    moved : parameter -> number of its entries that changed by more than two of their standard deviations.
    seconds : seconds of motion used for the adaptation.
    in_sample : output -> pooled error on the new seconds themselves, as in the paper; no test.
    cpu_seconds : CPU time, s.
    doubts : sentences on why the recordings may be unreliable, to be shown first.
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
        """All but the fit, as plain data."""
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
    """Number of entries of each parameter that differ from the fit by more than `MOVED` standard deviations."""
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
    """The rows up to the end of the given seconds of motion, and the rest; None if nothing remains.

    Raises
    ------
    BadInput : the recording contains less motion than that.
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
    """Arguments of `adapt`, with `calibrate` as a number.

    Attributes
    ----------
    fit, recording, seconds, free, validate, trained, say : as in `adapt`.
    calibrate : seconds of motion from which the delay of every scored run is estimated; None for none.
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
    """Adapt a fit by the method of its model's kind; kinds without standard deviations cannot be adapted."""
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
    """Adapt a fit of a model with memory, or of equations of motion, to the first seconds of a new recording.

    The estimate is the posterior mode with prior means at the fit and the shapes of the model's own priors. Blocked
    cross-validation on the new seconds alone chooses the strength of the priors, the free parameters and whether time
    is aligned. The unchanged fit is always a candidate. For equations of motion see `motion`.

    Parameters
    ----------
    fit : the fit.
    recording : the new recording.
    seconds : seconds of motion to adapt to.
    free : "auto", or the free parameters: "F", "few", "paper", "physical", "all", names, several with commas.
    validate : recording to score instead of the rest of the new one.
    calibrate : "timing" or "timing=8s": the delay of every scored run is estimated from its first 5 s, or 8 s, of
        motion, which are then not scored.
    trained : the fit's training recordings, if available: their information keeps weights that the new seconds hardly
        inform. Without them, the fit's standard deviations replace them.
    say : receives progress, and warnings if the recordings may be unreliable.

    Raises
    ------
    BadInput : the fit is of another kind, the recording lacks a signal or is too short, or a name is unknown.
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
