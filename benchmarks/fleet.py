"""Fleets: throughput, the same tables from every engine, kills, damage, calibration of vehicles and of drift, cost.

    python benchmarks/fleet.py throughput --recordings 1000
    python benchmarks/fleet.py memory --recordings 10000
    python benchmarks/fleet.py determinism
    python benchmarks/fleet.py kills --moments 20
    python benchmarks/fleet.py damage
    python benchmarks/fleet.py hierarchy --seed 1
    python benchmarks/fleet.py drift --seed 1
    python benchmarks/fleet.py few --seed 1
    python benchmarks/fleet.py joint
    python benchmarks/fleet.py cost

Each makes its own recordings in a temporary folder (--folder keeps them, and takes those that are there) and prints
one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
from fleet_estimates import called, cost, drift, few, greybox, hierarchy, joint, laps, table, watched
from hostile_mutations import mutated

LAP = """recordings = "data/*/*.*"
vehicle = "class.toml"
steps = {steps}
limits = {{seconds = {seconds}, memory = "1GB"}}
[fit]
model = "lateral"
set = {{tyre = "linear"}}
"""
KILLED = (("local", "client"), ("local", "worker"), ("dask", "client"), ("dask", "worker"), ("dask", "scheduler"))
"""Engines, and which of their processes is killed."""


def same(one: Path, other: Path) -> bool:
    """Whether two folders hold the same results."""
    names = ("recordings", "parameters", "covariances", "gaps")
    return all(repr_of(table(one, name)) == repr_of(table(other, name)) for name in names)


def repr_of(found: pd.DataFrame) -> str:
    return found.to_json(orient="records", double_precision=15)


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


def memory(folder: Path, args: argparse.Namespace) -> dict:
    """What the command itself holds with so many entries, one in a hundred of which is there; others are rows too."""
    count = args.recordings or 10_000
    if not (folder / "class.toml").exists():
        laps(folder, count // 100, 15.0, args.seed)
    there = [str(own.relative_to(folder)) for own in sorted((folder / "data").rglob("*.parquet"))]
    paths = [*there, *(f"data/V{k % 100:02d}/missing{k:06d}.parquet" for k in range(count - len(there)))]
    pd.DataFrame({"path": paths, "vehicle": [own.split("/")[1] for own in paths]}).to_csv(
        folder / "manifest.csv", index=False
    )
    plan = folder / "fleet.toml"
    plan.write_text(LAP.format(steps='["check", "fit"]', seconds=60).replace("data/*/*.*", "manifest.csv"))
    found = {}
    for name in ("first", "again"):
        began = time.monotonic()
        body, cpu, peak = watched("fleet", "run", plan, "--out", folder / "R")
        found[name] = {
            "recordings": body["recordings"], "done": body["done"], "failed": body["failed"],
            "wall_s": round(time.monotonic() - began, 1), "cpu_s": round(cpu, 1), "coordinator_peak_mb": round(peak, 1),
        }  # fmt: skip
    rows = pd.read_parquet(folder / "R" / "recordings")
    return {**found, "worker_peak_mb": float(rows["peak_mb"].max()), "bytes_written": _bytes(folder / "R")}


def _with_gap(folder: Path) -> float:
    ten = folder / "ten.toml"
    ten.write_text(LAP.format(steps='["check", "fit", "gap"]', seconds=120).replace("data/*/*.*", "data/*/r0000?.*"))
    body, _ = called("fleet", "run", ten, "--out", folder / "Rgap")
    return body["cpu_seconds"] / body["recordings"]


def determinism(folder: Path, args: argparse.Namespace) -> dict:
    """The same recordings by every engine."""
    laps(folder, args.recordings or 200, 15.0, args.seed, 5)
    plan = folder / "fleet.toml"
    plan.write_text(LAP.format(steps='["check", "fit", "gap"]' if args.gap else '["check", "fit"]', seconds=120))
    return {"recordings": args.recordings or 200, "same_as_local_1": _in_all_ways(folder, plan)}


def _in_all_ways(folder: Path, plan: Path) -> dict[str, bool]:
    ways = {"local 1": (), "local 2": ("--jobs", 2), "dask 2": ("--jobs", 2, "--engine", "dask")}
    for k, options in enumerate(ways.values()):
        called("fleet", "run", plan, "--out", folder / f"R{k}", *options)
    return {name: same(folder / "R0", folder / f"R{k}") for k, name in enumerate(ways) if k}


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
        engine, whom = KILLED[moment % len(KILLED)]
        out, calls, at, hit = folder / f"R{moment}", 0, -1, None
        target = rng.randrange(24)  # results that are there when it is killed; with none it is just starting
        later = rng.uniform(0.0, 1.0)
        while calls < 5:
            calls += 1
            port = _free_port()
            cluster = _cluster(port) if whom == "scheduler" else []
            words = greybox("fleet", "run", plan, "--out", out, "--jobs", 2, "--engine", engine)
            words += ["--scheduler", f"tcp://127.0.0.1:{port}"] if cluster else []
            run = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)
            if calls == 1:
                while run.poll() is None and _results(out) < target:
                    time.sleep(0.02)
                time.sleep(later)
                below = processes_below(run.pid)
                hit = {
                    "client": (run.pid, "the command"),
                    "scheduler": (cluster[0].pid, "scheduler") if cluster else None,
                }.get(whom, rng.choice(below) if below else None)
                at = _results(out)
                alive = run.poll() is None and hit is not None
                if hit is not None:
                    _kill(hit[0])
            code = run.wait(300)
            for own in cluster:
                _kill(own.pid)
                own.wait()
            if code == 0:
                break
        rows = pd.read_parquet(out / "recordings")
        wanted = set(pd.read_parquet(out / "manifest")["key"])
        outcomes.append(
            {"engine": engine, "killed": whom, "which": "" if hit is None else hit[1][-60:], "while_at_work": alive,
             "results_by_then": at, "calls": calls, "same": same(folder / "R", out),
             "twice": int(rows["key"].duplicated().sum()), "missing": len(wanted - set(rows["key"])),
             "left": [own.name for own in (out / "journal").iterdir()]}
        )  # fmt: skip
        print(json.dumps(outcomes[-1]), file=sys.stderr, flush=True)
    counted = ("same", "twice", "missing", "while_at_work")
    return {"moments": len(outcomes), **{name: sum(own[name] for own in outcomes) for name in counted},
            "outcomes": outcomes}  # fmt: skip


def _results(out: Path) -> int:
    """How many results there are, in the journal and in parts."""
    lines = 0
    with suppress(OSError):
        lines += sum(own.read_bytes().count(b"\n") for own in (out / "journal").glob("*.jsonl"))
    with suppress(OSError, ValueError):
        lines += len(pd.read_parquet(out / "recordings", columns=["key"]))
    return lines


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def _cluster(port: int) -> list[subprocess.Popen]:
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    where = [f"tcp://127.0.0.1:{port}", "--nworkers", "2", "--nthreads", "1", "--no-dashboard", "--death-timeout", "60"]
    start = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port)]
    return [
        subprocess.Popen([*start, "--no-dashboard"], **quiet),
        subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", *where], **quiet),
    ]


def damage(folder: Path, args: argparse.Namespace) -> dict:
    """One recording in twenty is damaged; one in a hundred each cannot end, takes all memory, or is no file at all."""
    count = args.recordings or 200
    laps(folder, count, 15.0, args.seed)
    files = sorted((folder / "data").rglob("*.parquet"))
    rng = random.Random(args.seed)
    broken = rng.sample(files, max(1, count // 20))
    for k, file in enumerate(broken):
        file.write_bytes(mutated(file.read_bytes(), "parquet", args.seed, k))
    sound = pd.read_parquet(next(file for file in files if file not in broken))
    each = max(1, count // 100)
    for k in range(each):
        os.mkfifo(folder / "data" / "V00" / f"pipe{k}.csv")
        long = pd.concat([sound] * 1500, ignore_index=True)  # six hours, which no fit does in 8 s
        long["time"] = np.arange(len(long)) * 0.02 + k
        long.to_parquet(folder / "data" / "V00" / f"long{k}.parquet")
        greedy = pd.DataFrame({name: np.full(25_000_000, 0.1) for name in sound})
        greedy["time"] = np.arange(len(greedy)) * 0.02 + k
        greedy.to_parquet(folder / "data" / "V00" / f"greedy{k}.parquet")
        del long, greedy
    plan = folder / "fleet.toml"
    plan.write_text(LAP.format(steps='["check", "fit"]', seconds=8))
    equal = _in_all_ways(folder, plan)
    rows = pd.read_parquet(folder / "R0" / "recordings")
    not_ok = rows[rows["status"] != "ok"]
    return {
        "recordings": count + 3 * each, "rows": len(rows), "broken": len(broken), "same_as_local_1": equal,
        "statuses": rows["status"].value_counts().to_dict(),
        "without_sentence": int((not_ok["sentence"].fillna("") == "").sum()),
        "sentences": sorted(set(not_ok["status"] + ": " + not_ok["path"] + ": " + not_ok["sentence"].str.slice(0, 99))),
    }  # fmt: skip


BENCHMARKS = {
    own.__name__: own for own in (throughput, memory, determinism, kills, damage, hierarchy, drift, few, joint, cost)
}


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
