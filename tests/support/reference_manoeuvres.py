"""Manoeuvres for the reference vehicle: commands that use most of the grip at a speed kept in hand."""

import numpy as np
from reference_vehicle import FULL_SIZE_CAR, simulate_lateral


def manoeuvre(name, parameters=FULL_SIZE_CAR, seed=0, duration=20.0, rate=50.0):
    """Commands time, steer, drive of a "slalom", "steps", "brake_in_turn" or "mixed", and the v_x [m/s] they keep.

    The drive command is what the nominal vehicle needs to keep that speed: start at (v_x[0], 0, 0).
    """
    p, rng = parameters, np.random.default_rng(seed)
    time = np.arange(int(duration * rate)) / rate
    cruise, grip = 0.35 * p["v_max"], 9.81 * min(p["D_f"], p["D_r"])

    def wander(period):
        """Smooth, within about 1, on time scales of `period` and longer."""
        waves = [np.sin(2 * np.pi * time / period / s + rng.uniform(0, 2 * np.pi)) for s in rng.uniform(1, 3, 4)]
        return np.sum(waves, axis=0) / 2.5

    v_x = cruise * (1 + 0.1 * wander(4.0))
    if name == "slalom":
        a_y = grip * (0.3 + 0.35 * time / duration) * np.sin(2 * np.pi * 0.5 * time + rng.uniform(0, 2 * np.pi))
    elif name == "steps":
        lasts = rng.integers(int(0.6 * rate), int(1.6 * rate), len(time))
        a_y = 0.55 * grip * np.repeat(rng.uniform(-1, 1, len(time)), lasts)[: len(time)]
    elif name == "brake_in_turn":  # every 6 s: into a turn, brake, out of it and up to speed again
        sides = rng.choice([-1, 1], int(duration / 6) + 1)
        a_y = 0.55 * grip * sides[(time // 6).astype(int)] * np.interp(time % 6, [0.5, 1.5, 3.5, 4.0], [0, 1, 0.6, 0])
        v_x = np.interp(time % 6, [2, 2 + 0.5 * cruise / 4, 6], [1.2 * cruise, 0.7 * cruise, 1.2 * cruise])
    elif name == "mixed":
        a_y, v_x = 0.6 * grip * wander(0.8), cruise * (1 + 0.35 * wander(3.0))
    else:
        raise ValueError(f"no such manoeuvre: {name}")

    understeer = 1 / (p["B_f"] * p["C_f"] * p["D_f"]) - 1 / (p["B_r"] * p["C_r"] * p["D_r"])  # rad per g
    steer = a_y * ((p["l_f"] + p["l_r"]) / v_x**2 + understeer / 9.81)
    turned = simulate_lateral(p, {"time": time, "steer": steer, "v_x": v_x}, fine=1e-3)
    resistance = p["c_0"] + p["c_1"] * v_x + p["c_2"] * v_x**2
    force = p["m"] * turned["true_a_x"] + turned["F_yf"] * np.sin(steer) + resistance
    front = np.where(force > 0, p["drive_split_front"], p["brake_split_front"])
    drive = force / (1 - front + front * np.cos(steer)) / p["force_per_unit"]
    return {"time": time, "steer": steer, "drive": drive, "v_x": v_x}
