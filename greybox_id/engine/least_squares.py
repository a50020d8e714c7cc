"""Least-squares problems: places of parameters among the unknowns, priors as rows, and the interface for solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..base.shorthands import Array, Index
from ..models.model import Model
from ..models.parameter import Parameter, placed


def prior_rows(
    parameters: Sequence[Parameter], strengths: Mapping[str, float] | None = None
) -> tuple[sp.csr_matrix, Array]:
    """Rows R and offsets r such that the priors' residuals are R p - r, in standard deviations.

    Parameters
    ----------
    parameters : in the order of the parameter vector p.
    strengths : name of a prior's strength -> factor by which its standard deviations are divided.

    Returns
    -------
    (rows, parameters) sparse matrix, (rows,) offsets.
    """
    blocks, size = [], 0
    for parameter, place in placed(parameters):
        size = place.stop
        blocks += [(place.start + index, *row) for index, *row in _rows(parameter, strengths)]
    return _joined(blocks, size)


Rows = tuple[Index, Array, Array]
"""Prior rows with equally many terms: unknowns of each row (rows, terms), their coefficients, offsets (rows,)."""


def _joined(blocks: Sequence[Rows], size: int) -> tuple[sp.csr_matrix, Array]:
    """Blocks of rows as one sparse matrix, and its offsets."""
    if not blocks:
        return sp.csr_matrix((0, size)), np.empty(0)
    offsets = np.concatenate([np.empty(0), *(r for _, _, r in blocks)])
    terms = np.concatenate([np.empty(0, np.intp), *(np.full(len(i), i.shape[1]) for i, _, _ in blocks)])
    columns = np.concatenate([np.empty(0, np.intp), *(i.ravel() for i, _, _ in blocks)])
    values = np.concatenate([np.empty(0), *(c.ravel() for _, c, _ in blocks)])
    return sp.csr_matrix((values, (np.repeat(np.arange(len(terms)), terms), columns)), (len(terms), size)), offsets


def _rows(parameter: Parameter, strengths: Mapping[str, float] | None) -> list[Rows]:
    """Rows of one parameter's prior; unknowns are numbered within the parameter."""
    prior = parameter.prior
    if prior is None:
        return []
    index = np.arange(parameter.size).reshape(parameter.shape)
    strength = (strengths or {}).get(prior.strength, 1.0)
    mean = np.broadcast_to(parameter.array if prior.mean is None else np.asarray(prior.mean, float), parameter.shape)
    weight = strength / np.broadcast_to(np.asarray(prior.sd, float), parameter.shape).reshape(-1, 1)
    stated = weight[:, 0] > 0.0
    rows = [(index.reshape(-1, 1)[stated], weight[stated], (mean.reshape(-1, 1) * weight)[stated, 0])]
    for axis, sd in enumerate(prior.step_sd):
        if sd is None or parameter.shape[axis] < 2:
            continue
        before = np.take(index, range(parameter.shape[axis] - 1), axis).reshape(-1, 1)
        after = np.take(index, range(1, parameter.shape[axis]), axis).reshape(-1, 1)
        steps = np.diff(mean, axis=axis)
        weight = strength / np.broadcast_to(np.asarray(sd, float), steps.shape).reshape(-1, 1)
        rows.append((np.hstack([before, after]), np.hstack([-weight, weight]), steps.ravel() * weight[:, 0]))
    return rows


@dataclass(frozen=True)
class Layout:
    """Places of model parameters among the unknowns.

    Run-scoped parameters have one place per run, which a run and its mirror image share.

    Attributes
    ----------
    index : per run, (parameters,) index of each model parameter in the vector of unknowns.
    size : number of unknowns.
    """

    index: tuple[NDArray[np.intp], ...]
    size: int


@dataclass(frozen=True)
class NormalEquations:
    """A quadratic model of the objective around a point, nodes eliminated.

    Attributes
    ----------
    H : (unknowns, unknowns) Gauss-Newton Hessian, priors included.
    g : (unknowns,) gradient of the objective.
    frozen_gradient : (unknowns, their simulation) -> J'r with the residuals r at those unknowns and J of this point,
        for second-order corrections of steps; None if the problem does not offer it.
    """

    H: Array
    g: Array
    frozen_gradient: Callable[[Array, Any], Array] | None = None


def lay_out(model: Model, count: int, copies: int) -> Layout:
    """Layout for `count` runs; the runs beyond `copies` are mirror images of the first ones."""
    if count == 1:
        return Layout((np.arange(model.size),), model.size)
    size, columns = 0, []
    for parameter in model.parameters:
        if parameter.scope == "run":
            places = size + np.arange(parameter.size * copies).reshape(copies, parameter.size)
            block = np.tile(places, (count // copies, 1))
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
    for parameter, place in placed(model.parameters):
        for index in layout.index:
            places = index[place]
            low[places], high[places], free[places] = *parameter.bounds, not parameter.fixed
    return (low, high), free


def prior_system(
    model: Model, layout: Layout, copies: int, strengths: Mapping[str, float] | None
) -> tuple[sp.csr_matrix, Array]:
    """Prior rows over all unknowns: model-scoped parameters once, run-scoped ones once per run."""
    blocks = []
    for parameter, place in placed(model.parameters):
        rows = _rows(parameter, strengths)
        for index in layout.index[: copies if parameter.scope == "run" else 1]:
            blocks += [(index[place][entries], c, r) for entries, c, r in rows]
    return _joined(blocks, layout.size)


Matched = Any
"""A problem's simulation at a point, which evaluation and linearisation there take as an argument."""


class LeastSquares(Protocol):
    """A nonlinear least-squares problem in parameters, with the model's simulation eliminated.

    Attributes
    ----------
    layout : places of the unknowns of each piece (run or interval).
    bounds : (unknowns,) lowest and highest values.
    free : (unknowns,) whether an unknown is estimated.
    R, r : priors, residuals R x - r in standard deviations.
    copies : number of pieces that are not mirror images.
    """

    layout: Layout
    bounds: tuple[Array, Array]
    free: NDArray[Any]
    R: sp.csr_matrix
    r: Array
    copies: int

    @property
    def start(self) -> Array:
        """Unknowns to start from."""

    def simulated_nodes(self, x: Array) -> Matched:
        """The simulation at x."""

    def objective(self, x: Array, nodes: Matched) -> float:
        """Half the sum of squared residuals, priors included; infinite where the model is not finite."""

    def normal_equations(self, x: Array, nodes: Matched) -> NormalEquations:
        """Linearise all residuals at a simulated point."""

    def residuals(self, x: Array, nodes: Matched) -> Iterator[tuple[Array, Array]]:
        """Per piece, residuals (rows, outputs) and their derivative (rows, outputs, unknowns of the piece)."""
