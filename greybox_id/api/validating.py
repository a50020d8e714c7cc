"""How far a fit is from recordings it was not fitted to, and whether it is usable on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rich.console import RenderableType

from ..datasets.recording import Recording
from ..fitting.choices.requested_model import must_be_recorded
from ..fitting.fit import Fit
from ..fitting.judging import judgement
from ..fitting.provenance import data_record
from ..fitting.scores.metrics import Scores, as_dict
from ..fitting.scores.verdict import HELD_OUT, distrust, used_signals
from ..fitting.verdict import Verdict
from ..reports.text.fit import errors_table, verdict_table
from ..reports.text.motion import motion_errors_table
from ..reports.text.screen import as_text


@dataclass(frozen=True)
class Validation:
    """A fit on recordings.

    Attributes
    ----------
    model : name of the fit's model.
    verdict : whether it is usable on them, and why not.
    scores : recording -> protocol or horizon -> output -> error.
    held : the same of persistence, the persistence; empty for models with memory.
    """

    model: str
    verdict: Verdict
    scores: Mapping[str, Scores]
    held: Mapping[str, Scores]

    def parts(self) -> Iterator[RenderableType]:
        """What it says, part by part."""
        value, beside = self._tables()
        yield verdict_table(self.verdict)
        yield ""
        yield motion_errors_table(value, beside=beside) if beside else errors_table(value)

    def summary(self) -> str:
        """What `greybox validate` prints: the verdict and the errors."""
        return as_text(self.parts())

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain data."""
        value, beside = self._tables()
        more = {"persistence": beside} if beside else {}
        return {**self.verdict.as_dict(), "model": self.model, "metrics": value, **more}

    def __repr__(self) -> str:
        return f"Validation of {self.model} on {', '.join(self.scores)}: {self.verdict.usability}"

    def _tables(self) -> tuple[dict[str, Any], dict[str, Any]]:
        value, beside = ({name: as_dict(each) for name, each in of.items()} for of in (self.scores, self.held))
        return value, beside


def validation(fit: Fit, recordings: Mapping[str, Recording]) -> Validation:
    """Score a fit on recordings, by name.

    Equations of motion are set beside persistence, and beside the model as it was before it was fitted.
    """
    model = fit.model
    must_be_recorded(model, list(recordings.values()))
    result = {name: distrust(used_signals(fit.model), recording) for name, recording in recordings.items()}
    data = [data_record(recording, HELD_OUT) for recording in recordings.values()]
    value = judgement(fit, recordings, result, data)
    return Validation(model.name, value.verdict, value.scores, value.held)
