"""Fleets: throughput, changes within vehicles whose truth is known, cost.

    python benchmarks/fleet.py throughput --recordings 1000
    python benchmarks/fleet.py drift --seed 1
    python benchmarks/fleet.py cost

Each makes its own recordings in a temporary folder (--folder keeps them, and takes those that are there) and prints
one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd
from fleet_estimates import called, cost, drift, laps, watched

LAP = """recordings = "data/*/*.*"
vehicle = "class.toml"
steps = {steps}
limits = {{seconds = {seconds}, memory = "1GB"}}
[fit]
model = "lateral"
set = {{tyre = "linear"}}
"""


def throughput(folder: Path, args: argparse.Namespace) -> dict:
    """Check and fit of recordings of 60 s at 50 Hz, again, with nothing to do; a hundred by one job and by two."""
    count = args.recordings or 1000
    if not (folder / "class.toml").exists():
        laps(folder, count, 60.0, args.seed)
    plan, hundred = folder / "fleet.toml", folder / "hundred.toml"
    plan.write_text(LAP.format(steps='["check", "fit"]', seconds=60))
    hundred.write_text(plan.read_text().replace("data/*/*.*", "data/*/r000??.*"))
    found = {"all, jobs 1": _timed(plan, folder / "R", count)}
    for name, options in {"again": (), "again_only_changed": ("--only", "changed")}.items():
        found[name] = _timed(plan, folder / "R", count, *options)
    for jobs in (1, 2):
        found[f"hundred, jobs {jobs}"] = _timed(hundred, folder / f"R{jobs}", min(count, 100), "--jobs", jobs)
    one, two = found["hundred, jobs 1"], found["hundred, jobs 2"]
    found["speed_up_by_the_clock"] = round(one["wall_s"] / two["wall_s"], 3)
    found["speed_up_if_cores_were_free"] = round(2.0 * one["all_cpu_s"] / two["all_cpu_s"], 3)
    rows = pd.read_parquet(folder / "R" / "recordings")
    found |= {"worker_peak_mb": float(rows["peak_mb"].max()), "statuses": rows["status"].value_counts().to_dict()}
    found["bytes_read_per_recording"] = _bytes(folder / "data") / count
    found["bytes_written_per_recording"] = _bytes(folder / "R") / count
    print(json.dumps(found), file=sys.stderr, flush=True)
    found["gap_cpu_s"] = _with_gap(folder)
    return found


def _timed(plan: Path, out: Path, count: int, *options: object) -> dict:
    """What a run takes, and how much of it is not in units of work."""
    began = time.monotonic()
    body, cpu, peak = watched("fleet", "run", plan, "--out", out, *options)
    units = body["cpu_seconds"]
    return {
        "failed": body["failed"], "units_cpu_s": units, "all_cpu_s": round(cpu, 1),
        "overhead_cpu_s": round(cpu - units, 2),
        "overhead": round(cpu / units - 1.0, 4) if units else None, "cpu_s_per_recording": round(cpu / count, 3),
        "wall_s": round(time.monotonic() - began, 2), "coordinator_peak_mb": round(peak, 1),
    }  # fmt: skip


def _bytes(folder: Path) -> int:
    return sum(own.stat().st_size for own in folder.rglob("*.parquet"))


def _with_gap(folder: Path) -> float:
    ten = folder / "ten.toml"
    ten.write_text(LAP.format(steps='["check", "fit", "gap"]', seconds=120).replace("data/*/*.*", "data/*/r0000?.*"))
    body, _ = called("fleet", "run", ten, "--out", folder / "Rgap")
    return body["cpu_seconds"] / body["recordings"]


BENCHMARKS = {"throughput": throughput, "drift": drift, "cost": cost}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=BENCHMARKS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recordings", type=int, default=0)
    parser.add_argument("--vehicles", type=int, default=0)
    parser.add_argument("--each", type=int, default=0)
    parser.add_argument("--steps", type=int, default=0, help="drift: vehicles that jump; one in ten unless given")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--no-delay", action="store_true", help="drift: steps of the offset alone, delays held; faster")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--cpu", type=float, default=0.72)
    parser.add_argument("--gap-cpu", type=float, default=8.0)
    parser.add_argument("--euros", type=float, default=0.04, help="of a CPU hour; what clouds ask of a shared core")
    parser.add_argument("--read-bytes", type=float, default=186e3)
    parser.add_argument("--written-bytes", type=float, default=2e3)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = args.folder or Path(made)
        folder.mkdir(parents=True, exist_ok=True)
        print(json.dumps(BENCHMARKS[args.what](folder, args), indent=1, default=str))


if __name__ == "__main__":
    main()
