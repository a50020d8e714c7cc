"""Fleets: throughput, the same tables from every engine, kills, damage, calibration of vehicles and of drift, cost.

    python benchmarks/fleet.py throughput --recordings 1000
    python benchmarks/fleet.py determinism
    python benchmarks/fleet.py kills --moments 20
    python benchmarks/fleet.py damage
    python benchmarks/fleet.py hierarchy --seed 1
    python benchmarks/fleet.py drift --seed 1
    python benchmarks/fleet.py few --seed 1
    python benchmarks/fleet.py joint
    python benchmarks/fleet.py cost

Each makes its own recordings in a temporary folder (--folder keeps them) and prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
from fleet_estimates import called, cost, drift, few, greybox, hierarchy, joint, laps, table
from hostile_mutations import mutated

LAP = """recordings = "data/*/*.*"
vehicle = "class.toml"
steps = {steps}
limits = {{seconds = {seconds}, memory = "1GB"}}
[fit]
model = "lateral"
set = {{tyre = "linear"}}
"""


def same(one: Path, other: Path) -> bool:
    """Whether two folders hold the same results."""
    names = ("recordings", "parameters", "covariances", "gaps")
    return all(repr_of(table(one, name)) == repr_of(table(other, name)) for name in names)


def repr_of(found: pd.DataFrame) -> str:
    return found.to_json(orient="records", double_precision=15)


def throughput(folder: Path, args: argparse.Namespace) -> dict:
    laps(folder, args.recordings, 60.0, args.seed)
    plan = folder / "fleet.toml"
    plan.write_text(LAP.format(steps='["check", "fit"]', seconds=60))
    found = {}
    for jobs in (1, 2):
        began = time.monotonic()
        body, cpu = called("fleet", "run", plan, "--out", folder / f"R{jobs}", "--jobs", jobs)
        wall = time.monotonic() - began
        units = body["cpu_seconds"]
        found[f"jobs {jobs}"] = {
            "failed": body["failed"], "units_cpu_s": units, "all_cpu_s": round(cpu, 1), "wall_s": round(wall, 1),
            "cpu_s_per_recording": round(cpu / args.recordings, 3), "overhead_cpu_s": round(cpu - units, 2),
        }  # fmt: skip
    began = time.monotonic()
    called("fleet", "run", plan, "--out", folder / "R1")
    found["again_s"] = round(time.monotonic() - began, 2)
    began = time.monotonic()
    called("fleet", "run", plan, "--out", folder / "R1", "--only", "changed")
    found["again_only_changed_s"] = round(time.monotonic() - began, 2)
    rows = pd.read_parquet(folder / "R1" / "recordings")
    found |= {"peak_mb": float(rows["peak_mb"].max()), "ok": int((rows["status"] == "ok").sum())}
    found["bytes_per_recording"] = (
        sum(own.stat().st_size for own in (folder / "R1").rglob("*.parquet")) / args.recordings
    )
    found["gap_cpu_s"] = _with_gap(folder, plan, args)
    return found


def _with_gap(folder: Path, plan: Path, args: argparse.Namespace) -> float:
    few = folder / "few.toml"
    few.write_text(LAP.format(steps='["check", "fit", "gap"]', seconds=120).replace("data/*/*.*", "data/*/r0000?.*"))
    body, _ = called("fleet", "run", few, "--out", folder / "Rgap")
    return body["cpu_seconds"] / body["recordings"]


def determinism(folder: Path, args: argparse.Namespace) -> dict:
    laps(folder, 30, 20.0, args.seed, 5)
    plan = folder / "fleet.toml"
    plan.write_text(LAP.format(steps='["check", "fit", "gap"]' if args.gap else '["check", "fit"]', seconds=120))
    ways = {"local 1": (), "local 2": ("--jobs", 2), "dask 2": ("--jobs", 2, "--engine", "dask")}
    for k, options in enumerate(ways.values()):
        called("fleet", "run", plan, "--out", folder / f"R{k}", *options)
    return {name: same(folder / "R0", folder / f"R{k}") for k, name in enumerate(ways)}


def processes_below(root: int) -> list[tuple[int, str]]:
    """(number, command) of all processes that one started, and that those did."""
    told = {}
    for own in Path("/proc").iterdir():
        if own.name.isdigit():
            try:
                parent = int((own / "stat").read_text().rpartition(")")[2].split()[1])
                told[int(own.name)] = (parent, (own / "cmdline").read_bytes().replace(b"\0", b" ").decode())
            except (OSError, ValueError, IndexError):
                continue
    found, layer = [], [root]
    while layer:
        layer = [pid for pid, (parent, _) in told.items() if parent in layer]
        found += [(pid, told[pid][1]) for pid in layer]
    return found


def kills(folder: Path, args: argparse.Namespace) -> dict:
    """A worker, the client or the scheduler is killed at random moments; the same command is called until it ends."""
    laps(folder, args.recordings or 24, 15.0, args.seed, 4)
    plan = folder / "fleet.toml"
    plan.write_text(LAP.format(steps='["check", "fit"]', seconds=60))
    called("fleet", "run", plan, "--out", folder / "R")
    rng, outcomes = random.Random(args.seed), []
    for moment in range(args.moments):
        engine, whom = rng.choice([("local", "client"), ("local", "worker"), ("dask", "client"), ("dask", "worker"),
                                   ("dask", "scheduler")])  # fmt: skip
        out, tries = folder / f"R{moment}", 0
        while tries < 5:
            tries += 1
            port = 20_000 + rng.randrange(20_000)
            cluster = _cluster(port) if whom == "scheduler" else []
            words = greybox("fleet", "run", plan, "--out", out, "--jobs", 2, "--engine", engine)
            words += ["--scheduler", f"tcp://127.0.0.1:{port}"] if cluster else []
            run = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)
            if tries == 1:
                time.sleep(rng.uniform(2.0, 14.0))
                below = [pid for pid, _ in processes_below(run.pid)]
                victim = {"client": run.pid, "scheduler": cluster[0].pid if cluster else run.pid}.get(
                    whom, rng.choice(below) if below else run.pid
                )
                _kill(victim)
            code = run.wait(300)
            for own in cluster:
                _kill(own.pid)
                own.wait()
            if code == 0:
                break
        rows = pd.read_parquet(out / "recordings")
        outcomes.append(
            {"engine": engine, "killed": whom, "calls": tries, "same": same(folder / "R", out),
             "twice": int(rows["key"].duplicated().sum()), "left": _left(out)}
        )  # fmt: skip
        print(json.dumps(outcomes[-1]), file=sys.stderr, flush=True)
    return {"moments": len(outcomes), "same": sum(own["same"] for own in outcomes),
            "twice": sum(own["twice"] for own in outcomes), "outcomes": outcomes}  # fmt: skip


def _left(out: Path) -> list[str]:
    return [own.name for own in (out / "journal").iterdir()]


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def _cluster(port: int) -> list[subprocess.Popen]:
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    where = [f"tcp://127.0.0.1:{port}", "--nworkers", "2", "--nthreads", "1", "--no-dashboard", "--death-timeout", "5"]
    start = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port)]
    return [
        subprocess.Popen([*start, "--no-dashboard"], **quiet),
        subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", *where], **quiet),
    ]


def damage(folder: Path, args: argparse.Namespace) -> dict:
    count = args.recordings or 200
    laps(folder, count, 15.0, args.seed)
    files = sorted((folder / "data").rglob("*.parquet"))
    rng = random.Random(args.seed)
    broken = rng.sample(files, max(1, count // 20))
    for k, file in enumerate(broken):
        file.write_bytes(mutated(file.read_bytes(), "parquet", args.seed, k))
    for k in range(max(1, count // 100)):
        hang = folder / "data" / "V00" / f"hang{k}.csv"
        os.mkfifo(hang)
        greedy = pd.DataFrame(
            {"time": np.arange(40_000_000) * 0.02, "v_x": 5.0, "yaw_rate": 0.0, "a_y": 0.0, "steer": 0.0}
        )
        greedy.to_parquet(folder / "data" / "V00" / f"greedy{k}.parquet")
        del greedy
    plan = folder / "fleet.toml"
    plan.write_text(LAP.format(steps='["check", "fit"]', seconds=20))
    body, _ = called("fleet", "run", plan, "--out", folder / "R", "--jobs", 2)
    rows = pd.read_parquet(folder / "R" / "recordings")
    not_ok = rows[rows["status"] != "ok"]
    return {
        "recordings": body["recordings"], "rows": len(rows), "broken": len(broken),
        "statuses": rows["status"].value_counts().to_dict(),
        "without_sentence": int((not_ok["sentence"].fillna("") == "").sum()),
        "sentences": sorted(set(not_ok["sentence"].str.slice(0, 160)))[:12],
    }  # fmt: skip


BENCHMARKS = {own.__name__: own for own in (throughput, determinism, kills, damage, hierarchy, drift, few, joint, cost)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=BENCHMARKS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recordings", type=int, default=0)
    parser.add_argument("--moments", type=int, default=20)
    parser.add_argument("--vehicles", type=int, default=0)
    parser.add_argument("--each", type=int, default=0)
    parser.add_argument("--steps", type=int, default=0, help="drift: vehicles that jump; one in ten unless given")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--gap", action="store_true", help="determinism: also the step gap")
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
