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
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from greybox_id.datasets.formats import write
from greybox_lab.fleet.joined import joined_fits
from greybox_lab.fleet.store import Store
from greybox_lab.virtual.virtual_vehicle import VirtualCar, drive, random_vehicle, steered, vehicle_file_text

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


RATE = 50.0
SPREADS = {"I_z": 0.06, "B_f": 0.08, "B_r": 0.08}
"""Standard deviations of the logarithms of what differs from vehicle to vehicle."""
FREE = tuple(SPREADS)
PLAN = """recordings = "{recordings}"
vehicle = "class.toml"
steps = {steps}
limits = {{seconds = {seconds}, memory = "1GB"}}
[fit]
model = "lateral"
fix = ["C_f", "C_r", "D_f", "D_r"]
{more}
"""
WITH_DELAY = '"steering_offset=0±0.02", "steering_delay=30±20 ms"'


def greybox(*words: object) -> list[str]:
    return [sys.executable, "-c", "from greybox_id.cli import main; main()", *map(str, words)]


def called(*words: object) -> tuple[dict, float]:
    """What a command prints as JSON, and the CPU seconds of it and of all it started."""
    found, cpu, _ = watched(*words)
    return found, cpu


def watched(*words: object) -> tuple[dict, float, float]:
    """The same, and the most memory that the command itself held, MB, without what it started."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as said:
        run = subprocess.Popen(greybox(*words, "--json"), stdout=out, stderr=said, text=True)
        peak = 0.0
        while run.poll() is None:
            peak = max(peak, _peak_mb(run.pid))
            time.sleep(0.05)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        out.seek(0), said.seek(0)
        if run.returncode:
            raise SystemExit(said.read())
        return json.loads(out.read()), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, peak


def _peak_mb(pid: int) -> float:
    """The most memory that a process held so far, as Linux tells it."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                return float(line.split()[1]) / 1024.0
    return 0.0


def laps(folder: Path, count: int, seconds: float, seed: int, vehicles: int = 10) -> None:
    """A folder of plain recordings of one kind of car."""
    car = random_vehicle(seed)
    (folder / "class.toml").write_text(vehicle_file_text(car))
    for k in range(count):
        own, _ = drive(car, "mixed", duration=seconds, rate=RATE, seed=seed * 100_000 + k)
        target = folder / "data" / f"V{k % vehicles:02d}"
        target.mkdir(parents=True, exist_ok=True)
        write(own, target / f"r{k:05d}.parquet")


def made_vehicle(base: VirtualCar, rng: np.random.Generator) -> tuple[VirtualCar, dict[str, float]]:
    """A vehicle of the class: its stiffnesses and inertia are drawn."""
    truth = {name: base.parameters[name] * float(np.exp(rng.normal(0.0, sd))) for name, sd in SPREADS.items()}
    return replace(base, parameters={**base.parameters, **truth}), truth


def manoeuvre(rng: np.random.Generator, seconds: float, poor: bool) -> tuple[np.ndarray, np.ndarray]:
    """Steering and speed: sines of many frequencies, or of a tenth the size and slow."""
    t = np.arange(round(seconds * RATE)) / RATE
    frequencies = np.exp(rng.uniform(np.log(0.1), np.log(0.4 if poor else 2.0), 6))
    waves = sum(np.sin(2 * np.pi * (f * t + rng.random())) for f in frequencies) / np.sqrt(3.0)
    speed = rng.uniform(18.0, 30.0) + 2.0 * np.sin(2 * np.pi * (0.05 * t + rng.random()))
    a_y = 0.5 if poor else 3.0
    return a_y * waves / 400.0 * 8.0 / speed * 20.0 / 8.0 * 0.8, speed


def class_of(seed: int) -> VirtualCar:
    """A passenger car without small effects."""
    for k in range(1000):
        car = random_vehicle(seed * 1000 + k)
        if car.kind == "car":
            return replace(car, small={})
    raise SystemExit("no car was drawn")


def _class_fleet(folder: Path, args: argparse.Namespace, make: Callable[[Path, argparse.Namespace], dict]) -> dict:
    """What is true of the recordings in a folder, which are made where they are not there yet."""
    told = folder / "truths.json"
    if not told.exists():
        told.write_text(json.dumps(make(folder, args)))
    found: dict = json.loads(told.read_text())
    return found


def drift(folder: Path, args: argparse.Namespace) -> dict:
    """A fifth of the vehicles lose stiffness, a tenth jump in steering offset or delay, the others are steady."""
    made = _class_fleet(folder, args, _changing_class)
    body, _ = called("fleet", "run", folder / "fleet.toml", "--out", folder / "R", "--jobs", args.jobs)
    return scored_drift(folder / "R", made["changes"], made["vehicles"]) | {"run": body}


def _changing_class(folder: Path, args: argparse.Namespace) -> dict:
    rng, base = np.random.default_rng(args.seed), class_of(args.seed)
    (folder / "class.toml").write_text(vehicle_file_text(base))
    vehicles, each = args.vehicles or 40, args.each or 25
    truths: dict[str, tuple[str, str, float]] = {}
    lines = ["path,vehicle,time,odometer"]
    for v in range(vehicles):
        name = f"V{v:03d}"
        car, _ = made_vehicle(base, rng)
        (folder / "data" / name).mkdir(parents=True, exist_ok=True)
        at = int(rng.integers(5, each - 5))
        if v < vehicles // 5:
            axle = "B_f" if v % 2 else "B_r"
            truths[name] = (axle, "slope", car.parameters[axle])
        elif v < vehicles // 5 + (args.steps or vehicles // 10):
            steps_of = "steering_offset" if v % 2 or args.no_delay else "steering_delay"
            truths[name] = (steps_of, "step", float(at))
        for r in range(each):
            share, effects, now = r / (each - 1), {"steering_delay": 0.03}, car
            if name in truths and truths[name][1] == "slope":
                axle = truths[name][0]
                now = replace(car, parameters={**car.parameters, axle: car.parameters[axle] * (1.0 - 0.2 * share)})
            elif name in truths and r >= at:
                effects |= (
                    {"steering_offset": 0.006} if truths[name][0] == "steering_offset" else {"steering_delay": 0.052}
                )
            steer, speed = manoeuvre(rng, 30.0, bool(rng.random() < 0.5))
            own, _ = steered(now, f"r{r}", steer, speed, RATE, effects, seed=int(rng.integers(1 << 31)))
            path = f"data/{name}/r{r:03d}.parquet"
            write(own, folder / path)
            lines.append(f"{path},{name},{1.7e9 + 86400 * r:.0f},{1e6 * r}")
    (folder / "manifest.csv").write_text("\n".join(lines) + "\n")
    free = '"steering_offset=0±0.02", "steering_delay=30ms"' if args.no_delay else WITH_DELAY
    more = f'with = [{free}]\nsolver = "gauss-newton"'
    (folder / "fleet.toml").write_text(
        PLAN.format(recordings="manifest.csv", steps='["check", "fit"]', seconds=10, more=more)
    )  # a fit takes 0.6 s; one that goes on over a delay that no recording tells takes 20 s and ends at no optimum
    return {"changes": truths, "vehicles": vehicles}


def scored_drift(results: Path, truths: dict[str, tuple[str, str, float]], vehicles: int) -> dict:
    """Against what is true between the recordings that count: neither the first nor the last has to be one of them."""
    called("fleet", "estimate", results)
    store = Store(results)
    joined, _ = joined_fits(store, store.current())
    places = joined.rows.groupby("vehicle")["odometer"].apply(lambda own: np.sort(own) / 1e6)
    each = 1 + round(float(store.read("manifest")["odometer"].max()) / 1e6)
    found = store.read("drift")
    hits = found[found["drifts"]]
    right = [v for v, (name, _, _) in truths.items() if ((hits["vehicle"] == v) & (hits["name"] == name)).any()]
    false = sorted(set(hits["vehicle"]) - set(truths))
    dated, within, held, slopes = 0, 0, 0, 0
    for v, (name, kind, value) in truths.items():
        own = hits[(hits["vehicle"] == v) & (hits["name"] == name)]
        if own.empty:
            continue
        row = own.iloc[0]
        if kind == "step":
            first = float(np.min(places[v][places[v] >= value]))
            dated += bool(row["model"] == "step" and abs(row["at"] / 1e6 - value) <= 1)
            within += bool(row["model"] == "step" and row["at_low"] / 1e6 <= first <= row["at_high"] / 1e6)
        else:
            slopes += 1
            truth = -0.2 * value * (places[v][-1] - places[v][0]) / (each - 1)
            held += bool(row["low"] <= truth <= row["high"])
    return {
        "changed": len(truths), "found_in_any": len(set(hits["vehicle"]) & set(truths)), "found": len(right),
        "steady": vehicles - len(truths), "false": false, "steps_dated": dated,
        "dates_held": within,
        "steps": sum(kind == "step" for _, kind, _ in truths.values()), "slopes_held": held, "slopes_found": slopes,
        "further": [list(own) for own in hits[["vehicle", "name", "model", "probability"]].to_numpy()
                    if own[0] in truths and truths[own[0]][0] != own[1]],
    }  # fmt: skip


def cost(folder: Path, args: argparse.Namespace) -> dict:
    """What a million recordings of 60 s at 50 Hz cost, by rates that `throughput` measured."""
    del folder
    million, euros = 1_000_000, args.euros
    fit, gap = args.cpu * million / 3600.0, (args.cpu + args.gap_cpu) * million / 3600.0
    return {
        "cpu_h_check_fit": fit, "cpu_h_with_gap": gap, "euros_check_fit": fit * euros, "euros_with_gap": gap * euros,
        "gb_read": args.read_bytes * million / 1e9, "gb_written": args.written_bytes * million / 1e9,
        "euros_per_cpu_h": euros, "hours_on_64_cores_check_fit": fit / 64, "hours_on_64_cores_with_gap": gap / 64,
    }  # fmt: skip


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
