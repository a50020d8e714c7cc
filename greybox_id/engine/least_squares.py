"""What solvers and uncertainty ask of a least-squares problem, whatever the kind of its model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import scipy.sparse as sp
from numpy.typing import NDArray

from ..parameter import Array
from .layout import Layout, NormalEquations

Matched = Any
"""A problem's own simulation at a point: what it needs again to evaluate and linearise there."""


class LeastSquares(Protocol):
    """A nonlinear least-squares problem in parameters whose model has been simulated.

    Attributes
    ----------
    layout : where the unknowns of each piece (run or interval) stand.
    bounds : (unknowns,) lowest and highest values.
    free : (unknowns,) whether an unknown moves.
    R, r : priors, residuals R x - r in standard deviations.
    copies : pieces that are not mirror images.
    """

    layout: Layout
    bounds: tuple[Array, Array]
    free: NDArray[Any]
    R: sp.csr_matrix
    r: Array
    copies: int

    @property
    def sample_time(self) -> float:
        """Time between rows, s."""

    @property
    def start(self) -> Array:
        """Unknowns to start from."""

    def simulated_nodes(self, x: Array) -> Matched:
        """A simulation of everything at x."""

    def objective(self, x: Array, nodes: Matched) -> float:
        """Half the sum of squared residuals, priors included; infinite where the model is not finite."""

    def normal_equations(self, x: Array, nodes: Matched) -> NormalEquations:
        """Linearise everything about a simulated point."""

    def residuals(self, x: Array, nodes: Matched) -> Iterator[tuple[Array, Array]]:
        """Per piece, residuals (rows, outputs) and their derivative (rows, outputs, unknowns of the piece)."""
