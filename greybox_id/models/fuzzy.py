"""Triangular membership functions and evenly spaced centres, the fuzzy part of model-structured networks."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs

from ..errors import BadInput
from ..model import Symbol


def memberships(x: Symbol, centres: Sequence[float]) -> list[Symbol]:
    """Piecewise linear activations psi_j(x): 1 at the own centre, 0 at the neighbours', summing to 1 everywhere.

    Beyond the outermost centres the outermost activation stays 1.
    Source: Mungiello et al., Vehicle dynamics learning from physics priors, Eq. 4 and Fig. 2b.
    """
    if any(b <= a for a, b in zip(centres[:-1], centres[1:], strict=True)):
        raise BadInput(f"The centres of a membership function must increase; they are {list(centres)}.")
    last = len(centres) - 1
    rising = [cs.fmin(1, cs.fmax(0, (x - a) / (b - a))) for a, b in zip(centres[:-1], centres[1:], strict=True)]
    return [(rising[j - 1] if j > 0 else 1) - (rising[j] if j < last else 0) for j in range(last + 1)]


def evenly(low: float, high: float, count: int) -> tuple[float, ...]:
    """`count` centres evenly spaced from low to high; a single one in the middle."""
    if count == 1:
        return ((low + high) / 2,)
    return tuple(low + (high - low) * k / (count - 1) for k in range(count))
