"""Work in a process of its own: what it may take is limited, and what ends it ends nothing else.

A nursery is a process that has imported what work needs and does none itself: it forks a child for each unit, so that
a unit costs no start of Python, finds nothing of the units before it, and may crash, hang or eat memory. It ends when
whoever started it does, and so do its children. Where a system does not fork safely, a nursery is its own only child.
"""

from __future__ import annotations

import ctypes
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from threading import Timer
from typing import Any

from ..datasets.readers.child import limit
from ..engine.compiler import CannotCompile, compiler
from ..errors import GreyboxError
from ..processes import FORKS

START = "import sys; sys.path[:] = {!r}; from greybox_id.fleet.contained import nursery; nursery()"
"""What a nursery runs: it finds modules where this process does, and imports no script of a user's."""
QUIET = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""A process that forks has no threads of its own; units run side by side."""
PATIENCE = 2.0
"""How many times as long as of the processor's time a unit may take by the clock, since a machine may be busy."""
SLACK = 60.0
"""s after which a nursery that should have answered is taken for dead."""
LOOK = 0.05
"""s between looks at a child's memory."""
RESERVED = 4.0
"""How many times the memory that a unit may fill it may reserve: libraries reserve more than they use."""
ENDS = ("done", "time", "clock", "memory")
"""How units end that are not tried again."""
TRIES = 3
"""A child that something from outside ended is tried so often."""
PDEATHSIG = 1
"""PR_SET_PDEATHSIG of Linux."""


@dataclass(frozen=True)
class Ended:
    """How a unit ended.

    Attributes
    ----------
    told : what it told, in order.
    how : "done"; "time", "clock" or "memory", where a limit was met: of the processor's time, by the clock, of memory;
        else the signal or error that ended it, in words.
    cpu_seconds : of the processor, its own children included.
    peak_mb : the most memory it held at a time, that of the imported modules included.
    """

    told: list[dict[str, Any]] = field(default_factory=list)
    how: str = "done"
    cpu_seconds: float = 0.0
    peak_mb: float = 0.0


class Broken(GreyboxError):
    """No nursery can be started here."""


class Nursery:
    """A nursery as seen by whoever has work for it; one unit at a time."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._over = False

    def unit(self, work: str, job: Mapping[str, Any], seconds: float, memory: float) -> Ended:
        """Do a unit of work.

        Parameters
        ----------
        work : module:function; it is called with the job and a function that takes what it tells.
        job : plain data.
        seconds : of the processor's time; twice as many by the clock.
        memory : bytes, beyond what the modules take.

        Raises
        ------
        Broken : no nursery can be started, or units cannot be begun in it.
        """
        ended = Ended(how="was not begun")
        for _ in range(TRIES):
            ended = self._tried(json.dumps({"work": work, "job": job, "seconds": seconds, "memory": memory}), seconds)
            if ended.how == "broken":
                raise Broken(f"No work can be done here: {ended.told[0]['broken']}")
            if ended.how in ENDS or self._over:
                break
        return ended

    def close(self) -> None:
        """End it for good, and what it is at; from any thread."""
        self._over = True
        self._end()

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    with suppress(OSError):
                        stream.close()
            process.wait()

    def _tried(self, line: str, seconds: float) -> Ended:
        process = self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        watch = Timer(PATIENCE * seconds + SLACK, process.kill)
        watch.daemon = True
        watch.start()
        try:
            process.stdin.write(line.encode() + b"\n")
            process.stdin.flush()
            answer = process.stdout.readline()
            if not answer.endswith(b"\n"):
                raise EOFError
        except (OSError, EOFError, ValueError):
            late = watch.finished.is_set()
            self._end()
            return Ended(how="clock" if late else "its process was killed")
        finally:
            watch.cancel()
        if not FORKS:
            self._end()
        return Ended(**json.loads(answer))

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._process.poll() is None:
            return self._process
        self._end()
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", START.format(sys.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **QUIET},
                start_new_session=True,  # Ctrl-C of a terminal is for who started it
            )
        except OSError as error:
            raise Broken(f"No process can be started: {error.strerror}. Close some, and run it again.") from error
        return self._process


def nursery() -> None:
    """Serve units, one line each, until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _compile()
    answers = os.dup(1)
    os.dup2(2, 1)  # libraries print where they like
    with os.fdopen(answers, "wb", buffering=0) as out, os.fdopen(os.dup(0), "rb", buffering=0) as asked:
        while line := asked.readline():
            order = json.loads(line)
            try:
                work = _found(order["work"])
            except Exception as error:
                body: dict[str, Any] = {"told": [{"broken": f"{type(error).__name__}: {error}"}], "how": "broken"}
            else:
                body = _forked(work, order, asked.fileno()) if FORKS else _here(work, order)
            out.write(json.dumps(body).encode() + b"\n")


def _compile() -> None:
    """Run kernels as compiled C from the first call on, where there is a compiler: its cost is that of one fit."""
    if not os.environ.get("GREYBOX_COMPILE"):
        with suppress(CannotCompile):
            compiler()
            os.environ["GREYBOX_COMPILE"] = "1"


def _found(place: str) -> Callable[..., None]:
    module, _, name = place.partition(":")
    found: Callable[..., None] = getattr(import_module(module), name)
    return found


def _here(work: Callable[..., None], order: Mapping[str, Any]) -> dict[str, Any]:
    """The unit in this very process, which ends after it."""
    told: list[dict[str, Any]] = []
    began = time.process_time()
    limit(order["seconds"], int(RESERVED * order["memory"]))
    how = _outcome(work, order["job"], told.append)
    return {"told": told, "how": how, "cpu_seconds": time.process_time() - began, "peak_mb": 0.0}


def _outcome(work: Callable[..., None], job: Mapping[str, Any], tell: Callable[[dict[str, Any]], None]) -> str:
    try:
        work(job, tell)
    except MemoryError:
        return "memory"
    except Exception as error:  # whatever a damaged file leads to is told of that file
        return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return "done"


def _forked(work: Callable[..., None], order: Mapping[str, Any], asked: int) -> dict[str, Any]:
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            _child(work, order, writing)
        finally:
            os._exit(0)
    os.close(writing)
    watch = _Watch(child, reading, asked, order)
    try:
        return watch.body()
    finally:
        os.close(reading)


def _child(work: Callable[..., None], order: Mapping[str, Any], writing: int) -> None:
    os.setsid()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    before = set(sys.modules)
    limit(order["seconds"], int(RESERVED * order["memory"]))
    with os.fdopen(writing, "wb", buffering=0) as out:

        def tell(body: dict[str, Any]) -> None:
            data = memoryview(json.dumps({"told": body}).encode() + b"\n")
            while data:
                data = data[out.write(data) or 0 :]

        how = _outcome(work, order["job"], tell)
        out.write(json.dumps({"how": how, "modules": sorted(set(sys.modules) - before)}).encode() + b"\n")


class _Watch:
    """A nursery's eye on its child: what it tells, when it ends, what it takes."""

    def __init__(self, child: int, reading: int, asked: int, order: Mapping[str, Any]) -> None:
        self._child, self._reading, self._asked = child, reading, asked
        self._seconds, self._memory = float(order["seconds"]), float(order["memory"])
        self._base = _resident("self")
        self._heard = b""

    def body(self) -> dict[str, Any]:
        how = self._followed()
        with suppress(ProcessLookupError):
            os.killpg(self._child, signal.SIGKILL)  # what it started itself
        _, status, used = os.wait4(self._child, 0)
        cpu, peak = used.ru_utime + used.ru_stime, used.ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)
        told: list[dict[str, Any]] = []
        end: dict[str, Any] = {}
        for line in self._heard.split(b"\n")[:-1]:
            said = json.loads(line)
            if "told" in said:
                told.append(said["told"])
            else:
                end = said
        for name in end.get("modules", ()):  # the next child finds them imported
            with suppress(BaseException):
                import_module(name)
        if not how:
            how = end.get("how", "")
        if not how and os.WIFSIGNALED(status):
            number = os.WTERMSIG(status)
            how = "time" if number == signal.SIGXCPU else f"ended by {signal.Signals(number).name}"
        return {"told": told, "how": how or "ended without a word", "cpu_seconds": cpu, "peak_mb": peak}

    def _followed(self) -> str:
        """Hear the child until it ends or meets a limit; "" or the limit."""
        until = time.monotonic() + PATIENCE * self._seconds
        ending = os.pidfd_open(self._child)
        try:
            while True:
                ready, _, _ = select.select([self._reading, ending, self._asked], [], [], LOOK)
                if self._reading in ready:
                    heard = os.read(self._reading, 1 << 20)
                    self._heard += heard
                    if heard:
                        continue
                if ending in ready:
                    return ""
                if self._asked in ready:  # nobody is there any more
                    with suppress(ProcessLookupError):
                        os.killpg(self._child, signal.SIGKILL)
                    os._exit(0)
                if self._reading in ready:  # its last word is said
                    select.select([ending], [], [], max(0.0, until - time.monotonic()))
                    return ""
                if time.monotonic() > until:
                    return "clock"
                if _resident(str(self._child)) - self._base > self._memory:
                    return "memory"
        finally:
            os.close(ending)


def _resident(process: str) -> float:
    """Bytes of memory that a process holds."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * float(os.sysconf("SC_PAGE_SIZE"))
    except (OSError, IndexError, ValueError):
        return 0.0
