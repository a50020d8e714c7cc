"""The vehicle's memory of what it drove: part files, the last rows of all, kept until a server has them and beyond.

DIR/buffer.json        parts in their order: rows, policy, share of the grip, software, whether it was sent
DIR/rows_000001.csv    a part, as every command reads it
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.files import write_atomically
from greybox_id.base.json_data import read_json
from greybox_id.base.version import __version__
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording

from ...exam.make import write_recording

MOST, A_PART = 20_000, 500
"""Rows that are kept, 400 s of them, and of a part."""
PAUSE = 1.0
"""s between two runs on the buffer's clock: rows of different runs never join."""


@dataclass(frozen=True)
class RowPart:
    """A file of rows.

    Attributes
    ----------
    number : counted up for ever.
    rows : how many.
    ends : s, of its last row.
    policy : SHA-256 of the one that drove.
    cap : share of the grip that it might use.
    version : of greybox-id.
    sent : whether a server has it.
    """

    number: int
    rows: int
    ends: float
    policy: str
    cap: float
    version: str = __version__
    sent: bool = False


class RowBuffer:
    """RowPart files in a ring: the oldest rows go where there are more than `MOST`.

    Parameters
    ----------
    folder : made where it is not there; one that a buffer was in is carried on with.

    Attributes
    ----------
    parts : in their order.

    Raises
    ------
    BadInput : its list of parts is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._list = folder, folder / "buffer.json"
        held = read_json(self._list) if self._list.is_file() else []
        try:
            self.parts = [RowPart(**part) for part in held]
        except TypeError as error:
            raise BadInput(f"{self._list} is damaged; remove it, and the rows beside it.") from error

    def add(self, recording: Recording, policy: str, cap: float) -> None:
        """Keep what was driven; each of its runs begins anew on the buffer's clock."""
        for a, b in recording.runs:
            begins = self.parts[-1].ends + PAUSE if self.parts else 0.0
            times = recording.time[a:b] - recording.time[a] + begins
            cuts = np.linspace(a, b, -(-(b - a) // A_PART) + 1).astype(int)
            for low, high in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
                signals = {name: signal[low:high] for name, signal in recording.signals.items()}
                part = RowPart(self.last + 1, high - low, float(times[high - a - 1]), policy, cap)
                write_recording(Recording("rows", times[low - a : high - a], signals), self.file(part))
                self._keep([*self.parts, part])
        while sum(part.rows for part in self.parts) > MOST:
            self.file(self.parts[0]).unlink(missing_ok=True)
            self._keep(self.parts[1:])

    def forget(self, after: int) -> None:
        """Drop parts with a higher number: what led to them is done once more."""
        self._keep([part for part in self.parts if part.number <= after])

    @property
    def last(self) -> int:
        """Number of the last part; 0 before any."""
        return self.parts[-1].number if self.parts else 0

    def send(self, post: Callable[[bytes], object]) -> None:
        """Hand over what was not sent yet, the oldest first; what `post` raises leaves the rest for the next time."""
        for k, part in enumerate(self.parts):
            if not part.sent:
                post(self.file(part).read_bytes())
                self._keep([*self.parts[:k], replace(part, sent=True), *self.parts[k + 1 :]])

    def recordings(self, until: int) -> list[Recording]:
        """What is kept of the rows until a part's number."""
        return continued([read(self.file(part)) for part in self.parts if part.number <= until])

    def file(self, part: RowPart) -> Path:
        """Where a part is."""
        return self._folder / f"rows_{part.number:06d}.csv"

    def _keep(self, parts: Sequence[RowPart]) -> None:
        write_atomically(self._list, json.dumps([asdict(part) for part in parts]) + "\n", continued=True)
        self.parts = list(parts)


def continued(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings, where one goes on a sample after another has ended as a single one."""
    result = list[list[Recording]]()
    for recording in recordings:
        last = result[-1][-1] if result else None
        step = recording.time[0] - last.time[-1] if last is not None else 0.0
        if (
            last is not None
            and abs(step - recording.sample_time) < 0.5 * recording.sample_time
            and len(last.runs) == len(recording.runs) == 1
            and set(last.signals) == set(recording.signals)
        ):
            result[-1].append(recording)
        else:
            result.append([recording])
    return [_one(parts) for parts in result]


def _one(parts: Sequence[Recording]) -> Recording:
    if len(parts) == 1:
        return parts[0]
    times = np.concatenate([part.time for part in parts])
    signals = {name: np.concatenate([part[name] for part in parts]) for name in parts[0].signals}
    return replace(parts[0], time=times, signals=signals, runs=((0, len(times)),))
