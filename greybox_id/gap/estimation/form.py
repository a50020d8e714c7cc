"""Prior of errors of tyre curves: a magic formula comes near a tyre's curve, and is not that curve.

Where a vehicle's file states tolerances of tyres, whole curves are taken to be known to a share of their peak, and the
slope at zero and the peak beside that: files state cornering stiffness and friction, whatever the form. B, C and E of
an axle then move together: along one coordinate the slope changes, along two others only the shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np

from ...base.shorthands import Array
from .axes import Axis
from .calibration import CAL


def curve_priors(axes: Sequence[Axis], scale: float = 1.0) -> tuple[tuple[Axis, ...], Array]:
    """Nuisances with the priors of tyre curves on B, C, E and D, and how parameters depend on their coordinates.

    Parameters
    ----------
    axes : nuisances; an axle of which B, C and E are all among them has an inexact curve.
    scale : errors of curves over their usual size.

    Returns
    -------
    axes : the same; those of B, C and E are now slope and shape, in standard deviations from the mean.
    mix : (axes, axes) derivative of the parameters' coordinates by those of the axes.
    """
    places = {axis.name: k for k, axis in enumerate(axes)}
    result, mix = [axis.relatively() for axis in axes], np.eye(len(axes))
    for axle in "fr":
        names = [f"{letter}_{axle}" for letter in "BCE"]
        if not all(name in places for name in names):
            continue
        at = [places[name] for name in names]
        B, C, E = (axes[k].mean for k in at)
        stated = np.diag([axes[k].sd ** 2 for k in at])
        mix[np.ix_(at, at)] = _slope_and_shape(stated + _of_curve(B, C, E, scale), np.array([1 / B, 1 / C, 0.0]))
        for k in at:
            result[k] = replace(axes[k], sd=1.0, scale=1.0, low=-inf, high=inf)
        if (peak := places.get(f"D_{axle}")) is not None:
            off = float(np.hypot(axes[peak].sd, scale * CAL.peak_off * axes[peak].mean))
            result[peak] = replace(axes[peak], sd=off).relatively()
    return tuple(result), mix


def _slope_and_shape(covariance: Array, slope: Array) -> Array:
    """(3, 3) root of a covariance: its first column moves with the slope, the others leave the slope alone."""
    along = covariance @ slope / np.sqrt(slope @ covariance @ slope)
    sizes, ways = np.linalg.eigh(covariance - np.outer(along, along))
    return np.column_stack([along, ways[:, 1:] * np.sqrt(sizes[1:])])


def _of_curve(B: float, C: float, E: float, scale: float) -> Array:
    """(3, 3) covariance of B, C and E under which curves differ by `CAL.curve_off`."""
    J = _sensitivities(B, C, E)
    free = np.array(CAL.loose) * (B, C, 1.0)
    slope = np.array([1 / B, 1 / C, 0.0])
    known = len(free) * (J.T @ J) / len(J) / (scale * CAL.curve_off) ** 2  # the error is shared by as many directions
    return np.asarray(
        np.linalg.inv(known + np.outer(slope, slope) / (scale * CAL.slope_off) ** 2 + np.diag(free**-2.0))
    )


def _sensitivities(B: float, C: float, E: float) -> Array:
    """(points, 3) of the curve over the slip angle by B, C and E, by central differences."""
    at = np.array([B, C, E])
    shares = np.linspace(0, 1, CAL.curve_points + 1)[1:]
    alphas = np.pi / (B * max(C - 1.0, 0.2)) * shares  # beyond the peak
    alphas = CAL.curve_reach * alphas[int(np.argmax(_curve(at, alphas)))] * shares
    steps = 1e-4 * np.diag([B, C, 1.0])
    return np.stack([(_curve(at + h, alphas) - _curve(at - h, alphas)) / (2 * np.sum(h)) for h in steps], axis=1)


def _curve(at: Array, alphas: Array) -> Array:
    """The magic formula over its peak value."""
    B, C, E = at
    slip = B * alphas
    return np.asarray(np.sin(C * np.arctan(slip - E * (slip - np.arctan(slip)))))
