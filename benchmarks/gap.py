"""What a diagnosis costs: CPU seconds per case, and its simulations beside plain free runs, measured in the same run.

    python benchmarks/gap.py [--json] [--seconds 40] [--repeats 3] [--cases steering_delay mass_change]

A full-size car with one effect is driven by the simulator of the tests (no code in common with the package) and read at
50 Hz with white noise; every number of the nominal model is exact. A plain free run is one of the nominal
model, without effects, on the same recording, laid out and compiled beforehand. The ratio is of simulations per CPU
second, the whole diagnosis (linearisations, refits and selection included) over plain free runs one after the other.
Compiled code comes from the cache: one case is diagnosed beforehand.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, simulate

from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.engine.motion.prediction import Predictor
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.gap.diagnosis import diagnose
from greybox_id.gap.estimation.bench import Bench, Simulated
from greybox_id.gap.gap import Gap
from greybox_id.models.effects import EFFECTS
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.registry import build
from greybox_id.models.vehicle import Stated, Vehicle

NOISE = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.01, "a_x": 0.15, "a_y": 0.15}
CASES = {
    "null": {},
    "steering_delay": {"steering_delay": 0.05},
    "tyre_relaxation": {"tyre_relaxation": 0.4},
    "mass_change": {"mass_change": 1.08},
    "sensor_latency_yaw": {"sensor_latency_yaw": 0.03},
    "road_slope": {"road_slope": 0.03},
    "mass_change and sensor_latency_yaw": {"mass_change": 1.08, "sensor_latency_yaw": 0.03},
}
"""Name of a case -> the effects that the vehicle has and the model lacks."""


def main() -> int:
    """Run the benchmark."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--json", action="store_true", help="one JSON object on standard output")
    arguments.add_argument("--seconds", type=float, default=40.0, help="of every recording")
    arguments.add_argument("--repeats", type=int, default=3, help="the median is told")
    arguments.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    given = arguments.parse_args()
    with threadpool_limits(1):
        rows = measure(given.cases, given.seconds, given.repeats)
    if given.json:
        sys.stdout.write(json.dumps({"rows": rows}, indent=1) + "\n")
        return 0
    table = Table(title=f"A diagnosis of {given.seconds:g} s at 50 Hz", box=None)
    for head in ("case", "first", "CPU [s]", "simulations", "per second", "free runs per second", "ratio"):
        table.add_column(head, justify="left" if head in ("case", "first") else "right")
    for row in rows:
        table.add_row(
            row["case"], row["first"], f"{row['cpu_seconds']:.2f}", str(row["simulations"]),
            f"{row['simulations_per_second']:.0f}", f"{row['free_runs_per_second']:.0f}", f"{row['ratio']:.2f}",
        )  # fmt: skip
    Console().print(table)
    return 0


def measure(cases: list[str], seconds: float, repeats: int) -> list[dict[str, Any]]:
    """Every case so often, with plain free runs in between."""
    vehicle = Vehicle("car", {name: Stated(v) for name, v in FULL_SIZE_CAR.items() if name != "v_max"}, noise=NOISE)
    model = build("single_track", None, {}, vehicle)
    diagnose(model, [recorded({}, seconds)], EFFECTS, vehicle=vehicle)  # warms caches
    rows = []
    for case in cases:
        sys.stderr.write(f"{case}\n")
        recording = recorded(CASES[case], seconds)
        found = [(*diagnosed(model, recording, vehicle), plain(model, recording)) for _ in range(repeats)]
        gap, cpu, count, one = found[int(np.argsort([own[1] for own in found])[len(found) // 2])]
        rows.append(
            {
                "case": case,
                "first": gap.ranking[0].effect if gap.gap_detected and gap.ranking else "no gap",
                "magnitude": gap.ranking[0].magnitude if gap.gap_detected and gap.ranking else None,
                "cpu_seconds": cpu,
                "simulations": count,
                "simulations_per_second": count / cpu,
                "free_runs_per_second": 1 / one,
                "ratio": count * one / cpu,
            }
        )
    return rows


def diagnosed(model: MotionModel, recording: Recording, vehicle: Vehicle) -> tuple[Gap, float, int]:
    """A diagnosis, its CPU seconds, and how many whole recordings it simulated; those it remembered do not count."""
    count, own = 0, Bench.simulate_anew

    def counted(bench: Bench, P: Array) -> list[Simulated]:
        nonlocal count
        count += len(P)
        return own(bench, P)

    with patch.object(Bench, "simulate_anew", counted):
        begun = time.process_time()
        gap = diagnose(model, [recording], EFFECTS, vehicle=vehicle)
        return gap, time.process_time() - begun, count


def plain(model: MotionModel, recording: Recording, runs: int = 20) -> float:
    """CPU seconds of one free run of the nominal model, laid out and compiled beforehand."""
    predictor = Predictor(Simulator(model), recording, model.values)
    predictor.free_run()
    begun = time.process_time()
    for _ in range(runs):
        predictor.free_run()
    return (time.process_time() - begun) / runs


def recorded(effects: dict[str, float], seconds: float, seed: int = 0) -> Recording:
    """A drive of the reference vehicle, with noise."""
    given = manoeuvre("mixed", FULL_SIZE_CAR, seed=seed, duration=seconds, rate=50.0)
    found = simulate(FULL_SIZE_CAR, given, effects, start=(given["v_x"][0], 0.0, 0.0), fine=1e-3)
    random = np.random.default_rng(seed)
    readings = {name: found[name] + sd * random.standard_normal(len(found[name])) for name, sd in NOISE.items()}
    return Recording("lap", given["time"], {"steer": given["steer"], "ax_cmd": given["drive"], **readings})


if __name__ == "__main__":
    sys.exit(main())
