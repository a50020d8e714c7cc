"""Engines return the same tables, and what is killed loses nothing."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pandas as pd
import pytest
from calling import greybox, refused

import greybox_id as gb
from greybox_lab.fleet import engines
from greybox_lab.fleet import run as fleet_run
from greybox_lab.fleet.store import OF_RESULTS

LINUX = sys.platform.startswith("linux")
TIMES = ["cpu_s", "peak_mb"]


def tables(results):
    """Everything that was found, sorted, but for times."""
    found = {}
    for name in OF_RESULTS:
        table = pd.read_parquet(results / name).drop(columns=TIMES, errors="ignore")
        by = [own for own in ("key", "name", "effect") if own in table]
        found[name] = table.sort_values(by).to_json(orient="records", double_precision=15)
    return found


def begun(plan, out, *options):
    """The command, in a process that begins as processes do."""
    words = ["fleet", "run", plan, "--out", out, *options]
    code = "from greybox_id.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )


def below(root):
    """Number and command of all processes that one started, and those that did."""
    told = {}
    for path in Path("/proc").iterdir():
        if path.name.isdigit():
            with suppress(OSError, ValueError, IndexError):
                parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
                told[int(path.name)] = parent, (path / "cmdline").read_bytes().decode()
    found, layer = {}, [root]
    while layer:
        layer = [pid for pid, (parent, _) in told.items() if parent in layer]
        found |= {pid: told[pid][1] for pid in layer}
    return found


def results_of(out):
    """How many results there are, in the journal and in parts."""
    lines = sum(path.read_bytes().count(b"\n") for path in (out / "journal").glob("*.jsonl"))
    with suppress(OSError, ValueError):
        lines += len(pd.read_parquet(out / "recordings", columns=["key"]))
    return lines


def waited(process, until, seconds=240.0):
    """Wait until something holds while a process runs."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and process.poll() is None:
        found = until()
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError(process.communicate()[1] if process.poll() is not None else "it did not come so far")


@pytest.mark.slow
def test_two_at_a_time_find_the_same(fleet, tmp_path):
    plan, results, _ = fleet
    assert greybox("fleet", "run", plan, "--out", tmp_path / "R", "--jobs", 2, "--json").told["failed"] == 2
    assert tables(tmp_path / "R") == tables(results)


def test_a_missing_dask_is_a_sentence(fleet, tmp_path, monkeypatch):
    plan, _, _ = fleet
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert 'pip install "greybox-id[dask]"' in refused(
        "fleet", "run", plan, "--out", tmp_path / "R", "--engine", "dask"
    )


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_a_sentence(fleet, tmp_path):
    plan, _, _ = fleet
    where = ("--engine", "dask", "--scheduler", "tcp://127.0.0.1:9")
    assert "No scheduler of Dask answers at tcp://127.0.0.1:9" in refused(
        "fleet", "run", plan, "--out", tmp_path, *where
    )
    with pytest.raises(gb.BadInput, match="No scheduler"):
        fleet_run(plan, tmp_path / "R", engine="dask", scheduler="nonsense://127.0.0.1:9")


def test_workers_that_come_later_are_given_work_too(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(engines, "done", slowly)
    monkeypatch.setattr(engines, "ASKED", 0.0)
    quiet = {"processes": False, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    handed_out = 0

    def jobs():
        nonlocal handed_out
        for k in range(60):
            handed_out += 1
            yield json.dumps({"key": f"k{k}"})

    with distributed.LocalCluster(n_workers=1, **quiet) as cluster, distributed.Client(cluster) as client:
        engine = engines.Distributed(client, cluster.scheduler_address)
        assert engine.lacks == ""
        results = engine.results(jobs())
        found = [next(results)["key"]]
        assert handed_out == engines.AHEAD
        cluster.scale(3)
        client.wait_for_workers(3, timeout=60)
        found += [next(results)["key"], next(results)["key"]]
        assert handed_out == 3 * engines.AHEAD + 2  # what was returned, and four for each worker
        found += [result["key"] for result in results]
    assert sorted(found) == sorted(f"k{k}" for k in range(60))


def test_a_result_whose_worker_died_before_it_was_fetched_is_waited_for():
    """Dask calls it lost until another worker has it again; only what is cancelled never comes."""
    distributed = pytest.importorskip("distributed")
    quiet = {"processes": False, "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(n_workers=1, **quiet) as cluster, distributed.Client(cluster) as client:
        future = client.submit(slowly, json.dumps({"key": "k"}), pure=False)
        distributed.wait(future)
        future._state.lose()
        threading.Timer(0.3, client.loop.add_callback, [future._state.finish]).start()
        engine = engines.Distributed(client, None)
        assert future.status == "lost"
        assert engine._taken(future) == {"key": "k"}
        future.cancel()
        with pytest.raises(gb.BadInput, match="is gone"):
            engine._taken(future)


def test_a_scheduler_without_workers_is_told():
    distributed = pytest.importorskip("distributed")
    quiet = {"processes": False, "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(n_workers=0, **quiet) as cluster, distributed.Client(cluster) as client:
        where = cluster.scheduler_address
        assert (
            engines.Distributed(client, where).lacks == f"No worker is at {where} yet; start some: dask worker {where}"
        )


def slowly(job):
    time.sleep(0.05)
    return job


@pytest.mark.slow
@pytest.mark.skipif(not LINUX, reason="processes are looked for in /proc")
def test_a_local_run_that_is_killed_carries_on(fleet, tmp_path):
    plan, results, _ = fleet
    run = begun(plan, tmp_path / "R")
    waited(run, lambda: results_of(tmp_path / "R") >= 3)
    left = below(run.pid)
    run.kill()
    run.communicate()
    told = greybox("fleet", "run", plan, "--out", tmp_path / "R", "--json").told
    assert told["skipped"] >= 3
    assert told["done"] + told["skipped"] == 8
    assert tables(tmp_path / "R") == tables(results)
    assert left
    for pid in left:  # what it started ended with it
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.examination
@pytest.mark.slow
@pytest.mark.skipif(not LINUX, reason="processes are looked for in /proc")
def test_a_cluster_whose_worker_and_client_are_killed_finds_what_one_process_does(made_fleet, tmp_path):
    plan = made_fleet(tmp_path, vehicles=5, each=6)
    (tmp_path / "data" / "V3" / "cut.parquet").write_bytes(b"PAR1 and nothing more")
    alone, out = tmp_path / "alone", tmp_path / "R"
    assert greybox("fleet", "run", plan, "--out", alone, "--json").told["failed"] == 1
    options = ("--engine", "dask", "--jobs", 2)

    run = begun(plan, out, *options)
    waited(run, lambda: results_of(out) >= 5)
    workers = [pid for pid, words in below(run.pid).items() if "spawn_main" in words]
    assert len(workers) >= 2
    os.kill(workers[0], signal.SIGKILL)
    waited(run, lambda: results_of(out) >= 15)  # another worker took its place
    run.kill()
    run.communicate()

    run = begun(plan, out, *options)
    said = run.communicate(timeout=400)[1]
    assert run.returncode == 0, said
    assert "dashboard http://127.0.0.1:" in said
    assert pd.read_parquet(out / "recordings")["key"].is_unique
    assert len(pd.read_parquet(out / "recordings")) == 31
    assert tables(out) == tables(alone)
