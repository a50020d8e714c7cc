"""Adaptation of a fit to the first seconds of a recording of a car that may have changed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from pathlib import Path

from rich.console import RenderableType

from ..base.condition import span
from ..base.declared import understood
from ..base.errors import BadInput
from ..datasets.read import read as read_file
from ..datasets.recording import Recording
from ..fitting.adaptation.verb import Adaptation
from ..fitting.adaptation.verb import adapt as adapt_fit
from ..fitting.fit import Fit
from ..fitting.how import Say, quiet
from ..reports.text.adapt import parts
from ..reports.text.screen import as_text
from . import given
from .estimates import found_again
from .fit_result import FitResult
from .fitting import Progress
from .given import Columns


class AdaptationResult(Adaptation):
    """Result of `gb.adapt`: the adapted fit, and its errors compared with the unchanged fit.

    Attributes
    ----------
    fit : the selected model, as a fit.
    chosen, zero_shot, adapted : errors on the rest of the recording, of the selection, the unchanged fit and the best
        other candidate: `rest`, output -> error, and `interval`, output -> interval expected from the adaptation data.
    choices : output -> what was selected, in words.
    moved : parameter -> number of its entries that moved by more than two of their standard deviations.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 1000)
    >>> fit = gb.fit("msnn_bench_lat", lap.rows(0, 500), options=gb.FitOptions(strengths=1.0))
    >>> found = gb.adapt(fit, lap.rows(500, 1000), seconds=20)
    >>> found.fit.model.name
    'msnn_bench_lat'
    """

    @classmethod
    def of(cls, adaptation: Adaptation) -> AdaptationResult:
        """Wrap an adaptation."""
        return cls(**{field.name: getattr(adaptation, field.name) for field in fields(Adaptation)})

    def parts(self) -> Iterator[RenderableType]:
        """The text of the adaptation, part by part."""
        return parts(self)

    def summary(self) -> str:
        """The text that `greybox adapt` prints."""
        return as_text(self.parts())

    def __repr__(self) -> str:
        return f"Adaptation of {self.fit.model.name}: {self.chosen.name}"


@understood
def adapt(
    fit: Fit | str | Path,
    recording: Recording | str | Path,
    *,
    seconds: float = 20.0,
    free: str = "auto",
    validation: Recording | str | Path | None = None,
    calibrate: str | Iterable[str] = (),
    columns: Columns = "canonical",
    progress: Progress | None = None,
) -> AdaptationResult:
    """Adapt a fit of a model with memory, or of equations of motion, to the first seconds of a new recording.

    What moves, how far, and whether time is aligned is selected by blocked cross-validation on those seconds; the
    unchanged fit is always a candidate. If the fit's training data are available, they constrain what the new seconds
    do not determine.

    Parameters
    ----------
    fit : a fit, or its file.
    recording : of the car that may have changed.
    seconds : duration of motion for the adaptation; the rest is scored.
    free : "auto", or what may move: "all", or names of parameters, separated by commas; for models with memory also "F"
        (impulse responses), "few" (steering ratio and offset, motor gain), "paper", "physical". For equations of
        motion, "auto" and "all" are the parameters that the fit estimated.
    validation : scored instead of the rest.
    calibrate : "timing" or "timing=8s": the delay of each scored run is estimated from its first 5 s, or 8 s, of
        motion, which are not scored.
    columns : column map for files.
    progress : called with lines of progress.

    Returns
    -------
    Adaptation
        The adapted `fit`; `chosen`, `zero_shot`, `adapted` with errors on the rest; `doubts`, sentences on why the
        recordings may be unreliable; `summary()`, `as_dict()`.

    Raises
    ------
    BadInput : if the fit is of another kind, a recording lacks a signal or is too short, or a word is unknown.

    Examples
    --------
    >>> import greybox_id as gb
    >>> train = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 800)
    >>> fit = gb.fit("msnn_bench_lat", train, options=gb.FitOptions(strengths=1.0, solver="gauss-newton"))
    >>> other = gb.read(gb.datasets.shipped("racer_valid"), columns="roboracer").rows(0, 700)
    >>> found = gb.adapt(fit, other, seconds=20)
    >>> sorted(found.chosen.rest)
    ['yaw_rate']
    """
    from .fitting import load

    source = load(fit) if isinstance(fit, str | Path) else fit
    if not isinstance(source, Fit):
        raise BadInput(f"fit: a Fit or the path of its file is needed, not {source!r:.60}.")
    new = given.one_recording(recording, columns)
    scored = None if validation is None else given.one_recording(validation, columns, "validation")
    return adapted(source, new, seconds, free, scored, given.listed(calibrate, "calibrate"), say=progress or quiet)


def adapted(
    fit: Fit, new: Recording, seconds: float, free: str, validation: Recording | None, calibrate: Iterable[str],
    fit_file: Path | None = None, say: Say = quiet,
) -> AdaptationResult:  # fmt: skip
    """Adapt a fit, with its training data if they are still available."""
    trained = training_data(fit, fit_file)
    result = adapt_fit(
        fit, new, seconds=seconds, free=free, validate=validation, calibrate=tuple(calibrate), trained=trained, say=say
    )
    return AdaptationResult.of(replace(result, fit=FitResult.of(result.fit)))


def training_data(fit: Fit, fit_file: Path | None = None) -> list[Recording] | None:
    """The training recordings of a fit; None if one of them is missing or has changed."""
    if isinstance(fit, FitResult) and fit.recordings:
        return [
            recording for recording, record in zip(fit.recordings, fit.data, strict=False) if record.role == "train"
        ]
    file = fit_file or (fit.file if isinstance(fit, FitResult) else None)
    result = []
    for record in (item for item in fit.data if item.role == "train"):
        try:
            recording = read_file(found_again(record, file), record.mapping)
            if recording.source.sha256 != record.sha256:
                return None
            recording = recording.between(*span(record.between)) if record.between else recording
            recording = recording.where(record.where) if record.where else recording
        except BadInput:
            return None
        result.append(recording)
    return result or None
