"""Interfaces between models of any kind and recordings: predictions, simulations of whole runs, equations of motion.

Exports and linear systems need the equations of motion that a model consists of, or is equivalent to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array, Index, Mask
from ..models.memory_model import MemoryModel
from ..models.model import Model, by_kind
from ..models.motion_model import MotionModel


@dataclass(frozen=True)
class Prediction:
    """Predictions of one recording, with its readings.

    Attributes
    ----------
    rows : (n,) their rows in the recording.
    predicted, measured : (n, outputs); NaN where missing.
    run : (n,) number, from 0, of the unbroken stretch that was predicted; missing values break one too.
    """

    rows: Index
    predicted: Array
    measured: Array
    run: Index

    def taken(self, order: Index | Mask | slice) -> Prediction:
        """The given rows, in that order."""
        return Prediction(self.rows[order], self.predicted[order], self.measured[order], self.run[order])

    def of(self, outputs: Sequence[int]) -> Prediction:
        """The given outputs."""
        return replace(self, predicted=self.predicted[:, outputs], measured=self.measured[:, outputs])


def breaks(rows: Index | Array, run: Index | Array) -> Index:
    """Places where a row does not follow the previous one, or belongs to another run."""
    return np.flatnonzero((np.diff(rows) != 1) | (np.diff(run) != 0)) + 1


Diagnosed = MotionModel | MemoryModel
"""Models that can be simulated as `FreeRuns`, and diagnosed."""


class SimulatedRun(Protocol):
    """An unbroken run in a simulation."""

    @property
    def time(self) -> Array:
        """(n,) times of its rows, s."""

    @property
    def held(self) -> Mask:
        """(inputs,) whether an input is constant between rows (zero-order hold)."""


class FreeRuns(Protocol):
    """A model with recordings whose whole runs it simulates freely, N rows in all."""

    @property
    def model(self) -> Diagnosed:
        """The model with all candidates."""

    @property
    def runs(self) -> Sequence[SimulatedRun]:
        """The recordings' unbroken runs."""

    @property
    def rows(self) -> Sequence[slice]:
        """Slices of the N rows, per run."""

    @property
    def measured(self) -> Array:
        """(N, outputs) readings, NaN where there is none."""

    @property
    def counted(self) -> Mask:
        """(N, outputs) readings that exist and have a weight."""

    @property
    def time(self) -> Array:
        """(N,) times of the rows, s."""

    @property
    def inputs(self) -> Array:
        """(N, inputs) recorded inputs."""

    @property
    def learnt(self) -> bool:
        """Whether a network replaces the equations: its training error is then its noise, and it knows only rows."""

    @property
    def loose(self) -> tuple[int, ...]:
        """States whose initial values are measured, with noise."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Outputs, in order."""

    @property
    def sample_time(self) -> float:
        """Usual sample time, s."""

    def simulate(self, P: Array) -> Array:
        """(K, N, outputs) predicted readings for each of (K, parameters) vectors."""

    def linearise(self, p: Array, columns: Sequence[int]) -> tuple[Array, Array, Array]:
        """Simulation (N, outputs), its derivatives by some parameters (N, outputs, columns), and by initial states."""


@by_kind
def equations_of_motion(model: Model, text: str = "") -> MotionModel:
    """The model as equations of motion; a network without memory is part of them, with constant weights.

    Parameters
    ----------
    model : the model, at its values.
    text : what requires equations of motion, as the end of a sentence.

    Raises
    ------
    BadInput : the model has none.
    """
    raise BadInput(f"{model.name} is no model of motion{text}.")


@equations_of_motion.register(MotionModel)
def _itself(model: MotionModel, text: str = "") -> MotionModel:
    return model
