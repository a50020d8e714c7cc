"""The recordings that a fit saw, found again, and what its model predicts of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..engine.simulation import Prediction
from ..fitting.fit import Fit
from ..fitting.provenance import DataRecord
from ..fitting.restated import as_seen
from ..fitting.scores.metrics import FREE_RUN

SECONDS = 15.0
"""Length of a typical stretch."""


@dataclass(frozen=True)
class Seen:
    """A recording that a fit saw, with the model's predictions of it.

    Attributes
    ----------
    role : "train" or "validate".
    recording : the same rows that the fit saw.
    outputs : of the model, those that are recorded.
    predicted : protocol -> predictions of them; those of simulations only where the model can run on its own.
    """

    role: str
    recording: Recording
    outputs: tuple[str, ...]
    predicted: Mapping[str, Prediction]

    @property
    def main(self) -> str:
        """The protocol a simulation is judged by: on the model's own predictions where it has that."""
        return next((name for name in (FREE_RUN, "closed_loop") if name in self.predicted), "honest")


AnySeen = TypeVar("AnySeen", bound=Seen)


def matched(fit: Fit, recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """The recordings of a fit, in its order. Raises `BadInput` where one is missing or is another file."""
    return tuple(as_seen(fit, _match(record, recordings)) for record in fit.data)


def of_role(recordings: Sequence[AnySeen], role: str) -> tuple[AnySeen, ...]:
    """Those that trained, or those that validated."""
    return tuple(one for one in recordings if one.role == role)


def shown_first(recordings: Sequence[AnySeen]) -> AnySeen:
    """The recording to show: the longest that validated, else the longest that trained."""
    choice = of_role(recordings, "validate") or tuple(recordings)
    return max(choice, key=lambda one: len(one.recording))


def run_rows(one: Seen, protocol: str) -> list[tuple[int, Prediction]]:
    """The predictions of each unbroken run of a recording, with the run's number from 1; runs without any left out."""
    whole = one.predicted[protocol]
    result = []
    for number, ends in enumerate(one.recording.runs, 1):
        inside = slice(*np.searchsorted(whole.rows, ends).tolist())
        if inside.stop > inside.start:
            part = Prediction(whole.rows[inside], whole.predicted[inside], whole.measured[inside], whole.run[inside])
            result.append((number, part))
    return result


def typical_stretch(one: Seen) -> tuple[int, int]:
    """The rows of the stretch whose error is nearest to that of the whole recording: neither its best nor its worst.

    The error is the mean over the outputs of the mean square, each relative to its own over the recording.
    """
    whole = one.predicted[one.main]
    average = _mean_squares(whole, len(whole.rows))
    length = max(2, round(SECONDS / one.recording.sample_time))
    best, least = (int(whole.rows[0]), int(whole.rows[-1]) + 1), np.inf
    parts = [part for _, part in run_rows(one, one.main)]
    length = min(length, max(len(part.rows) for part in parts))
    for part in (part for part in parts if len(part.rows) >= length):
        means = _mean_squares(part, length)
        distance = np.abs(np.log(np.maximum(np.mean(means / np.maximum(average, 1e-300), axis=1), 1e-12)))
        k = int(np.argmin(distance))
        if distance[k] < least:
            best, least = (int(part.rows[k]), int(part.rows[k + length - 1]) + 1), float(distance[k])
    return best


def _mean_squares(part: Prediction, length: int) -> Array:
    """(windows, outputs) mean square of the residuals over every stretch of so many rows, those that were read."""
    residual = part.predicted - part.measured
    known = np.isfinite(residual)

    def sums(values: Array) -> Array:
        total = np.cumsum(np.vstack([np.zeros(values.shape[1]), values]), axis=0)
        return np.asarray(total[length:] - total[:-length])

    squares = np.where(known, residual, 0.0) ** 2
    return np.asarray(sums(squares) / np.maximum(sums(known.astype(float)), 1.0))


def _match(record: DataRecord, recordings: Sequence[Recording]) -> Recording:
    if not recordings:
        raise BadInput(f"The fit saw {_named(record)}, but no recording was given; name it.")
    same = [r for r in recordings if r.source.sha256 == record.sha256 and (record.sha256 or r.name == record.name)]
    if not same:
        near = [r for r in recordings if r.name == record.name]
        if near:
            raise BadInput(
                f"{_where(near[0])} is not the file the fit saw: its sha256 begins with "
                f"{near[0].source.sha256[:12] or 'nothing'}, that of the fit's {record.role} data with "
                f"{record.sha256[:12] or 'nothing'}. Name the file the fit was made with, or fit again."
            )
        given = ", ".join(_where(r) for r in recordings)
        raise BadInput(
            f"The fit saw {_named(record)} to {record.role}, and none of the recordings given ({given}) is that file. "
            "Name the file the fit was made with, or fit again."
        )
    alike = [
        r for r in same if (len(r), len(r.runs), r.source.columns) == (record.samples, record.runs, record.columns)
    ]
    if not alike:
        other = same[0]
        raise BadInput(
            f"{_where(other)} is the file the fit saw, but read differently: {len(other)} rows in {len(other.runs)} "
            f"runs through column map {other.source.columns or 'none'}, where the fit had {record.samples} rows in "
            f"{record.runs} runs through {record.columns or 'none'}. Read it through that column map, or fit again."
        )
    return alike[0]


def _named(record: DataRecord) -> str:
    return record.path or record.name


def _where(recording: Recording) -> str:
    return recording.source.path or recording.name
