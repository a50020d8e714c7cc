"""How far a fleet is: what came of its recordings, in all and by vehicle.

How far a run is: a line of it, and the live table of a terminal.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from greybox_id.base.declared import understood
from greybox_id.base.numbers import counted
from greybox_id.base.processes import duration
from greybox_id.reports.text.screen import plain_table

from .statuses import BROKEN, OK, STATUSES, WAITING
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


SHOWN = 12
"""Vehicles shown: those with most recordings that did not end well."""


@dataclass
class FleetProgress:
    """How far a run is.

    Attributes
    ----------
    todo : recordings that are to be done.
    skipped : that were done before.
    counts : status -> how many of this run ended so.
    unworked : how many of these needed no work, since nothing could be read: they say nothing of how long others take.
    vehicles : vehicle -> status -> how many.
    cpu_seconds : of the processor, in units.
    last : sentence of the last recording that was not done; "" where there was none.
    dashboard : address of the engine's dashboard; "" where it has none.
    anew : how many of them earlier runs had done, and why they are done again; "" where there are none.
    lacks : what the engine waits for before it can begin; "" where there is nothing.
    began : of the clock.
    """

    todo: int = 0
    skipped: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    unworked: int = 0
    vehicles: dict[str, Counter[str]] = field(default_factory=dict)
    cpu_seconds: float = 0.0
    last: str = ""
    dashboard: str = ""
    anew: str = ""
    lacks: str = ""
    began: float = field(default_factory=time.monotonic)

    @property
    def done(self) -> int:
        """How many recordings of this run have ended."""
        return sum(self.counts.values())

    @property
    def seconds(self) -> float:
        """s since it began."""
        return time.monotonic() - self.began

    def line(self) -> str:
        """The same in a line."""
        states = ", ".join(f"{count} {status}" for status, count in sorted(self.counts.items()))
        left = ""
        worked = self.done - self.unworked
        if worked > 0 and self.done < self.todo:
            left = f", about {duration(self.seconds / worked * (self.todo - self.done))} left"
        return f"{self.done} of {self.todo} recordings{f' ({states})' if states else ''}{left}"

    def took(self, vehicle: str, result: Mapping[str, Any]) -> None:
        """Count a recording that has ended."""
        self.counts[result["status"]] += 1
        self.vehicles.setdefault(vehicle, Counter())[result["status"]] += 1
        self.unworked += "cpu_s" not in result
        self.cpu_seconds += result.get("cpu_s") or 0.0
        if result["status"] != OK:
            self.last = str(result.get("sentence", ""))


Watch = Callable[[FleetProgress], None]
"""Is handed the progress when it begins and after every recording."""


def live(progress: FleetProgress) -> RenderableType:
    """The table: a row for each vehicle, the worst first, and a line for all."""
    table = plain_table("vehicle", *STATUSES, right=STATUSES)
    worst = sorted(progress.vehicles.items(), key=lambda item: (item[1][OK] - sum(item[1].values()), item[0]))
    for name, counts in worst[:SHOWN]:
        table.add_row(Text(name), *(str(counts[status] or "") for status in STATUSES))
    if len(worst) > SHOWN:
        table.add_row(Text(f"and {len(worst) - SHOWN} more", style="dim"))
    lines: list[RenderableType] = [table, Text(f"{progress.line()}  {duration(progress.seconds)}")]
    if progress.last:
        lines.append(Text(progress.last, style="yellow", no_wrap=True, overflow="ellipsis"))
    return Group(*lines)
