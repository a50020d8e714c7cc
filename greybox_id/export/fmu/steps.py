"""How long inner steps of a unit may be: the slower a vehicle, the stiffer its equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...engine.motion.schedule import STABLE
from ...models.smooth import SLOWEST
from ..equations import Equations

LONGEST = 0.01
"""Longest inner step unless somebody says otherwise, s: that of recordings at 100 Hz."""
SPEEDS = (0.0, *np.geomspace(0.005, 40.0, 60).tolist())
"""Speeds, m/s, at which the fastest eigenvalue is asked for."""


@dataclass(frozen=True)
class Steps:
    """Inner steps.

    Attributes
    ----------
    longest : the longest, s.
    stiff, by_speed : eigenvalues are at most stiff + by_speed / speed, 1/s and m/s^2.
    slowest : speed, m/s, below which they grow no more.
    """

    longest: float
    stiff: float
    by_speed: float
    slowest: float

    def stable(self, speed: float) -> float:
        """The longest stable step at a speed, s."""
        return STABLE / (self.stiff + self.by_speed / max(speed, self.slowest))


def steps_of(equations: Equations) -> Steps:
    """From the eigenvalues of the equations, driven straight: the largest falls as 1/v, and is bounded at rest."""
    model = equations.model
    count, slowest = len(model.states), SLOWEST / 2
    jacobian = equations.ode.factory("by_x", ["x", "u", "p"], ["jac:x_dot:x"])
    fastest = []
    for v in SPEEDS:
        x = np.array([v if state.name == "v_x" else 0.0 for state in equations.states])
        u = np.array([v if item.name == "v_x" else 0.0 for item in equations.inputs])
        A = np.array(jacobian(x, u, equations.values))[:count, :count]
        finite = bool(np.all(np.isfinite(A)))
        fastest.append(float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0)) if finite else 0.0)
    stiff = max(min(fastest), 1e-9)
    by_speed = max((item - stiff) * max(v, slowest) for v, item in zip(SPEEDS, fastest, strict=True))
    return Steps(LONGEST, stiff, by_speed, slowest)
