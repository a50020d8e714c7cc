"""What is true of the tyres in a recording: it stands in for wheel force transducers, and scores estimates."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..virtual_vehicle import Truth
from ..virtual_vehicle.scale import G

Array = NDArray[np.float64]
EXCITED = 0.01
"""Slip angle of an axle, rad, from which a force over it tells a stiffness."""


@dataclass(frozen=True)
class TyreTruth:
    """The tyres' forces and slips just after every row's time, without noise; both wheels of an axle together.

    Signs as in ISO 8855: a positive slip angle makes a positive force, F_y = C_alpha alpha.

    Attributes
    ----------
    time : (n,) s.
    F_yf, F_yr : (n,) lateral forces across the wheels, N.
    alpha_f, alpha_r : (n,) slip angles at the middle of the axles, rad: steer - atan2(v_y + l_f yaw_rate, v_x) and
        -atan2(v_y - l_r yaw_rate, v_x).
    v_y, yaw_rate, a_y : (n,) motion of the centre of gravity, m/s, rad/s, m/s^2.
    C_0f, C_0r : slopes of F_y over alpha at zero slip and static load, N/rad.
    """

    time: Array
    F_yf: Array
    F_yr: Array
    alpha_f: Array
    alpha_r: Array
    v_y: Array
    yaw_rate: Array
    a_y: Array
    C_0f: float
    C_0r: float

    @property
    def C_alpha_f(self) -> Array:
        """Cornering stiffness F_y / alpha of the front axle, N/rad (secant); NaN below `EXCITED`."""
        return _secant(self.F_yf, self.alpha_f)

    @property
    def C_alpha_r(self) -> Array:
        """Cornering stiffness F_y / alpha of the rear axle, N/rad (secant); NaN below `EXCITED`."""
        return _secant(self.F_yr, self.alpha_r)

    def columns(self) -> dict[str, Array]:
        """All that is known of every row, by name, each with `true_` before it: nobody reads it by mistake."""
        own = {field.name: getattr(self, field.name) for field in fields(self) if field.name[:2] != "C_"}
        every = {**own, "C_alpha_f": self.C_alpha_f, "C_alpha_r": self.C_alpha_r}
        return {name if name == "time" else f"true_{name}": values for name, values in every.items()}


def tyre_truth(truth: Truth, time: Array) -> TyreTruth:
    """The tyres' part of what is true of a recording."""
    p, states = truth.car.parameters, truth.states
    v_x, v_y, r = states["v_x"], states["v_y"], states["yaw_rate"]
    L = p["l_f"] + p["l_r"]
    slopes = {axle: p[f"B_{axle}"] * p[f"C_{axle}"] * p[f"D_{axle}"] * p["m"] * G / L for axle in "fr"}
    return TyreTruth(
        time=np.asarray(time),
        F_yf=states["F_yf"],
        F_yr=states["F_yr"],
        alpha_f=states["steer"] - np.arctan2(v_y + p["l_f"] * r, v_x),
        alpha_r=-np.arctan2(v_y - p["l_r"] * r, v_x),
        v_y=v_y,
        yaw_rate=r,
        a_y=states["a_y"],
        C_0f=slopes["f"] * p["l_r"],
        C_0r=slopes["r"] * p["l_f"],
    )


def _secant(force: Array, slip: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(np.abs(slip) >= EXCITED, force / slip, np.nan))
