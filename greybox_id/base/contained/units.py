"""Units of work in isolated processes with limits of time and memory; a crash of one affects nothing else.

A nursery is a process that imports the modules and forks a child for each unit of work. So a unit does not wait for
Python to start, sees no state of earlier units, and may crash, hang or exhaust memory. A nursery and its children end
with the process that started it. On systems that do not fork safely, the nursery does one unit itself and then ends.
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
"""Called with a job and a function that takes the unit's messages."""
PATIENCE = 2.0
"""Limit of wall-clock time over limit of CPU time of a unit, since the machine may be busy."""
SLACK = 60.0
"""s beyond a unit's wall-clock limit after which a silent nursery is assumed dead."""
LOOK = 0.05
"""s between checks of a child's memory."""
RESERVED = 4.0
"""Limit of reserved (virtual) memory over limit of resident memory: libraries reserve more than they use."""
ENDS = ("done", "time", "clock", "memory")
"""Outcomes after which a unit is not tried again."""
TRIES = 3
"""Attempts at a unit whose child was ended from outside."""
PDEATHSIG = 1
"""PR_SET_PDEATHSIG of Linux."""


@dataclass(frozen=True)
class Ended:
    """How a unit ended.

    Attributes
    ----------
    messages : the unit's messages, in order.
    how : "done"; "time", "clock" or "memory" if the limit of CPU time, wall-clock time or memory was reached; else the
        signal or error that ended it, in words.
    cpu_seconds : CPU time, including the unit's child processes.
    peak_mb : peak resident memory, MB, including the imported modules.
    """

    messages: list[dict[str, Any]] = field(default_factory=list)
    how: str = "done"
    cpu_seconds: float = 0.0
    peak_mb: float = 0.0


class Nursery:
    """Handle to a nursery; it does one unit at a time.

    Parameters
    ----------
    environment : environment variables of units, in addition to those of this process.
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
        work : module:function, see `Work`.
        job : plain data.
        seconds : limit of CPU time; that of wall-clock time is twice as long.
        memory : limit in bytes, beyond the memory of the imported modules.
        listen : called with each message of the unit as it arrives.

        Raises
        ------
        Broken : no nursery can be started, or it cannot begin units.
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
        """End the nursery for good, with the unit that it is doing; callable from any thread."""
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
            if self._over:  # closed by another thread meanwhile
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
    """The nursery's side of `Nursery.unit`: yields a unit's messages and returns the other attributes of `Ended`."""

    def unit(self, work: str, job: dict[str, Any], seconds: float, memory: float) -> Generator[Any, None, Any]:
        """Do a unit of work, in a forked child if the system forks safely."""
        return (_forked if FORKS else _here)(located(work), job, seconds, memory)


def _here(work: Work, job: dict[str, Any], seconds: float, memory: float) -> Generator[Any, None, Any]:
    """Do the unit in this process, which ends afterwards."""
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
    except Exception as error:  # any error that a damaged file causes is reported for that file
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
            os.killpg(child, signal.SIGKILL)  # processes that the child started
        _, status, used = os.wait4(child, 0)
    for name in end.get("modules", ()):  # so that the next child need not import them
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
    """Yield a child's messages until it ends or reaches a limit; return its final message, or {} without one."""
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
            elif 0 in ready:  # standard input closed: the parent has ended
                with suppress(ProcessLookupError):
                    os.killpg(child, signal.SIGKILL)
                os._exit(0)
            elif reading in ready:  # end of the pipe: the child has sent its final message
                select.select([ending], [], [], max(0.0, until - time.monotonic()))
                return end
            elif time.monotonic() > until:
                return {"how": "clock"}
            elif _resident(str(child)) - base > memory:
                return {"how": "memory"}
    finally:
        os.close(ending)


def _resident(process: str) -> float:
    """Resident memory of a process in bytes."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * float(os.sysconf("SC_PAGE_SIZE"))
    except (OSError, IndexError, ValueError):
        return 0.0
