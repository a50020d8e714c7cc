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
import sys
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import IO, Any, TypeAlias

from ..processes import FORKS
from .inside import limit, located
from .process import TIME, Broken, Contained, Failed, Lost

Work: TypeAlias = Callable[[dict[str, Any], Callable[[dict[str, Any]], None]], None]
"""Is handed a job and a function that takes what it tells."""
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
    messages : what it told, in order.
    how : "done"; "time", "clock" or "memory", where a limit was met: of the processor's time, by the clock, of memory;
        else the signal or error that ended it, in words.
    cpu_seconds : of the processor, its own children included.
    peak_mb : the most memory it held at a time, that of the imported modules included.
    """

    messages: list[dict[str, Any]] = field(default_factory=list)
    how: str = "done"
    cpu_seconds: float = 0.0
    peak_mb: float = 0.0


class Nursery:
    """A nursery as seen by whoever has work for it; one unit at a time.

    Parameters
    ----------
    environment : variables that units find besides those of this process.
    """

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        self._environment = environment
        self._held: Contained | None = None
        self._over = False

    def unit(
        self, work: str, job: Mapping[str, Any], seconds: float, memory: float,
        listen: Callable[[dict[str, Any]], None] = lambda _: None,
    ) -> Ended:  # fmt: skip
        """Do a unit of work.

        Parameters
        ----------
        work : module:function; it is called with the job and a function that takes what it tells.
        job : plain data.
        seconds : of the processor's time; twice as many by the clock.
        memory : bytes, beyond what the modules take.
        listen : is handed what it tells as it does.

        Raises
        ------
        Broken : no nursery can be started, or units cannot be begun in it.
        """
        ended = Ended(how="was not begun")
        for _ in range(TRIES):
            if self._over:
                break
            ended = self._tried((work, dict(job), seconds, memory), listen)
            if ended.how in ENDS:
                break
        return ended

    def close(self) -> None:
        """End it for good, and what it is at; from any thread."""
        self._over = True
        self._end()

    def _end(self) -> None:
        held, self._held = self._held, None
        if held is not None:
            held.close()

    def _tried(self, unit: tuple[str, dict[str, Any], float, float], listen: Callable[[dict[str, Any]], None]) -> Ended:
        heard: list[dict[str, Any]] = []

        def hear(body: dict[str, Any]) -> None:
            heard.append(body)
            listen(body)

        try:
            held = self._held
            if held is None or not held.alive:
                self._end()
                self._held = held = Contained("greybox_id.base.contained.units:Units", environment=self._environment)
            if self._over:  # meanwhile
                held.close()
            end, _ = held.ask("unit", *unit, patience=PATIENCE * unit[2] + SLACK, hear=hear)
        except Lost as error:
            self._end()
            return Ended(heard, "clock" if error.how == TIME else "its process was killed")
        except (Broken, Failed) as error:
            raise Broken(f"No work can be done here: {error}") from error
        if not FORKS:
            self._end()
        return Ended(heard, **end)


class Units:
    """What a nursery does, see `Nursery.unit`: yields what units tell, and returns the other attributes of `Ended`."""

    def unit(self, work: str, job: dict[str, Any], seconds: float, memory: float) -> Generator[Any, None, Any]:
        """A unit of work, in a child where processes can be forked."""
        return (_forked if FORKS else _here)(located(work), job, seconds, memory)


def _here(work: Work, job: dict[str, Any], seconds: float, memory: float) -> Generator[Any, None, Any]:
    """The unit in this very process, which ends after it."""
    messages: list[dict[str, Any]] = []
    began = time.process_time()
    limit(seconds, int(RESERVED * memory))
    how = _outcome(work, job, messages.append)
    yield from messages
    return {"how": how, "cpu_seconds": time.process_time() - began}


def _outcome(work: Work, job: dict[str, Any], tell: Callable[[dict[str, Any]], None]) -> str:
    try:
        work(job, tell)
    except MemoryError:
        return "memory"
    except Exception as error:  # whatever a damaged file leads to is told of that file
        return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return "done"


def _forked(work: Work, job: dict[str, Any], seconds: float, memory: float) -> Generator[Any, None, Any]:
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            _child(work, job, (seconds, int(RESERVED * memory)), writing)
        finally:
            os._exit(0)
    os.close(writing)
    try:
        end = yield from _followed(child, reading, PATIENCE * seconds, memory)
    finally:
        os.close(reading)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what it started itself
        _, status, used = os.wait4(child, 0)
    for name in end.get("modules", ()):  # the next child finds them imported
        with suppress(BaseException):
            import_module(name)
    how = end.get("how", "")
    if not how and os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        how = TIME if number == signal.SIGXCPU else f"ended by {signal.Signals(number).name}"
    peak = used.ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)
    return {"how": how or "ended without a message", "cpu_seconds": used.ru_utime + used.ru_stime, "peak_mb": peak}


def _child(work: Work, job: dict[str, Any], limits: tuple[float, int], writing: int) -> None:
    os.setsid()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PDEATHSIG, signal.SIGKILL)
    before = set(sys.modules)
    limit(*limits)
    with os.fdopen(writing, "wb", buffering=0) as out:

        def tell(body: dict[str, Any]) -> None:
            _write(out, {"told": body})

        how = _outcome(work, job, tell)
        _write(out, {"how": how, "modules": sorted(set(sys.modules) - before)})


def _write(out: IO[bytes], message: dict[str, Any]) -> None:
    data = memoryview(json.dumps(message).encode() + b"\n")
    while data:
        data = data[out.write(data) or 0 :]


def _followed(child: int, reading: int, patience: float, memory: float) -> Generator[Any, None, dict[str, Any]]:
    """What a child tells, until it ends or meets a limit; returns its last word, if there was one."""
    base, until = _resident("self"), time.monotonic() + patience
    ending, rest = os.pidfd_open(child), b""
    end: dict[str, Any] = {}
    try:
        while True:
            ready, _, _ = select.select([reading, ending, 0], [], [], LOOK)
            heard = os.read(reading, 1 << 20) if reading in ready else b""
            if heard:
                *lines, rest = (rest + heard).split(b"\n")
                for line in map(json.loads, lines):
                    if "told" in line:
                        yield line["told"]
                    else:
                        end = line
            elif ending in ready:
                return end
            elif 0 in ready:  # nobody asks any more
                with suppress(ProcessLookupError):
                    os.killpg(child, signal.SIGKILL)
                os._exit(0)
            elif reading in ready:  # its last word is said
                select.select([ending], [], [], max(0.0, until - time.monotonic()))
                return end
            elif time.monotonic() > until:
                return {"how": "clock"}
            elif _resident(str(child)) - base > memory:
                return {"how": "memory"}
    finally:
        os.close(ending)


def _resident(process: str) -> float:
    """Bytes of memory that a process holds."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * float(os.sysconf("SC_PAGE_SIZE"))
    except (OSError, IndexError, ValueError):
        return 0.0
