"""A recording as columns to be written, under the names of the shipped column map "canonical"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...recording import Array, Recording

BETWEEN_RUNS = 1.0
"""Seconds between runs on a clock that may not step back."""


@dataclass(frozen=True)
class Columns:
    """Columns of a file to be written.

    Attributes
    ----------
    values : name -> (n,): time in s, run counted from 1, and the signals in SI units.
    units : name -> unit.
    steady : (n,) s from 0, the same steps as time within runs; it runs on where time restarts.
    """

    values: Mapping[str, NDArray[Any]]
    units: Mapping[str, str]
    steady: Array


def columns_of(recording: Recording) -> Columns:
    """All of a recording as columns."""
    runs = np.zeros(len(recording), dtype=np.int64)
    for number, (start, stop) in enumerate(recording.runs, 1):
        runs[start:stop] = number
    values = {"time": recording.time, "run": runs, **recording.signals}
    units = {"time": "s", **{name: recording.unit(name) for name in recording.signals}}
    return Columns(values, units, _steady(recording))


def _steady(recording: Recording) -> Array:
    steady, end = np.zeros(len(recording)), -BETWEEN_RUNS
    for start, stop in recording.runs:
        steady[start:stop] = recording.time[start:stop] - recording.time[start] + end + BETWEEN_RUNS
        end = steady[stop - 1]
    return steady
