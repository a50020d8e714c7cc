"""Diagnoses and tracks in reports; a separate module, so that reports of fits need not import them."""

from __future__ import annotations

from pathlib import Path

from ..base.errors import BadInput
from ..gap.gap import Gap
from ..models.model import Model
from ..reports.document import Document
from ..reports.gap.report import gap_report
from ..reports.gap.saved import load_gap
from ..reports.track.digest import Digest, load_track
from ..reports.track.report import track_report
from .gap_result import GapResult
from .track_result import TrackResult

Other = Gap | TrackResult | Digest
"""Results that are not fits."""


def opened(file: str | Path, kind: str) -> Other:
    """The diagnosis or track in a file of this kind."""
    return GapResult.of(*load_gap(file)) if kind == "greybox-gap" else load_track(file)


def model_of(result: Other) -> Model | None:
    """The model of a result, if it has one."""
    return result.closed if isinstance(result, Gap) else None if isinstance(result, Digest) else result.model


def document(result: Other) -> Document:
    """The report of a result."""
    if isinstance(result, TrackResult | Digest):
        return track_report(result if isinstance(result, Digest) else result.digest)
    if not isinstance(result, GapResult):
        raise BadInput("This diagnosis does not record its model and recordings; make it anew with gb.diagnose.")
    return gap_report(result, result.made)
