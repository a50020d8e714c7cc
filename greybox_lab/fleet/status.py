"""How far a fleet is: what came of its recordings, in all and by vehicle."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from greybox_id.base.declared import understood
from greybox_id.base.numbers import counted

from .statuses import BROKEN, WAITING
from .store import Store

MOST_SHOWN = 10
"""Recordings without a result that a summary lists."""


@dataclass(frozen=True)
class FleetStatus:
    """How far a fleet is.

    Attributes
    ----------
    recordings : that it has.
    statuses : status -> how many; "waiting" are not done.
    vehicles : vehicle -> status -> how many.
    broken : path, status and sentence of those without a result.
    cpu_seconds : that they took.
    folder : of the results.
    """

    recordings: int
    statuses: Mapping[str, int]
    vehicles: Mapping[str, Mapping[str, int]]
    broken: list[dict[str, str]]
    cpu_seconds: float
    folder: Path

    def to_json(self) -> dict[str, Any]:
        """The same as plain data."""
        return {**vars(self), "folder": str(self.folder)}

    def summary(self) -> str:
        """The same in lines."""
        states = ", ".join(f"{count} {name}" for name, count in sorted(self.statuses.items()))
        lines = [
            f"fleet    {counted(self.recordings, 'recording')} of {counted(len(self.vehicles), 'vehicle')}: {states}"
        ]
        for item in self.broken[:MOST_SHOWN]:
            named = item["path"] in item["sentence"]
            lines.append(f"         {'' if named else item['path'] + ': '}{item['sentence']}")
        if len(self.broken) > MOST_SHOWN:
            lines.append(f"         and {len(self.broken) - MOST_SHOWN} more without a result")
        return "\n".join(lines)


@understood
def status(folder: str | Path) -> FleetStatus:
    """How far a fleet is: what came of its recordings, in all and by vehicle.

    Parameters
    ----------
    folder : of the results.

    Raises
    ------
    BadInput : it holds none, or they are damaged.
    """
    store = Store.existing(folder)
    manifest, recordings = store.read("manifest"), store.current()
    waiting = store.waiting()
    ended = dict(zip(recordings["key"], recordings["status"], strict=True)) | waiting
    rows: dict[str, Counter[str]] = {}
    for key, vehicle in zip(manifest["key"], manifest["vehicle"], strict=True):
        rows.setdefault(str(vehicle), Counter())[ended.get(key, WAITING)] += 1
    broken = recordings[recordings["status"].isin(BROKEN)]
    shown = zip(broken["path"], broken["status"], broken["sentence"], strict=True)
    return FleetStatus(
        recordings=len(manifest),
        statuses=dict(sum(rows.values(), Counter())),
        vehicles={name: dict(counts) for name, counts in sorted(rows.items())},
        broken=[{"path": str(path), "status": str(how), "sentence": str(words)} for path, how, words in shown],
        cpu_seconds=float(recordings["cpu_s"].sum() + store.refits()["cpu_s"].sum()),
        folder=store.folder,
    )
