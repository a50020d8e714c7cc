"""A model laid over recordings, whichever kind of model it is: what it predicts, and what is asked of a simulation.

The equations of motion that a model is made of, or amounts to: what exports and linear systems take.
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
    """Predictions of one recording, beside its readings.

    Attributes
    ----------
    rows : (n,) rows of the recording they belong to.
    predicted, measured : (n, outputs); NaN where there is none.
    run : (n,) number, from 0, of the unbroken stretch that was predicted; missing values break one too.
    """

    rows: Index
    predicted: Array
    measured: Array
    run: Index

    def taken(self, order: Index | Mask | slice) -> Prediction:
        """Some of the rows, in that order."""
        return Prediction(self.rows[order], self.predicted[order], self.measured[order], self.run[order])

    def of(self, outputs: Sequence[int]) -> Prediction:
        """The same of some of the outputs."""
        return replace(self, predicted=self.predicted[:, outputs], measured=self.measured[:, outputs])


def breaks(rows: Index | Array, run: Index | Array) -> Index:
    """Where a row does not follow the one before it, or is of another run."""
    return np.flatnonzero((np.diff(rows) != 1) | (np.diff(run) != 0)) + 1


Diagnosed = MotionModel | MemoryModel
"""A model that can be simulated so, and diagnosed."""


class SimulatedRun(Protocol):
    """An unbroken run as a simulation lays it out."""

    @property
    def time(self) -> Array:
        """(n,) s, of its rows."""

    @property
    def held(self) -> Mask:
        """(inputs,) whether an input is held between rows."""


class FreeRuns(Protocol):
    """A model laid over recordings, which simulates whole runs freely, N rows in all."""

    @property
    def model(self) -> Diagnosed:
        """With all candidates."""

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


@by_kind
def equations_of_motion(model: Model, text: str = "") -> MotionModel:
    """The model as equations of motion; a network without a memory is part of them, its weights are constants.

    Parameters
    ----------
    model : at its values.
    text : what takes equations of motion only, as the end of a sentence.

    Raises
    ------
    BadInput : it is nothing of the kind.
    """
    raise BadInput(f"{model.name} is no model of motion{text}.")


@equations_of_motion.register(MotionModel)
def _itself(model: MotionModel, text: str = "") -> MotionModel:
    return model
