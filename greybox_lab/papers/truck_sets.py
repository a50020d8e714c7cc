"""The truck's recordings as networks are trained on them: split as published, by recording, by speed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from greybox_id.datasets.recording import Recording
from greybox_id.models.motion_model import MotionModel

from .truck_grey_boxes import fitted
from .truck_inputs import Chunks, by_speed, causal, raw, splits
from .truck_models import CAUSAL_ANGLE, truck, with_held_angle
from .truck_networks import fitted_bicycle

HORIZONS, SIZES = (0.05, 0.5, 1.0), (8, 16, 24)
WHOLE = 10.0
"""s: windows as long as what is scored."""
SHARES = (0.1, 0.25, 0.5, 1.0)
"""Of the training recordings, for learning curves."""
TAUGHT_ON = (0.1, 1.0)
"""Shares on which several lessons before training are compared."""
SLOW, FAST = 60 / 3.6, 70 / 3.6
"""m/s: trajectories that stay below the one are trained on, those with a mean above the other scored, out of range."""
AS_PUBLISHED, BY_RECORDING, BY_SPEED = "as published", "by recording", "by speed"
ANGLE_HELD = "angle held"
"""Split as published; the angle is what the best causal grey box, fitted to train, makes of alpha1 and its past."""


def of_share(share: float) -> str:
    """What trainings on a share of the training recordings are called."""
    return AS_PUBLISHED if share == 1.0 else f"{share:g}"


class TruckSets:
    """The recordings that networks are trained on and scored by, as recorded.

    Parameters
    ----------
    data : folder of the files.
    """

    def __init__(self, data: Path) -> None:
        self._data = data
        self.chunks = cache(self._chunks)
        self.bicycle = cache(self._bicycle)

    def recordings(self, name: str) -> dict[str, Recording]:
        """Split -> recording."""
        return {split: chunk.recording for split, chunk in self.chunks(name).items()}

    def _chunks(self, name: str) -> dict[str, Chunks]:
        """Of "as published", "by recording", "by speed", "angle held" or a share of the training recordings, 0.1."""
        if name in (AS_PUBLISHED, BY_RECORDING):
            return splits(self._data, raw, name == BY_RECORDING)
        if name == ANGLE_HELD:
            held = splits(self._data, causal, by_recording=False)
            problem, solution = fitted(truck(*CAUSAL_ANGLE), held["train"].recording)
            model = problem.plain.model.with_values(problem.plain.shared(solution.x))
            return {s: replace(item, recording=with_held_angle(item.recording, model)) for s, item in held.items()}
        result = self.chunks(AS_PUBLISHED)
        if name == BY_SPEED:
            return by_speed(result, SLOW, FAST)
        train = result["train"]
        order = np.random.default_rng(77).permutation(np.unique(train.piece_of))
        some = order[: max(2, round(float(name) * len(order)))]
        return {"train": train.of(np.isin(train.piece_of, some), f"{name} of train"), "val": result["val"]}

    def _bicycle(self, name: str) -> MotionModel:
        return fitted_bicycle(self.chunks(name)["train"].recording)
