"""The single track that an engineer would identify a foreign vehicle as: least squares on manoeuvres without noise.

Mass, geometry and the shares of the axles are weighed and measured; tyres, yaw inertia, resistance and drive are fitted
to the accelerations of the nominal vehicle, with weights by its sensors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from ...datasets.virtual_vehicle import VirtualCar
from ...datasets.virtual_vehicle.compiled import Row
from .ride import Ride

_TYRES = tuple(f"{name}_{axle}" for axle in "fr" for name in "BCDE")
_LEAST = np.array([0.5, 0.6, 0.2, -4.0] * 2 + [0.5] + [0.0, 0.0, 0.0, 0.3])
_MOST = np.array([80.0, 2.6, 3.0, 0.98] * 2 + [2.0] + [10.0, 10.0, 10.0, 3.0])

_AFTER = 0.6
"""Of a row, after which a servo has done what it can of a command that is held."""


def identified(car: VirtualCar, rides: list[Ride]) -> VirtualCar:
    """The vehicle with tyres, yaw inertia, resistance and drive as they fit best.

    Parameters
    ----------
    car : as roughly known.
    rides : of the nominal vehicle, nothing withheld.
    """
    truth = [ride.truth(_AFTER * ride.period) for ride in rides]  # the servo has done what it can by then
    joined = {name: np.concatenate([own[name] for own in truth]) for name in truth[0]}
    steer, drive = (np.concatenate([ride.arriving(k, _AFTER) for ride in rides]) for k in (0, 1))
    moving = (joined["v_x"] > 0.15 * car.top_speed) & (np.arange(len(steer)) % 3 == 0)
    joined = {name: own[moving] for name, own in joined.items()}
    steer, drive = steer[moving], drive[moving]
    weights = {name: 1.0 / max(float(np.std(joined[name])), 1e-9) for name in ("a_x", "a_y", "yaw_acceleration")}
    p = dict(car.parameters)

    def stated(x: Row) -> dict[str, float]:
        own = dict(zip(_TYRES, map(float, x[:8]), strict=True))
        own["I_z"] = p["I_z"] * float(x[8])
        scales = (p["m"] * 0.1, p["m"] * 0.1 / car.top_speed, p["m"] / car.top_speed**2, p["force_per_unit"])
        return p | own | dict(zip(("c_0", "c_1", "c_2", "force_per_unit"), scales * x[9:], strict=True))

    def residuals(x: Row) -> Row:
        a = accelerations(stated(x), joined, steer, drive)
        gone = [weights[name] * (a[name] - joined[name]) for name in weights]
        held = 0.01 * (x[8] - 1.0) * np.sqrt(len(steer)), 1e-3 * np.sqrt(len(steer)) * x[10]
        return np.concatenate([*gone, held])

    begin = np.array([*(p[name] for name in _TYRES), 1.0, p["c_0"] / (p["m"] * 0.1), 0.0,
                      p["c_2"] * car.top_speed**2 / p["m"], 1.0])  # fmt: skip
    found = least_squares(residuals, np.clip(begin, _LEAST + 1e-6, _MOST - 1e-6), bounds=(_LEAST, _MOST), max_nfev=40)
    return replace(car, parameters={name: float(f"{own:.6g}") for name, own in stated(found.x).items()})


def accelerations(p: dict[str, float], at: dict[str, Row], steer: Row, drive: Row) -> dict[str, Row]:
    """a_x, a_y and yaw acceleration of the single track in a motion, (n,) each."""
    v_x, v_y, r, L = at["v_x"], at["v_y"], at["yaw_rate"], p["l_f"] + p["l_r"]
    alpha = {"f": steer - np.arctan2(v_y + p["l_f"] * r, v_x), "r": -np.arctan2(v_y - p["l_r"] * r, v_x)}
    F_y = {}
    for axle, arm in (("f", p["l_r"]), ("r", p["l_f"])):
        B, C, D, E = (p[f"{name}_{axle}"] for name in "BCDE")
        x = B * alpha[axle]
        F_y[axle] = p["m"] * 9.81 * arm / L * D * np.sin(C * np.arctan(x - E * (x - np.arctan(x))))
    F = p["force_per_unit"] * drive
    share = np.where(F >= 0.0, p["drive_split_front"], p["brake_split_front"])
    along, c, s = share * F, np.cos(steer), np.sin(steer)
    across = F_y["f"] * c + along * s
    resistance = p["c_0"] * np.tanh(v_x / 0.1) + p["c_1"] * v_x + p["c_2"] * v_x * np.abs(v_x)
    return {
        "a_x": ((1.0 - share) * F + along * c - F_y["f"] * s - resistance) / p["m"],
        "a_y": (F_y["r"] + across) / p["m"],
        "yaw_acceleration": (p["l_f"] * across - p["l_r"] * F_y["r"]) / p["I_z"],
    }
