"""Killed at any moment, a command that writes leaves the old files or the new ones, whole."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from driven import driven, written

from greybox_id.base.files import NAME
from greybox_id.fitting.saved_fit import load
from greybox_id.models.registry import build

LINUX = sys.platform.startswith("linux")
KILLS = int(os.environ.get("GREYBOX_KILLS", "6"))
"""For each command."""
CALLS = {
    "predict": "predict {fit} {lap} --out {out}/lap.csv",
    "simulate": "simulate {fit} {lap} --out {out}/lap.csv",
    "convert to csv": "data convert {lap} --out {out}/lap.csv --overwrite",
    "convert to hdf5": "data convert {lap} --out {out}/lap.h5 --overwrite",
    "convert to mat": "data convert {lap} --out {out}/lap.mat --overwrite",
    "track": "track {lap} --vehicle {car} --model lateral --tune 0s --out {out}/lap.csv --figures {out} --apply "
    "{out}/tuned.toml",
    "report": "report {fit} --out {out}/report.html --figures {out}/figures",
    "sample": "sample {fit} --method laplace --draws 50 --out {out}/posterior.parquet",
    "fit": "fit --model lateral --vehicle {car} --horizon 1 --solver gauss-newton {lap} --out {out}",
    **{f"export to {own}": f"export {{fit}} --target {own} --out {{out}}/car" for own in ("c", "fmu")},
    "make": "datasets make virtual_lap --seed {seed} --out {out}",
}  # fmt: skip
"""All targets of an export are written by one function: a folder of sources and of binaries stand for them."""


pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def versions(tmp_path_factory, made_files):
    """Two sets of files to read: calls on one or the other write different results."""
    return [made_files(tmp_path_factory.mktemp("read"), seed) | {"seed": 5} for seed in (1, 2)]


def run(call, after=None, sent=signal.SIGKILL, told=subprocess.DEVNULL):
    """Call a command in a process that begins as processes do, kill it so many seconds after the interpreter stands.

    Returns its exit status and what it took of the processor's time after it was killed, s.
    """
    stands, writing = os.pipe()
    code = f"import os; os.close({writing}); from greybox_id.cli import main; main()"
    command = [sys.executable, "-c", code, *call.split()]
    child, spent = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=told, pass_fds=(writing,)), 0.0
    os.close(writing)
    with open(stands, "rb") as pipe:
        pipe.read()  # until the interpreter closes it
    if after is not None:
        until, ended = time.monotonic() + after, os.WEXITED | os.WNOWAIT | os.WNOHANG
        while time.monotonic() < until and os.waitid(os.P_PID, child.pid, ended) is None:
            time.sleep(0.002)
        spent = spent_by(child.pid)
        os.kill(child.pid, sent)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    return status, used.ru_utime + used.ru_stime - spent


def spent_by(process):
    """Seconds of the processor's time, its own, of children that ended and of those at work."""
    folder = Path(f"/proc/{process}")
    told = (folder / "stat").read_text().rpartition(")")[2].split()
    alive = [int(own) for task in folder.glob("task/*/children") for own in task.read_text().split()]
    return sum(map(int, told[11:15])) / os.sysconf("SC_CLK_TCK") + sum(map(spent_by, alive))


def seen(folder):
    """Visible file -> content; of a fit, whether it is whole."""
    files = {path.relative_to(folder): path for path in folder.rglob("*") if path.is_file()}
    return {str(name): content(own) for name, own in files.items() if not any(p.startswith(".") for p in name.parts)}


def content(file):
    """Bytes, without those that say when they were written; of a fit, that it is whole."""
    if file.name == "fit.json":
        load(file, build)
        return b"whole"
    if file.suffix == ".parquet":  # a posterior also tells what it cost
        return pd.read_parquet(file).to_csv().encode()
    return file.read_bytes()[128 if file.suffix == ".mat" else 0 :]


@pytest.mark.slow
@pytest.mark.skipif(not LINUX, reason="/proc tells what processes spend")
@pytest.mark.parametrize("name", CALLS)
def test_a_killed_command_leaves_the_old_files_or_the_new_ones(name, versions, tmp_path):
    out, rng = tmp_path / "out", random.Random(name)
    calls = [CALLS[name].format(out=out, **version) for version in versions]
    results, seconds = [], []
    for call in calls:
        clock = time.monotonic()
        assert run(call)[0] == 0
        seconds.append(time.monotonic() - clock)
        results.append(seen(out))
    killed, before = 0, results[-1]
    for k in range(20 * KILLS):
        status, _ = run(calls[k % 2], after=rng.uniform(0, 1.1 * min(seconds)))
        killed += status == signal.SIGKILL
        now = seen(out)
        assert now.keys() == before.keys()
        for file, content in now.items():
            assert content in [result[file] for result in results], f"{file} after kill {k}"
        if name.startswith("export"):
            assert now in results
        before = now
        if killed == KILLS:
            break
    assert killed == KILLS
    assert run(calls[0])[0] == 0
    assert seen(out) == results[0]
    left = [path for path in tmp_path.rglob(".*") if NAME.fullmatch(path.name)]
    assert left == []


LONG = {
    "fit": "fit --model single_track --vehicle {car} {lap} --starts 30 --out {out}",
    "fit in two processes": "fit --model single_track --vehicle {car} {lap} --starts 30 --jobs 2 --out {out}",
    "profile": "profile {fit} --all --out {out}/curve.csv",
    "track": "track {lap} --vehicle {car} --out {out}/lap.csv",
    "check": "data check {lap}",
    "gap": "gap {lap} --vehicle {car} --out {out}",
    "gap for the first time": "gap {lap} --vehicle {car} --out {out}",
    "exam": "exam make --cases 5 --seed 3 --out {out}",
}


@pytest.fixture(scope="module")
def long(tmp_path_factory, versions):
    """A lap of 60 s, and a fit of a small part of it."""
    lap = written(driven("single_track", runs=1, seconds=60.0, seed=4), tmp_path_factory.mktemp("long") / "lap.csv")
    return {"lap": lap, "car": versions[0]["car"], "fit": versions[0]["fit"]}


@pytest.mark.slow
@pytest.mark.skipif(not LINUX, reason="/proc tells what processes spend")
@pytest.mark.parametrize("name", LONG)
def test_ctrl_c_ends_a_command_within_two_seconds(name, long, tmp_path, monkeypatch):
    if name not in ("profile", "check", "gap", "exam"):  # as users have it
        monkeypatch.setenv("GREYBOX_COMPILE", "1")
    rng, processors = random.Random(name), 2 if "two processes" in name else 1
    for k in range(max(2, KILLS // 2)):
        call = LONG[name].format(out=tmp_path / str(k), **long)
        latest = 6.0
        if name == "gap for the first time":  # both compilers take seconds
            monkeypatch.setenv("GREYBOX_CACHE", str(tmp_path / f"kernels{k}"))
            monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / f"machine_code{k}"))
            latest = 12.0
        errors = tmp_path / f"errors{k}"
        with open(errors, "wb") as told:
            status, spent = run(call, after=rng.uniform(0.2, latest), sent=signal.SIGINT, told=told)
        code = os.waitstatus_to_exitcode(status)
        assert code in (0, 130, -signal.SIGINT), (
            errors.read_text()
        )  # the last while modules are imported, or the interpreter ends
        assert spent < 2.0 * processors or code == 0  # a command that had ended was not interrupted
        assert not [path for path in tmp_path.rglob(".*") if NAME.fullmatch(path.name)]
