"""What a diagnosis asks of a model and of its bench, whichever kind of model it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..memory_model import MemoryModel
from ..motion_model import MotionModel
from ..shorthands import Array
from .calibration import CAL

Diagnosed = MotionModel | MemoryModel
"""A model that can be diagnosed."""


class AnyRun(Protocol):
    """An unbroken run as a bench lays it out."""

    @property
    def time(self) -> Array:
        """(n,) s, of its rows."""

    @property
    def held(self) -> NDArray[np.bool_]:
        """(inputs,) whether an input is held between rows."""


class AnyBench(Protocol):
    """Simulates whole runs freely, N rows in all."""

    @property
    def model(self) -> Diagnosed:
        """With all candidates."""

    @property
    def runs(self) -> Sequence[AnyRun]:
        """The recordings' unbroken runs."""

    @property
    def rows(self) -> Sequence[slice]:
        """Slices of the N rows, per run."""

    @property
    def measured(self) -> Array:
        """(N, outputs) readings, NaN where there is none."""

    @property
    def counted(self) -> NDArray[np.bool_]:
        """(N, outputs) readings that are there and count."""

    @property
    def time(self) -> Array:
        """(N,) s."""

    @property
    def inputs(self) -> Array:
        """(N, inputs)."""

    @property
    def learnt(self) -> bool:
        """Whether weights stand for the equations: what training left is its noise then, and rows are all it knows."""

    @property
    def loose(self) -> tuple[int, ...]:
        """States whose starts are read, with noise."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Outputs, in order."""

    @property
    def sample_time(self) -> float:
        """Usual step, s."""

    def simulate(self, P: Array) -> Array:
        """(K, N, outputs) readings predicted with each of (K, parameters) vectors."""

    def linearise(self, p: Array, columns: Sequence[int]) -> tuple[Array, Array, Array]:
        """A simulation (N, outputs), its derivatives by some parameters (N, outputs, columns), and by starts."""


def blocks(bench: AnyBench, seconds: float = CAL.residual_block) -> list[tuple[int, int]]:
    """Rows [a, b) of stretches over which residuals may be alike, none of them across runs."""
    length = max(1, round(seconds / bench.sample_time))
    return [(a, min(a + length, rows.stop)) for rows in bench.rows for a in range(rows.start, rows.stop, length)]
