"""A recording's unbroken runs as a motion model sees them: inputs, readings, and where a prediction can start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array, Index, Mask
from ...datasets.recording import Recording
from ...models.motion_model import MotionModel

FEWEST_ROWS = 3
"""Shorter runs say nothing about motion."""


@dataclass(frozen=True)
class MotionRun:
    """One unbroken run.

    Attributes
    ----------
    name : of its recording.
    time : (n,) s.
    inputs : (n, inputs) as recorded.
    held : (inputs,) whether an input is held between rows; else it runs straight to the next row.
    measured : (n, outputs) readings, NaN where there is none.
    rows : rows of the recording that the n samples are.
    number : of the recording's runs the one that they are in, from 1.
    """

    name: str
    time: Array
    inputs: Array
    held: Mask
    measured: Array
    rows: range
    number: int = 1

    def __len__(self) -> int:
        return len(self.time)

    @property
    def sample_time(self) -> float:
        """Usual step, s."""
        return float(np.median(np.diff(self.time)))

    def states_read(self, model: MotionModel) -> tuple[str, ...]:
        """States of the model that have a reading somewhere in this run."""
        result = np.any(np.isfinite(self.measured), axis=0)
        return tuple(
            state.name
            for state in model.states
            if state.name in model.outputs and result[model.outputs.index(state.name)]
        )

    def starts(self, measured: Sequence[int], index: Index) -> Index:
        """Rows near those wanted at which so many outputs have a reading: the wanted one or the next that has."""
        good = np.flatnonzero(np.all(np.isfinite(self.measured[:, list(measured)]), axis=1))
        if len(good) == 0:
            return np.empty(0, dtype=np.intp)
        places = np.searchsorted(good, index)
        return np.unique(good[places[places < len(good)]])


def motion_runs(model: MotionModel, recording: Recording, *, unread: bool = False) -> list[MotionRun]:
    """The runs of a recording in which every input is there.

    Parameters
    ----------
    model : the model.
    recording : the recording.
    unread : whether a recording of inputs alone will do.

    Raises
    ------
    BadInput : an input is missing, no output was recorded, or no run is long enough.
    """
    table = np.column_stack([_input(model, recording, name) for name in model.inputs]) if model.inputs else None
    if table is None:
        table = np.empty((len(recording), 0))
    if not unread and not any(name in recording for name in model.outputs):
        raise BadInput(
            f"{recording.name} has none of the outputs of {model.name} ({', '.join(model.outputs)}); "
            f"it has {', '.join(recording.signals)}. Map at least one of them in the column map (‹columns›)."
        )
    nothing = np.full(len(recording), np.nan)
    measured = np.column_stack([recording.signals.get(n, nothing) for n in model.outputs])
    held = np.array([name in model.commands and recording.hold == "zero" for name in model.inputs], dtype=bool)
    result = []
    for number, (start, stop) in enumerate(recording.runs, 1):
        complete = np.all(np.isfinite(table[start:stop]), axis=1)
        for a, b in _stretches(complete):
            rows = range(start + a, start + b)
            value = slice(rows.start, rows.stop)
            if len(rows) >= FEWEST_ROWS:
                part = recording.time[value], table[value], held, measured[value]
                result.append(MotionRun(recording.name, *part, rows, number))
    if not result:
        raise BadInput(
            f"{recording.name} has no unbroken run of {FEWEST_ROWS} rows in which {', '.join(model.inputs)} are all "
            "there. Take a longer recording, or see with greybox data check where values are missing and runs end."
        )
    return result


def recorded_outputs(model: MotionModel, recording: Recording) -> tuple[str, ...]:
    """Outputs of the model that the recording holds."""
    return tuple(name for name in model.outputs if recording.has(name))


def recorded_as(model: MotionModel, recordings: Sequence[Recording]) -> dict[str, str]:
    """Of inputs that any of several signals may be, the one that recordings hold.

    Raises `BadInput` where recordings hold different ones: parameters cannot be per newton and per ampere.
    """
    result: dict[str, str] = {}
    for name in model.aliases:
        held = {text: recording.name for recording in reversed(recordings) if (text := _signal(model, recording, name))}
        if len(held) > 1:
            known = ", ".join(f"{signal} in {recording}" for signal, recording in held.items())
            raise BadInput(f"{name} is {known}: keep one of them in the column maps, or fit the recordings one by one.")
        if held:
            (result[name],) = held
    return result


def _signal(model: MotionModel, recording: Recording, name: str) -> str:
    """The signal of a recording that is the input; empty if there is none."""
    return next((signal for signal in model.aliases.get(name, (name,)) if signal in recording), "")


def _input(model: MotionModel, recording: Recording, name: str) -> Array:
    if signal := _signal(model, recording, name):
        return recording[signal]
    if name in model.defaults:
        return np.full(len(recording), model.defaults[name])
    one = model.aliases.get(name, (name,))
    recording.require(one[:1], f"model {model.name} (any of {', '.join(one)})" if len(one) > 1 else model.name)
    raise AssertionError


def _stretches(good: Mask) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], good, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
