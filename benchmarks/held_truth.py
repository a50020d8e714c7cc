"""How often 95 % intervals of whole fits hold the truth, on recordings of an independent simulator.

    python benchmarks/held_truth.py [--json] [--recordings 300] [--seconds 20]

A full-size car is driven through mixed manoeuvres by the simulator of the tests (numba, 0.5 ms steps, no code in common
with the package), read at 50 Hz with AR(1) noise of rho 0 and 0.8, and fitted as a user would: `fit`, whole runs, five
free parameters from wrong starts.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from running import options, tell

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, simulate

from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import build

FREE = ("I_z", "B_f", "D_f", "B_r", "D_r")
NOISE = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.01, "a_x": 0.15, "a_y": 0.15}
WRONG = 1.15
"""Factor on the true parameters from which fits start."""


def main() -> None:
    """Run the benchmark."""
    given = options(__doc__, recordings=300, seconds=20.0)
    tell({"rows": [row for rho in (0.0, 0.8) for row in covered(given.recordings, given.seconds, rho)]}, given.json)


def covered(recordings: int, seconds: float, rho: float) -> list[dict[str, Any]]:
    """Share of recordings whose interval holds the truth, by parameter."""
    model = build("single_track")
    known = (p.with_value(FULL_SIZE_CAR[p.name]) for p in model.parameters if p.name in FULL_SIZE_CAR)
    model = model.with_parameters(*known)
    start = model.with_parameters(*(replace(p, fixed=p.name not in FREE) for p in model.parameters))
    start = start.with_parameters(*(start[name].with_value(WRONG * start[name].array) for name in FREE))
    inside = dict.fromkeys(FREE, 0)
    for seed in range(recordings):
        commands = manoeuvre("mixed", FULL_SIZE_CAR, seed=seed, duration=seconds, rate=50.0)
        found = simulate(FULL_SIZE_CAR, commands, start=(commands["v_x"][0], 0.0, 0.0), fine=5e-4)
        random = np.random.default_rng(seed)
        readings = {name: found[name] + sd * _coloured(random, len(found[name]), rho) for name, sd in NOISE.items()}
        recording = Recording(
            "run", commands["time"], {"steer": commands["steer"], "drive_force": commands["drive"], **readings}
        )
        result = fit(start, [recording], how=FitOptions(solver="gauss-newton"))
        for name in FREE:
            low, high = result.interval(name)
            inside[name] += bool(low <= FULL_SIZE_CAR[name] <= high)
    return [
        {"rho": rho, "parameter": name, "covered": inside[name] / recordings, "recordings": recordings} for name in FREE
    ]


def _coloured(random: np.random.Generator, rows: int, rho: float) -> np.ndarray:
    """AR(1) noise of standard deviation one."""
    noise = random.standard_normal(rows)
    for k in range(1, rows):
        noise[k] = rho * noise[k - 1] + np.sqrt(1 - rho**2) * noise[k]
    return noise


if __name__ == "__main__":
    main()
