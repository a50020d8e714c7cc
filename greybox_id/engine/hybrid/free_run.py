"""A hybrid model running freely on a recording's inputs."""

from __future__ import annotations

import casadi as cs
import numpy as np

from ...hybrid_model import HybridModel
from ...parameter import Array
from ...recording import Recording
from .cell import Cell
from .stretches import stretches

_BLOCK = 100
"""Rows that one call simulates."""


def free_run(model: HybridModel, recording: Recording) -> dict[str, Array]:
    """Outputs and estimates by name, (n,) each, from the first row of every stretch to its end; NaN between them.

    Each stretch starts from its first readings. Where a slip is too small to tell a stiffness, that is NaN.

    Raises
    ------
    BadInput : an input is missing, or the sample time is not the model's.
    """
    cell = Cell(model)
    block = cell.sample(1, cell.reported).mapaccum("free_run", _BLOCK)
    p = cs.repmat(cs.DM(model.values), 1, _BLOCK)
    found = {name: np.full(len(recording), np.nan) for name in cell.reported}
    for stretch in stretches(model, recording):
        carried = cell.start(stretch.start(0)[:, None])
        for k in range(0, len(stretch), _BLOCK):
            inputs = stretch.inputs[:, k : k + _BLOCK]
            rows = inputs.shape[1]
            held = np.pad(inputs, ((0, 0), (0, _BLOCK - rows)), mode="edge")  # the last block is simulated on and cut
            after, told = block(carried, held, p)
            carried, first = np.array(after)[:, -1:], stretch.rows.start + k
            for name, values in zip(cell.reported, np.array(told), strict=True):
                found[name][first : first + rows] = values[:rows]
    for name, (of, least) in model.untold.items():
        with np.errstate(invalid="ignore"):
            found[name][~(np.abs(found[of]) >= least)] = np.nan
    return found
