"""Mutated files of every kind against the command line: no traceback, no hang, no flood of memory, no stray file.

    python benchmarks/hostile.py --cases 10000 --seed 0 [--jobs 2] [--json]

Sound files are damaged at random (bits, bytes, lengths, numbers, lines; checksums of fits are made good again), then
given to the command that reads them. A child process calls it, many files one after the other, in a folder of its own;
this process watches its time. Counted are how commands ended, and every case that breaks a bar:

- an exception that is no sentence, or an end of the process (exit codes 0, 1 and 2 are answers);
- more than 10 s for one file;
- more than 1 GB of resident memory;
- a file left elsewhere than where --out says.
"""

from __future__ import annotations

import gc
import io
import json
import multiprocessing
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from hostile_mutations import mutated
from hostile_seeds import KINDS, sound_files
from running import options

SECONDS = 10.0
"""Of the processor's time: the machine may be busy with something else."""
PATIENCE = 300.0
"""Seconds by the clock after which a case hangs, whatever it does."""
START = 30.0
"""Seconds of the processor's time that the first case of a process may take for modules it imports."""
MEMORY = 1e9
"""Bytes of resident memory; what the interpreter and its modules take is in it."""
ANSWERS = (0, 1, 2)
WHO = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
"""Some formats are read in a process of their own."""
REPORTED = 100
"""Files after which a line tells how far it is."""
PROPOSED = 16
"""One recording in so many is given to data map, which takes longest; the others to data convert and data check."""


@dataclass(frozen=True)
class Verdict:
    """How a case ended.

    Attributes
    ----------
    case, kind : which; a case and the seed make the file again.
    code : the command's exit code; None where it did not end by itself.
    broken : the bar it broke, in words; empty if none.
    seconds, peak : processor's time in s and highest resident memory so far in bytes, those of readers apart included.
    """

    case: int
    kind: str
    code: int | None
    broken: str
    seconds: float
    peak: float


def command(kind: str, file: Path, seeds: dict[str, Path], case: int) -> list[str]:
    """The command that reads a damaged file; what it writes goes to the folder out."""
    lap = str(seeds["csv"])
    if kind == "columns":
        return ["data", "check", lap, "--columns", str(file)]
    if kind == "vehicle":
        return ["models", "lateral", "--vehicle", str(file)]
    if kind == "fit":
        return ["predict", str(file), lap, "--out", "out/predicted.csv"]
    if case % PROPOSED == 0:
        return ["data", "map", str(file), "--out", "out/map.toml"]
    return ["data", "convert", str(file), "--out", "out/lap.csv"] if case % 2 else ["data", "check", str(file)]


def name_of(kind: str) -> str:
    """What a damaged file is called."""
    named = {"columns": "map.toml", "vehicle": "vehicle.toml", "fit": "fit.json", "mat73": "lap.mat"}
    return named.get(kind, f"lap.{kind}")


def worker(link: Connection, seeds: dict[str, Path], place: Path, seed: int) -> None:
    """Calls the command for each case that comes over the link."""
    for name in ("out", "tmp", "cache"):
        (place / name).mkdir(parents=True, exist_ok=True)
    os.environ |= {"TMPDIR": str(place / "tmp"), "GREYBOX_CACHE": str(place / "cache"), "HOME": str(place)}
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "MPLCONFIGDIR": str(place / "cache")}
    tempfile.tempdir = None
    os.chdir(place)
    from greybox_id.cli import main

    while (case := link.recv()) is not None:
        kind = KINDS[case % len(KINDS)]
        file = place / name_of(kind)
        file.write_bytes(mutated(seeds[kind].read_bytes(), kind, seed, case))
        began = _used()
        code, broken = called(main, command(kind, Path(file.name), seeds, case // len(KINDS)))
        gc.collect()  # what reads apart ends with what was read
        seconds = _used() - began
        file.unlink(missing_ok=True)
        shutil.rmtree(place / "out")
        (place / "out").mkdir()
        stray = [str(own.relative_to(place)) for own in place.rglob("*") if not own.is_relative_to(place / "cache")]
        stray = [name for name in stray if name not in ("out", "tmp", "cache")]
        if stray and not broken:
            broken = f"left {stray[:3]}"
        link.send(Verdict(case, kind, code, broken, seconds, _peak()))


def _peak() -> float:
    """Bytes of resident memory that this process or one it waited for has had at most.

    The system's own count for a process begins with what its parent held when it started it, so it is no use for this
    one: a large parent would be counted.
    """
    apart = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 1024.0 * max(apart, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    own = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
    return 1024.0 * max(apart, own)


def _used() -> float:
    """Seconds of the processor's time that this process and those it waited for have had; the machine may be busy."""
    return sum(spent.ru_utime + spent.ru_stime for spent in map(resource.getrusage, WHO))


def called(main: object, arguments: Sequence[str]) -> tuple[int | None, str]:
    """Exit code of a command called in this process, and the exception that came out of it; empty if none did."""
    assert callable(main)
    before, sys.argv = sys.argv, ["greybox", *arguments]
    out, err = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(err):
            main()
    except SystemExit as end:
        code = int(end.code or 0)
        strange = code not in ANSWERS or "Traceback" in err.getvalue()
        return code, f"exit code {code}: {err.getvalue()[-300:]}" if strange else ""
    except BaseException as error:
        line = traceback.extract_tb(error.__traceback__)[-1]
        return None, f"{type(error).__name__}: {str(error)[:120]} ({Path(line.filename).name}:{line.lineno})"
    finally:
        sys.argv = before
    return 0, ""


def examined(cases: Sequence[int], seed: int, seeds: dict[str, Path], place: Path) -> Iterator[Verdict]:
    """The verdicts on cases, by one child at a time; a child that hangs or dies is replaced."""
    context = multiprocessing.get_context("spawn")
    left = list(cases)
    while left:
        near, far = context.Pipe()
        child = context.Process(target=worker, args=(far, seeds, place, seed), daemon=True)
        child.start()
        far.close()
        first = True
        try:
            while left:
                case = left[0]
                kind = KINDS[case % len(KINDS)]
                near.send(case)
                verdict = near.recv() if _answers(near, child.pid or 0, first) else None
                left.pop(0)
                if verdict is None:
                    yield Verdict(case, kind, None, f"hangs for more than {SECONDS:g} s", SECONDS, 0.0)
                    break
                if not verdict.broken and verdict.seconds > SECONDS and not first:
                    verdict = Verdict(case, kind, verdict.code, "took too long", verdict.seconds, verdict.peak)
                if not verdict.broken and verdict.peak > MEMORY:
                    broken = f"{verdict.peak / 1e9:.2f} GB of memory"
                    yield Verdict(case, kind, verdict.code, broken, verdict.seconds, verdict.peak)
                    break
                yield verdict
                first = False
            else:
                near.send(None)
        except (EOFError, ConnectionError):
            child.join(5)
            yield Verdict(case, kind, None, f"the process ended with {child.exitcode}", 0.0, 0.0)
            left = [own for own in left if own != case]
        finally:
            child.kill()
            child.join()
            shutil.rmtree(place, ignore_errors=True)


def _answers(link: Connection, pid: int, first: bool) -> bool:
    """Whether an answer comes before the time is over."""
    began, used = time.monotonic(), _processor_time(pid)
    while not link.poll(0.5):
        spent, waited = _processor_time(pid) - used, time.monotonic() - began
        if spent > SECONDS + START * first or waited > PATIENCE:
            return False
    return True


def _processor_time(pid: int) -> float:
    """Seconds of the processor that a process and those it waited for have had; 0 where the system does not tell."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def run(cases: int, seed: int, jobs: int = 1, first: int = 0) -> list[Verdict]:
    """All verdicts, by case, from the first one on."""
    with tempfile.TemporaryDirectory() as folder:
        seeds = sound_files(Path(folder) / "sound")

        def share(job: int) -> list[Verdict]:
            done = []
            for verdict in examined(range(first + job, first + cases, jobs), seed, seeds, Path(folder) / f"job {job}"):
                done.append(verdict)
                if verdict.broken or len(done) % REPORTED == 0:
                    sys.stderr.write(f"job {job}: {len(done)} files; {verdict.case} {verdict.broken or 'is sound'}\n")
            return done

        (Path(folder) / "sound").mkdir(exist_ok=True)
        with ThreadPoolExecutor(jobs) as pool:
            found = [verdict for part in pool.map(share, range(jobs)) for verdict in part]
    return sorted(found, key=lambda verdict: verdict.case)


def main() -> int:
    """Run the benchmark; exit code 1 if a bar was broken."""
    given = options(
        __doc__, cases=10_000, seed=0, jobs=1,
        first={"type": int, "default": 0, "help": "number of the first case: --first 8967 --cases 1"},
    )  # fmt: skip
    found = run(given.cases, given.seed, given.jobs, given.first)
    broken = [verdict for verdict in found if verdict.broken]
    if given.json:
        sys.stdout.write(json.dumps({"cases": len(found), "broken": [asdict(own) for own in broken]}, indent=1) + "\n")
        return bool(broken)
    ends = Counter((verdict.kind, verdict.code) for verdict in found)
    for kind in KINDS:
        codes = ", ".join(f"{ends[kind, code]} with {code}" for code in (0, 1, 2, None) if ends[kind, code])
        own = [verdict for verdict in found if verdict.kind == kind]
        longest = max((verdict.seconds for verdict in own), default=0.0)
        wrong = sum(bool(verdict.broken) for verdict in own)
        sys.stdout.write(f"{kind:8} {len(own):5} files, ended {codes}; longest {longest:.1f} s; broken {wrong}\n")
    peak = max(verdict.peak for verdict in found)
    sys.stdout.write(f"{len(found)} files, {len(broken)} broke a bar; highest memory {peak / 1e6:.0f} MB\n")
    for verdict in broken[:40]:
        sys.stdout.write(f"  case {verdict.case} ({verdict.kind}): {verdict.broken}\n")
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
