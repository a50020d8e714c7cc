"""How good a fit is, on what it saw or on what is new: errors beside those of holding a reading, and the verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ..datasets.checks.finding import Finding
from ..datasets.recording import Recording
from ..models.model import Model, by_kind
from .fit import Fit
from .holding import as_fitted
from .provenance import DataRecord
from .scores.metrics import Scores, score_beside_hold, unfitted_scores
from .scores.verdict import HELD_OUT, TRAINED, judged
from .verdict import NOT_USABLE, USABLE, Reason, Verdict


@dataclass(frozen=True)
class Judgement:
    """What is held of a fit.

    Attributes
    ----------
    scores : role or recording -> protocol -> output -> its error.
    held : the same of holding the reading a prediction starts from, where its kind of model is set beside that.
    verdict : on the fit.
    """

    scores: Mapping[str, Scores]
    held: Mapping[str, Scores]
    verdict: Verdict


@by_kind
def carried(model: Model, fit: Fit, recording: Recording, name: str = "") -> list[Reason]:
    """A reason against a fit whose parameters do not carry over to a recording; empty where they do, or none is asked.

    Parameters
    ----------
    model : the fit's.
    fit : the fit.
    recording : that it has not seen.
    name : what to call it.
    """
    return []


@by_kind
def refuted(model: Model, fit: Fit, recording: Recording) -> Iterable[Reason]:
    """Reasons against a fit that other fits to its training data give; none where there are none, or none is asked.

    Parameters
    ----------
    model : the fit's.
    fit : the fit.
    recording : that it was trained on.
    """
    return []


def judgement(
    fit: Fit,
    recordings: Mapping[str, Recording],
    findings: Mapping[str, Sequence[Finding]],
    data: Sequence[DataRecord] | None = None,
) -> Judgement:
    """Score a fit, and judge it.

    Parameters
    ----------
    fit : the fit.
    recordings : by role or name; "train" is what it was fitted to, all else was held out.
    findings, data : as of `judged`.
    """
    recordings = {name: as_fitted(fit, recording) for name, recording in recordings.items()}
    both = {name: score_beside_hold(fit.model, recording) for name, recording in recordings.items()}
    value = {name: scores for name, (scores, _) in both.items()}
    held = {name: beside for name, (_, beside) in both.items() if beside}
    unseen = {name: recording for name, recording in recordings.items() if name != TRAINED}
    before = {name: unfitted_scores(fit, recording) for name, recording in (unseen or recordings).items()}
    verdict, against = judged(fit, value, held=held, unfitted=before, findings=findings, data=data), list[Reason]()
    if verdict.usability == USABLE:
        for name, recording in unseen.items():
            against += carried(fit.model, fit, recording, "" if name == HELD_OUT else name)
    if verdict.usability != NOT_USABLE and TRAINED in recordings:
        against += refuted(fit.model, fit, recordings[TRAINED])
    if against:
        verdict = judged(fit, value, held=held, unfitted=before, findings=findings, data=data, more=against)
    return Judgement(value, held, verdict)
