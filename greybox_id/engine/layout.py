"""Where parameters stand among the unknowns of a least-squares problem, with their bounds and priors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..model import Model
from ..parameter import Array
from .prior_rows import prior_rows


@dataclass(frozen=True)
class Layout:
    """Where a run's model parameters stand among the unknowns.

    Run-scoped ones have a place per run; a run and its mirror image share it.
    """

    index: tuple[NDArray[np.intp], ...]
    size: int


@dataclass(frozen=True)
class NormalEquations:
    """A quadratic model of the objective about a point, nodes eliminated.

    Attributes
    ----------
    H : (unknowns, unknowns) Gauss-Newton Hessian, priors included.
    g : (unknowns,) gradient of the objective.
    pulled : simulation at another point -> J'r with the residuals r there and the derivative J of here; for steps that
        follow a bend. None where a problem does not offer it.
    """

    H: Array
    g: Array
    pulled: Callable[[Array, Any], Array] | None = None


def lay_out(model: Model, count: int, copies: int) -> Layout:
    """Where the parameters of so many runs stand; the runs beyond `copies` are mirror images of the first ones."""
    size, columns = 0, []
    for parameter in model.parameters:
        if parameter.scope == "run":
            own = size + np.arange(parameter.size * copies).reshape(copies, parameter.size)
            block = np.tile(own, (count // copies, 1))
        else:
            block = np.broadcast_to(size + np.arange(parameter.size), (count, parameter.size))
        size = int(block.max(initial=size - 1)) + 1
        columns.append(block)
    joined = np.hstack(columns) if columns else np.empty((count, 0))
    return Layout(tuple(row.astype(np.intp) for row in joined), size)


def limits(model: Model, layout: Layout) -> tuple[tuple[Array, Array], NDArray[np.bool_]]:
    """Lowest and highest values of all unknowns, and whether each is free."""
    low, high = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    free = np.ones(layout.size, dtype=bool)
    start = 0
    for parameter in model.parameters:
        for index in layout.index:
            own = index[start : start + parameter.size]
            low[own], high[own], free[own] = *parameter.bounds, not parameter.fixed
        start += parameter.size
    return (low, high), free


def beliefs(
    model: Model, layout: Layout, copies: int, strengths: Mapping[str, float] | None
) -> tuple[sp.csr_matrix, Array]:
    """Prior rows over all unknowns: model-scoped parameters once, run-scoped ones once per run."""
    blocks, offsets, start = [], [], 0
    for parameter in model.parameters:
        R, r = prior_rows([parameter], strengths)
        own = slice(start, start + parameter.size)
        start += parameter.size
        placements = layout.index[: copies if parameter.scope == "run" else 1]
        for index in placements:
            place = sp.csr_matrix(
                (np.ones(parameter.size), (np.arange(parameter.size), index[own])), shape=(parameter.size, layout.size)
            )
            blocks.append(R @ place)
            offsets.append(r)
    return sp.vstack(blocks, format="csr"), np.concatenate(offsets)
