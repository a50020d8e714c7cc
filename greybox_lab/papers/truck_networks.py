"""The truck's networks: from measurements alone, beside a bicycle, and after a bicycle.

Protocol of the publication (Table III): v_x and alpha1 as recorded at 0.05 s, forward Euler, loss over windows of 1, 10
or 20 steps; of the weights along the way those are kept that are best on the held-out trajectories. What differs: the
held-out error is that of the whole 10 s; horizons grow; L-BFGS in place of Adam; inputs in units of their spread.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.base.version import __version__
from greybox_id.datasets.recording import Recording
from greybox_id.engine.hybrid.cell import free_run
from greybox_id.engine.hybrid.problem import WindowErrors
from greybox_id.engine.hybrid.stretches import stretches
from greybox_id.fitting.how import FitOptions, Say
from greybox_id.fitting.hybrid import counted, trained_from
from greybox_id.fitting.pretraining import Pretraining, known_physics
from greybox_id.models.hybrid_model import HybridModel
from greybox_id.models.model import must_be
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.registry import prepared

from .truck_grey_boxes import fitted
from .truck_models import LEVER_ARM, truck

METHODS = ("learning", "discrepancy", "transfer")
"""Measurements alone; what a bicycle is off by; first a bicycle's rates, then measurements."""
NAMES = {"learning": "mlp_lateral", "discrepancy": "bicycle_mlp", "transfer": "mlp_lateral"}
WORDS = {"learning": "MLP", "discrepancy": "bicycle and MLP", "transfer": "MLP, transfer learning"}
ROWS = 200
"""Of a trajectory: 10 s."""
PASSENGER_CAR = {
    "I_z": 1.6 * 18781.0, "l_f": 1.3, "l_r": 1.4, "B_f": 10.0, "D_f": 0.95, "B_r": 11.0, "D_r": 1.0,
    "velocity_lever_arm": 0.0,
}  # fmt: skip
"""A middle-sized car of the truck's mass, which v_y and yaw rate do not tell: radius of gyration 1.26 m."""


def fitted_bicycle(train: Recording) -> MotionModel:
    """The bicycle with the signs put right, fitted to the training trajectories."""
    problem, solution = fitted(truck(LEVER_ARM), train)
    return problem.plain.model.with_values(problem.plain.shared(solution.x))


def _halved(bicycle: MotionModel) -> MotionModel:
    return bicycle.with_parameters(*(bicycle[n].with_value(bicycle[n].array / 2) for n in ("B_f", "B_r")))


def _of_a_car(bicycle: MotionModel) -> MotionModel:
    return bicycle.with_parameters(*(bicycle[name].with_value(value) for name, value in PASSENGER_CAR.items()))


BICYCLE = "the fitted bicycle"
LESSONS: Mapping[str, tuple[Callable[[MotionModel], MotionModel], Any]] = {
    BICYCLE: (lambda bicycle: bicycle, "box"),
    "the same, on the recordings' rows": (lambda bicycle: bicycle, "data"),
    "tyres half as stiff": (_halved, "box"),
    "a passenger car": (_of_a_car, "box"),
}
"""What a network learns before it sees a recording -> of the fitted bicycle; where the points lie."""
FASTER = "the fitted bicycle, driven faster too"
"""The same, which goes on teaching what happens at higher speeds than recorded."""
BEYOND = 1.5
"""How much higher: chosen on a simulated truck, see docs/results_recordings.md."""


def lesson(name: str, bicycle: MotionModel) -> Pretraining:
    """What a network learns first."""
    changed, span = LESSONS[BICYCLE if name == FASTER else name]
    model = changed(bicycle)
    return Pretraining(model, model.values[None], span=span, source=name, beyond=BEYOND if name == FASTER else 1.0)


@dataclass(frozen=True)
class NetworkCell:
    """A training, but for its seed.

    Attributes
    ----------
    data : name of the recordings it is trained on.
    method : one of `METHODS`.
    units : of each of the four hidden layers.
    horizon : s predicted from one start at the end of training.
    taught : of transfer, one of `LESSONS`; FASTER of it or of discrepancy.
    """

    data: str
    method: str
    units: int
    horizon: float
    taught: str = BICYCLE

    @property
    def name(self) -> str:
        """For people."""
        value = "" if self.taught == BICYCLE else f" after {self.taught}"
        return f"{WORDS[self.method]}{value}, 4 x {self.units}, {self.horizon:g} s"


@dataclass(frozen=True)
class NetworkTraining:
    """Trainings of one network from several seeds.

    Attributes
    ----------
    cell : what was trained.
    errors : split -> (seeds, trajectories, rows, outputs) of free runs, predicted less read.
    parameters : weights.
    cpu_seconds : of one training, mean.
    """

    cell: NetworkCell
    errors: Mapping[str, Array]
    parameters: int
    cpu_seconds: float

    @property
    def seeds(self) -> int:
        """How many trainings."""
        return len(next(iter(self.errors.values())))

    @cached_property
    def runs(self) -> dict[str, Array]:
        """Split -> (seeds, trajectories, outputs) RMSE of free runs."""
        return {split: np.sqrt(np.mean(error**2, axis=2)) for split, error in self.errors.items()}

    @cached_property
    def together(self) -> dict[str, Array]:
        """Split -> (trajectories, outputs) RMSE of the mean of all seeds' free runs."""
        return {split: np.sqrt(np.mean(np.mean(error, axis=0) ** 2, axis=1)) for split, error in self.errors.items()}


def along(errors: Array) -> Array:
    """(trajectories, rows, outputs) -> (rows, outputs) RMSE over all trajectories up to a row."""
    squares = np.cumsum(np.mean(errors**2, axis=0), axis=0)
    return np.asarray(np.sqrt(squares / (1 + np.arange(len(squares)))[:, None]))


def trained(cell: NetworkCell, recordings: Mapping[str, Recording], bicycle: MotionModel, seed: int, say: Say) -> Any:
    """Train on "train" and stop by "val"; no other recording is looked at.

    Returns
    -------
    Plain data: `x`, the parameters, and `cpu_seconds`.

    Raises
    ------
    KeyboardInterrupt : Ctrl-C; half a training is none.
    """
    clock = time.process_time()
    train, val = recordings["train"], recordings["val"]
    model = _model(cell, train, bicycle)
    laid, held_out = stretches(model, train), stretches(model, val)
    sd = counted(model, laid, FitOptions())
    whole = replace(model, window=min(ROWS, *(len(item) for item in held_out)), warm_up=0)
    known = lesson(cell.taught, bicycle) if cell.method == "transfer" or cell.taught == FASTER else None
    result = trained_from(model, [train], laid, sd, WindowErrors(whole, held_out, sd), seed, say, known)
    if result.status == "interrupted":
        raise KeyboardInterrupt
    return {"x": result.x.tolist(), "cpu_seconds": time.process_time() - clock}


def about(cell: NetworkCell, recordings: Mapping[str, Recording], seed: int) -> dict[str, Any]:
    """What tells a training from others: model, size, windows, seed, hashes of what it is trained on, version."""
    known = {"method": cell.method}
    if cell.method == "transfer" or cell.taught == FASTER:
        known |= {"taught": cell.taught}
    return {
        **known, "units": cell.units, "horizon": cell.horizon, "seed": seed, "version": __version__,
        **{split: hashed(recordings[split]) for split in ("train", "val")},
    }  # fmt: skip


def scored(
    cell: NetworkCell, recordings: Mapping[str, Recording], bicycle: MotionModel, result: Sequence[Mapping[str, Any]]
) -> NetworkTraining:
    """Free runs of trainings of a cell on every recording there is."""
    model = _model(cell, recordings["train"], bicycle)
    vectors = [np.array(item["x"], dtype=float) for item in result]
    errors = {split: _errors(model, vectors, recording) for split, recording in recordings.items()}
    weights = sum(int(np.prod(shape)) for shape in model.network.shapes.values())
    return NetworkTraining(cell, errors, weights, float(np.mean([item["cpu_seconds"] for item in result])))


def _model(cell: NetworkCell, train: Recording, bicycle: MotionModel) -> HybridModel:
    window = min(round(cell.horizon / train.sample_time) + 1, ROWS)
    settings = {"hidden": [cell.units] * 4, "window": window, "integrator": "euler", "symmetric": False}
    model = must_be(HybridModel, prepared(NAMES[cell.method], train, settings))
    return known_physics(model, lesson(BICYCLE, bicycle)) if cell.method == "discrepancy" else model


def _errors(model: HybridModel, result: Sequence[Array], recording: Recording) -> Array:
    """(seeds, trajectories, rows, outputs) of free runs, cut to the rows that all trajectories have."""
    laid = stretches(model, recording)
    rows = min(len(item) for item in laid)
    every = []
    for p in result:
        known = free_run(model.with_values(p), recording)
        every.append(
            [
                np.column_stack([known[n][item.rows] - item.outputs[k] for k, n in enumerate(model.outputs)])[:rows]
                for item in laid
            ]
        )
    return np.array(every)


def hashed(recording: Recording) -> str:
    """Of what networks read of a recording."""
    result = hashlib.sha256(repr(recording.runs).encode())
    for name in ("v_y", "yaw_rate", "v_x", "steer"):
        result.update(np.ascontiguousarray(recording[name], dtype=float).tobytes())
    return result.hexdigest()
