"""Models along recordings, by the stages they are driven in: a row ahead, and over horizons from many rows.

What the readings do not say (actuators, tyres that follow with a lag, the steps a network has seen) is where the model
brings it on the rows before, while readings of the motion take the place of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.models.motion_model import MotionModel

from ..racing.stage import BEND, PLANE, stage
from .windows import resampled

HORIZONS = (0.1, 0.5, 2.0)
"""s, as the gap's (`scores.horizons`)."""
RUN_IN = 0.5
"""s of readings before predictions begin: ten time constants of a servo."""


@dataclass(frozen=True)
class Ahead:
    """Predictions of a horizon, from many rows.

    Attributes
    ----------
    rows : (n,) the rows that were predicted.
    predicted, measured : (n, 3) v_x, v_y [m/s] and yaw rate [rad/s]; NaN where not measured.
    """

    rows: NDArray[np.intp]
    predicted: Array
    measured: Array

    def rms(self) -> dict[str, float]:
        """Root mean square error by signal; infinite where a prediction went beyond all numbers."""
        error = self.predicted - self.measured
        there = np.isfinite(self.measured)
        error = np.where(np.isfinite(self.predicted), error, np.inf)
        return {
            name: float(np.sqrt(np.mean(error[there[:, k], k] ** 2)))
            for k, name in enumerate(PLANE)
            if np.any(there[:, k])
        }


class OpenLoop:
    """A model laid along a recording.

    Parameters
    ----------
    model : of motion; `InjectedModel` too.
    recording : with steer, the drive's command, v_x, yaw rate, and v_y if it was read.
    sample_time : s, at which the model steps; None: the recording's. It is resampled where it is another.

    Attributes
    ----------
    recording : at that sample time.
    foretold : (n, 3) v_x, v_y and yaw rate that the row before foretells; NaN in the first row of a run.

    Raises
    ------
    BadInput : a signal is missing, every run is shorter than what a model has to have seen, or a network that acts in
        the model steps by another time.
    """

    def __init__(self, model: MotionModel, recording: Recording, sample_time: float | None = None) -> None:
        recording.must_run()
        step = round(recording.sample_time, 9) if sample_time is None else sample_time
        self.recording = resampled(recording, step)
        self._stage = value = stage(model, step)
        known = [value.drive, *model.aliases.get(value.drive, ())]
        drive = next((name for name in known if name in recording), known[-1])
        recording.require(("steer", drive, "v_x", "yaw_rate"), model.name)
        self._p, self._plane = value.equations.values, [value.states.index(name) for name in PLANE]
        commands = np.stack([self.recording["steer" if name == "steer" else drive] for name in value.inputs], axis=1)
        self._late = value.begun(1.0, self._p)[1] / step
        self._acting = np.concatenate([self._delayed(commands[a:b]) for a, b in self.recording.runs])
        nothing = np.full(len(commands), np.nan)
        read = [self.recording[name] if name in recording else nothing for name in PLANE]
        self._read = np.stack(read, axis=1)
        self._step, self._needed = step, max(round(RUN_IN / step), value.memory)
        self._z = np.zeros((len(commands), value.size + 3))
        self.foretold = np.full((len(commands), len(PLANE)), np.nan)
        for a, b in self.recording.runs:
            self._observe(a, b)

    def ahead(self, horizon: float, every: float = 0.1) -> Ahead:
        """Predictions of a horizon from every so many seconds.

        Raises
        ------
        BadInput : every run is shorter than the horizon and what has to be seen before it.
        """
        return self.horizons((horizon,), every)[horizon]

    def horizons(self, horizons: Sequence[float] = HORIZONS, every: float = 0.1) -> dict[float, Ahead]:
        """Predictions of several horizons, from the same rows; see `ahead`."""
        steps = {horizon: max(1, round(horizon / self._step)) for horizon in horizons}
        last, apart = max(steps.values()), max(1, round(every / self._step))
        starts = np.concatenate([np.arange(a + self._needed, b - last, apart) for a, b in self.recording.runs])
        if not len(starts):
            raise BadInput(
                f"{self.recording.name}: predictions of {max(horizons):g} s need {self._needed} rows before them, and "
                f"no unbroken run is {self._needed + last + 1} rows long."
            )
        z, result = self._z[starts], {}
        with np.errstate(all="ignore"):  # models that go astray are told as such
            for k in range(last):
                z = self._moved(z, starts + k)
                for horizon, count in steps.items():
                    if count == k + 1:
                        rows = starts + count
                        result[horizon] = Ahead(rows, z[:, self._plane], self._read[rows])
        return result

    def _observe(self, a: int, b: int) -> None:
        """States at every row of a run, with what was read in place of the model's own motion."""
        value = self._stage
        first = np.nan_to_num(self._read[a])
        z = np.zeros(value.size + 3)
        z[: value.size] = value.begun(float(first[0]), self._p)[0]
        x = np.zeros(value.motion)
        x[self._plane] = first
        z[: value.motion] = np.array(value.equations.settled(x, self._acting[a], self._p)).ravel()
        for k in range(a, b):
            read = np.isfinite(self._read[k])
            if k > a:
                z = self._moved(z[None], np.array([k - 1]))[0]
                self.foretold[k] = z[self._plane]
                if not np.all(np.isfinite(z)):
                    raise BadInput(
                        f"{self.recording.name}: the model leaves the range of numbers within a step at "
                        f"{self.recording.time[k]:g} s. Look at its parameters and at the readings there."
                    )
            z[np.array(self._plane)[read]] = self._read[k, read]
            z[-3:] = 0.0
            self._z[k] = z

    def _moved(self, z: Array, rows: NDArray[np.intp]) -> Array:
        """z a step later, of lanes that stand at rows, straight on."""
        p = np.broadcast_to(self._p, (len(z), len(self._p)))
        return self._stage.advance(z, self._acting[rows], np.zeros((len(z), len(BEND))), p)

    def _delayed(self, commands: Array) -> Array:
        """(n, inputs) what acts at the rows of a run; before it, the first commands."""
        whole = np.floor(self._late + 1e-9).astype(int)
        share, rows = self._late - whole, np.arange(len(commands))[:, None]
        early, later = (np.take_along_axis(commands, np.maximum(rows - whole - k, 0), axis=0) for k in (0, 1))
        acting: Array = (1.0 - share) * early + share * later
        return acting


def errors_ahead(
    model: MotionModel, recordings: Sequence[Recording], horizons: Sequence[float] = HORIZONS
) -> dict[float, dict[str, float]]:
    """Root mean square errors of a model over horizons, by signal, of all recordings together.

    Parameters
    ----------
    model : see `OpenLoop`.
    recordings : that were not trained on.
    horizons : s.

    Returns
    -------
    Horizon -> signal -> error, SI units; infinite where a prediction went beyond all numbers.

    Examples
    --------
    >>> import greybox_id as gb
    >>> from greybox_lab.driving.learned.open_loop import errors_ahead
    >>> lap = gb.read(gb.datasets.shipped("racer_valid"), columns="roboracer").rows(0, 200)
    >>> sorted(errors_ahead(gb.models.single_track(vehicle="roboracer"), [lap], [0.5])[0.5])
    ['v_x', 'yaw_rate']
    """
    result = [OpenLoop(model, recording).horizons(horizons) for recording in recordings]
    joined = {
        h: Ahead(*(np.concatenate([getattr(item[h], part) for item in result]) for part in Ahead.__dataclass_fields__))
        for h in horizons
    }
    return {horizon: item.rms() for horizon, item in joined.items()}
