"""Rows of recordings as a network reads them: at its sample time, in windows, held out by blocks of time."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.base.signals import COMMANDS
from greybox_id.datasets.recording import Recording

from .net import DRIVE, Variant

EVEN = 1e-3
"""Share of the sample time by which steps may differ from it before a recording is resampled."""
BLOCK = 2.0
"""s, held out together or not at all: longer than a window, so that what is held out is not seen beside it."""
HELD_OUT = 0.1
"""Share of the blocks that is held out, as published (of rows, there)."""


@dataclass(frozen=True)
class StepWindows:
    """What a network reads and what came of it, a window a row.

    Attributes
    ----------
    seen : (n, history, inputs) SI units, the newest step first.
    following : (n, outputs) readings a step later.
    own : (n, outputs) what a model foretold of them; zeros where there is none.
    blocks : (n, 2) the first and the last block of time that it touches.
    """

    seen: Array
    following: Array
    own: Array
    blocks: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.seen)

    def split(self, rng: np.random.Generator) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(n,) windows to train on, and those held out; windows that touch both are neither."""
        known = np.unique(self.blocks)
        out = rng.choice(known, max(1, round(HELD_OUT * len(known))), replace=False)
        touches = np.isin(self.blocks, out)
        some: NDArray[np.bool_] = np.any(touches, axis=1)
        entirely: NDArray[np.bool_] = np.all(touches, axis=1)
        return ~some, entirely


def resampled(recording: Recording, sample_time: float) -> Recording:
    """The recording at equal steps, with a note where rows had to be made; readings run straight, commands keep their
    mean over a step.

    Raises
    ------
    BadInput : it was recorded more coarsely.
    """
    recording.must_run()
    steps = np.concatenate([np.diff(recording.time[a:b]) for a, b in recording.runs])
    if np.all(np.abs(steps - sample_time) <= EVEN * sample_time):
        return recording
    if sample_time < recording.sample_time * (1.0 - EVEN):
        raise BadInput(
            f"{recording.name} is recorded every {recording.sample_time:g} s, too slowly for steps of "
            f"{sample_time:g} s. Ask for a sample time of {recording.sample_time:g} s or more."
        )
    parts: dict[str, list[Array]] = {name: [] for name in recording.signals}
    times: list[Array] = []
    runs: list[tuple[int, int]] = []
    for a, b in recording.runs:
        t = recording.time[a:b]
        at = t[0] + sample_time * np.arange(int(np.floor((t[-1] - t[0]) / sample_time + EVEN)) + 1)
        begin = runs[-1][1] if runs else 0
        runs.append((begin, begin + len(at)))
        times.append(at)
        for name, values in recording.signals.items():
            value = values[a:b]
            if name in COMMANDS and recording.hold == "zero":
                ends = np.append(t, t[-1] + sample_time)
                total = np.concatenate([[0.0], np.cumsum(value * np.diff(ends))])
                until = np.interp([at, np.minimum(at + sample_time, ends[-1])], ends, total)
                parts[name].append((until[1] - until[0]) / (np.minimum(at + sample_time, ends[-1]) - at))
            else:
                parts[name].append(np.interp(at, t, value))
    note = f"{recording.name} was resampled from {recording.sample_time:g} s to {sample_time:g} s."
    signals = {name: np.concatenate(part) for name, part in parts.items()}
    made = replace(recording, time=np.concatenate(times), signals=signals, runs=tuple(runs))
    return replace(made, notes=(*recording.notes, note))


def columns(recording: Recording, names: Sequence[str], channel: str) -> Array:
    """(n, names) signals by what a network calls them."""
    return np.stack([recording[channel if name == DRIVE else name] for name in names], axis=1)


def windows(
    recordings: Sequence[Recording], variant: Variant, channel: str, sample_time: float, foretold: Sequence[Array]
) -> StepWindows:
    """All windows of recordings in which nothing is missing.

    Parameters
    ----------
    recordings : at that sample time.
    variant, channel, sample_time : see `ActuatorNet`.
    foretold : (n, outputs) of each, what a model says of the next row; NaN where it says nothing.
    """
    H, per_block = variant.history, max(round(BLOCK / sample_time), 1)
    seen, following, value, blocks, before = [], [], [], [], 0
    for recording, item in zip(recordings, foretold, strict=True):
        reads, says = (columns(recording, names, channel) for names in (variant.inputs, variant.outputs))
        for a, b in recording.runs:
            ends = np.arange(a + H - 1, b - 1)
            if len(ends):
                at = ends[:, None] - np.arange(H)
                seen.append(reads[at])
                following.append(says[ends + 1])
                value.append(item[ends])
                blocks.append(before + np.stack([(at[:, -1] - a) // per_block, (ends + 1 - a) // per_block], axis=1))
            before += (b - a) // per_block + 1
    if not seen:
        raise BadInput(
            f"No unbroken run is long enough: a run of {H + 1} steps is needed, of which the network reads {H}."
        )
    parts = [np.concatenate(each) for each in (seen, following, value)]
    whole = np.all([np.all(np.isfinite(part.reshape(len(part), -1)), axis=1) for part in parts], axis=0)
    return StepWindows(parts[0][whole], parts[1][whole], parts[2][whole], np.concatenate(blocks)[whole])


def data_hash(recordings: Sequence[Recording], names: Sequence[str], channel: str) -> str:
    """Hash of the rows that are read."""
    digest = hashlib.sha256()
    for recording in recordings:
        digest.update(np.ascontiguousarray(columns(recording, names, channel)).tobytes())
        digest.update(np.asarray(recording.runs, dtype=np.int64).tobytes())
    return digest.hexdigest()
