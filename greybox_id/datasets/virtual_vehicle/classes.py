"""Random vehicles of four classes, about values typical of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

import numpy as np

from .car import VirtualCar
from .entries import Kind
from .scale import G

_Range = tuple[float, float]

_CLASSES: Mapping[Kind, Mapping[str, _Range]] = {
    "racer": {
        "m": (2.9, 4.4), "L": (0.30, 0.36), "front_load": (0.46, 0.54), "gyration": (0.42, 0.55),
        "h_cg": (0.045, 0.075), "track": (0.7, 0.8), "wheel": (0.15, 0.17), "B_f": (4.5, 8.0), "C": (1.35, 1.6),
        "D": (0.8, 1.0), "E": (0.0, 0.3), "c_0": (0.015, 0.05), "c_1": (0.0, 0.2), "drag": (0.01, 0.04),
        "brake": (0.48, 0.56), "steer": (0.38, 0.45),
        "top": (6.5, 8.0), "v": (0.02, 0.05), "yaw": (0.015, 0.04), "a": (0.15, 0.35), "amps": (0.6, 2.8),
    },
    "car": {
        "m": (950.0, 2100.0), "L": (2.45, 3.0), "front_load": (0.47, 0.60), "gyration": (0.46, 0.52),
        "h_cg": (0.5, 0.68), "track": (0.54, 0.59), "wheel": (0.11, 0.12), "B_f": (8.0, 12.0), "C": (1.3, 1.55),
        "D": (0.88, 1.05), "E": (0.0, 0.3), "c_0": (0.010, 0.017), "c_1": (0.0, 0.0), "drag": (0.018, 0.035),
        "brake": (0.58, 0.70), "steer": (0.5, 0.6), "top": (26.0, 33.0), "v": (0.015, 0.05), "yaw": (0.003, 0.01),
        "a": (0.06, 0.18), "amps": (10.0, 30.0),
    },
    "truck": {
        "m": (2600.0, 17000.0), "L": (3.3, 5.2), "front_load": (0.38, 0.52), "gyration": (0.45, 0.55),
        "h_cg": (0.8, 1.4), "track": (0.42, 0.50), "wheel": (0.095, 0.11), "B_f": (6.0, 9.0), "C": (1.25, 1.45),
        "D": (0.72, 0.88), "E": (0.0, 0.3), "c_0": (0.006, 0.012), "c_1": (0.0, 0.0), "drag": (0.006, 0.02),
        "brake": (0.5, 0.62), "steer": (0.55, 0.65), "top": (20.0, 24.0), "v": (0.03, 0.08), "yaw": (0.002, 0.006),
        "a": (0.05, 0.15), "amps": (20.0, 60.0),
    },
    "sports": {
        "m": (550.0, 1250.0), "L": (2.3, 2.8), "front_load": (0.42, 0.50), "gyration": (0.42, 0.48),
        "h_cg": (0.3, 0.46),
        "track": (0.55, 0.62), "wheel": (0.11, 0.13), "B_f": (9.0, 13.0), "C": (1.35, 1.6), "D": (1.15, 1.5),
        "E": (0.0, 0.3), "c_0": (0.011, 0.018), "c_1": (0.0, 0.0), "drag": (0.03, 0.07), "brake": (0.54, 0.64),
        "steer": (0.35, 0.5), "top": (32.0, 40.0), "v": (0.02, 0.06), "yaw": (0.004, 0.012), "a": (0.12, 0.3),
        "amps": (15.0, 40.0),
    },
}  # fmt: skip
"""Least and most. front_load: share of the weight; gyration: radius over sqrt(l_f l_r) is twice this; track and wheel
radius over the wheelbase; c_0 over weight; drag: force over weight at top speed; v, yaw, a: sds of sensors."""

_ODDS = {"racer": 0.3, "car": 0.35, "truck": 0.15, "sports": 0.2}
_TITLES = {"racer": "1:10 racer", "car": "car", "truck": "truck", "sports": "sports car"}


def random_vehicle(seed: int, kind: Kind | None = None) -> VirtualCar:
    """A vehicle drawn about typical values of its class; it understeers at least a little.

    Parameters
    ----------
    seed : says which.
    kind : class; None draws it as well.
    """
    rng = np.random.default_rng((seed, 7201))
    kinds: tuple[Kind, ...] = get_args(Kind)
    drawn: Kind = kinds[int(rng.choice(len(kinds), p=[_ODDS[k] for k in kinds]))]
    kind = drawn if kind is None else kind
    draw = {name: float(rng.uniform(*limits)) for name, limits in _CLASSES[kind].items()}
    m, L = draw["m"], draw["L"]
    l_r = draw["front_load"] * L
    l_f = L - l_r
    D_f, B_f, C_f = draw["D"], draw["B_f"], draw["C"]
    D_r = D_f * float(rng.uniform(1.01, 1.06))
    C_r = C_f * float(rng.uniform(0.98, 1.02))
    B_r = B_f * C_f * D_f / (C_r * D_r) * float(rng.uniform(1.06, 1.3))  # the rear is the stiffer one: it understeers
    channel = str(rng.choice(["motor_current", "ax_cmd", "drive_force"], p=[0.5, 0.3, 0.2]))
    if kind != "racer":
        channel = str(rng.choice(["ax_cmd", "drive_force", "motor_current"], p=[0.6, 0.3, 0.1]))
    per_unit = {"ax_cmd": m, "drive_force": 1.0, "motor_current": draw["amps"]}[channel]
    noise = {"v_x": draw["v"], "v_y": draw["v"], "yaw_rate": draw["yaw"], "a_x": draw["a"], "a_y": draw["a"]}
    if rng.random() < 0.5:
        del noise["v_y"]
    driven = {"racer": [0.5, 0.0], "car": [0.0, 0.4], "truck": [0.0, 0.0], "sports": [0.0, 0.0]}[kind]
    parameters = {
        "m": m, "I_z": (2.0 * draw["gyration"]) ** 2 * m * l_f * l_r, "l_f": l_f, "l_r": l_r, "h_cg": draw["h_cg"],
        "track_f": draw["track"] * L, "track_r": draw["track"] * L, "wheel_radius": draw["wheel"] * L,
        "B_f": B_f, "C_f": C_f, "D_f": D_f, "E_f": draw["E"], "B_r": B_r, "C_r": C_r, "D_r": D_r, "E_r": draw["E"],
        "c_0": draw["c_0"] * m * G, "c_1": draw["c_1"], "c_2": draw["drag"] * m * G / draw["top"] ** 2,
        "drive_split_front": float(rng.choice(driven)), "brake_split_front": draw["brake"], "force_per_unit": per_unit,
    }  # fmt: skip
    return VirtualCar(
        name=f"{_TITLES[kind]} {seed}",
        kind=kind,
        parameters={name: _rounded(value) for name, value in parameters.items()},
        drive_channel=channel,
        noise={name: _rounded(sd, 2) for name, sd in noise.items()},
        steer_max=_rounded(draw["steer"], 2),
        top_speed=_rounded(draw["top"], 3),
    )


def _rounded(value: float, digits: int = 5) -> float:
    """As a data sheet would state it."""
    return float(f"{value:.{digits}g}")
