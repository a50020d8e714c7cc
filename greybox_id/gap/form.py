"""How rough the form of a tyre curve is: a magic formula comes near a tyre's curve, and is not that curve.

Where a vehicle's file states tolerances of tyres, whole curves are taken to be known to `OFF` of their peak. What B, C
and E may do together without leaving that band is believed beyond their own tolerances. Of the peak D little is: a
curve of another form that is laid through the same points peaks a percent higher or lower.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..parameter import Array
from .axes import Axis

OFF = 0.015
"""Root mean square distance of a curve from the true one, over the peak."""
SLOPE = 0.03
"""Standard deviation of the slope B C, relative: a file states cornering stiffness, whatever the curve's form."""
PEAK = 0.012
"""Standard deviation of the peak, relative."""
REACH = 1.2
"""Up to so many times the slip of the peak."""
LOOSE = {"B": 0.3, "C": 0.1, "E": 0.5}
"""What is believed of each anyway: sd, those of B and C relative."""
POINTS = 60


def form_covariance(axes: Sequence[Axis]) -> Array:
    """(axes, axes) covariance of nuisances that the form of the tyre curves adds to their own tolerances.

    Parameters
    ----------
    axes : nuisances; an axle of which B, C and E are all among them has a curve that is rough.
    """
    places = {axis.name: k for k, axis in enumerate(axes)}
    found = np.zeros((len(axes), len(axes)))
    for axle in "fr":
        names = [f"{letter}_{axle}" for letter in "BCE"]
        if all(name in places for name in names):
            own = [places[name] for name in names]
            found[np.ix_(own, own)] = _of_curve(*(axes[k].mean for k in own))
            if (peak := places.get(f"D_{axle}")) is not None:
                found[peak, peak] = (PEAK * axes[peak].mean) ** 2
    return found


def _of_curve(B: float, C: float, E: float) -> Array:
    """(3, 3) covariance of B, C and E that leave the curve in its band."""
    J = _sensitivities(B, C, E)
    free = np.array([LOOSE["B"] * B, LOOSE["C"] * C, LOOSE["E"]])
    slope = np.array([1 / B, 1 / C, 0.0])
    told = len(free) * (J.T @ J) / len(J) / OFF**2  # the distance is shared by as many directions
    return np.asarray(np.linalg.inv(told + np.outer(slope, slope) / SLOPE**2 + np.diag(free**-2.0)))


def _sensitivities(B: float, C: float, E: float) -> Array:
    """(POINTS, 3) of the curve over the slip angle by B, C and E, by central differences."""
    at = np.array([B, C, E])
    alphas = np.linspace(0, np.pi / (B * max(C - 1.0, 0.2)), POINTS + 1)[1:]  # far enough to have the peak within
    alphas = np.linspace(0, REACH * alphas[int(np.argmax(_curve(at, alphas)))], POINTS + 1)[1:]
    steps = 1e-4 * np.diag([B, C, 1.0])
    return np.stack([(_curve(at + h, alphas) - _curve(at - h, alphas)) / (2 * np.sum(h)) for h in steps], axis=1)


def _curve(at: Array, alphas: Array) -> Array:
    """The magic formula over its peak."""
    B, C, E = at
    slip = B * alphas
    return np.asarray(np.sin(C * np.arctan(slip - E * (slip - np.arctan(slip)))))
