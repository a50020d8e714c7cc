"""Engines: who has units done, here or on other machines. Both call the same function and return the same results."""

from __future__ import annotations

import atexit
import json
import math
import os
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import lru_cache
from itertools import islice
from multiprocessing import active_children
from queue import SimpleQueue
from typing import Any, Protocol

from greybox_id.base.contained.units import PATIENCE, Nursery
from greybox_id.base.errors import BadInput
from greybox_id.engine.compiler import CannotCompile, compiler

from .statuses import FAILED, MEMORY, TIMEOUT
from .unit import MADE_BY

RETRIES = 2
"""How often a unit is given to another worker when its own one died."""
AHEAD = 4
"""Units handed out per worker: enough that none waits, few enough that a long list takes no memory."""
ASKED = 2.0
"""s after which it is asked again how many workers of Dask there are; it costs a message."""
WORK = "greybox_lab.fleet.unit:worked"

_held = threading.local()


class Engine(Protocol):
    """Who has units done."""

    address: str
    """Of its dashboard; "" where it has none."""
    lacks: str
    """What it waits for before it can begin, in a sentence; "" where there is nothing."""

    def results(self, jobs: Iterator[str]) -> Iterator[dict[str, Any]]:
        """What comes of jobs, as it comes."""


def done(job: str) -> str:
    """A unit of work as engines hand it out: JSON in, JSON out. It never fails over a recording.

    Parameters
    ----------
    job : path, key and so on as `unit.worked` takes them, with `seconds` and `memory`.

    Returns
    -------
    str
        What it told, merged: columns of the row of the recording, rows of other tables.

    Raises
    ------
    Broken : no process can be started on this machine.
    """
    body = json.loads(job)
    ended = _nursery().unit(WORK, body, body["seconds"], body["memory"])
    result: dict[str, Any] = {}
    for item in ended.messages:
        result |= item
    if ended.how != "done" or "status" not in result:
        result |= _not_done(ended.how, body, result)
    result |= {"key": body["key"], "cpu_s": ended.cpu_seconds, "peak_mb": ended.peak_mb, "version": MADE_BY}
    return json.dumps(result)


def _not_done(how: str, job: Mapping[str, Any], result: Mapping[str, Any]) -> dict[str, str]:
    """Status and sentence of a recording that was not done."""
    at = _step(job["steps"], result)
    if how == "time":
        allowed = f"{job['seconds']:g} s of the processor's time"
        return {"status": TIMEOUT, "sentence": f"{at} took more than {allowed}; raise limits.seconds, or crop it."}
    if how == "clock":
        allowed = f"{PATIENCE * job['seconds']:g} s by the clock"
        why = "the work hangs, or the machine is busy"
        return {"status": TIMEOUT, "sentence": f"{at} took more than {allowed}: {why}; raise limits.seconds."}
    if how == "memory":
        allowed = f"{job['memory'] / 1e6:.0f} MB"
        return {
            "status": MEMORY,
            "sentence": f"{at} took more than {allowed} of memory; raise limits.memory, or crop it.",
        }
    return {"status": FAILED, "sentence": f"{at} ended without a result ({how:.200})."}


def _step(steps: Sequence[str], result: Mapping[str, Any]) -> str:
    """What was at work, told from what was found before."""
    results = {"check": "findings", "fit": "parameters", "gap": "gaps"}
    if "rows" not in result:
        return "Reading"
    return next((f"The step {step}" for step in steps if results[step] not in result), "The last step")


def _nursery() -> Nursery:
    """The nursery of this thread."""
    if not hasattr(_held, "nursery"):
        _held.nursery = Nursery(_compiled())
        atexit.register(_held.nursery.close)
    result: Nursery = _held.nursery
    return result


@lru_cache
def _compiled() -> dict[str, str]:
    """Kernels run as compiled C from the first call on, where there is a compiler: its cost is that of one fit."""
    if not os.environ.get("GREYBOX_COMPILE"):
        with suppress(CannotCompile):
            compiler()
            return {"GREYBOX_COMPILE": "1"}
    return {}


class Local:
    """Units on this machine, in a few processes."""

    address = lacks = ""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def results(self, jobs: Iterator[str]) -> Iterator[dict[str, Any]]:
        """What comes of jobs, as it comes."""
        nurseries: SimpleQueue[Nursery] = SimpleQueue()

        def begin() -> None:
            nursery = Nursery(_compiled())
            _held.nursery = nursery
            nurseries.put(nursery)

        pool = ThreadPoolExecutor(self._jobs, initializer=begin)
        try:
            waiting: set[Future[str]] = set()
            for _ in range(AHEAD * self._jobs):
                _submit(pool, jobs, waiting)
            while waiting:
                ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for item in ready:
                    yield json.loads(item.result())
                    _submit(pool, jobs, waiting)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            while not nurseries.empty():
                nurseries.get().close()


def _submit(pool: ThreadPoolExecutor, jobs: Iterator[str], waiting: set[Future[str]]) -> None:
    job = next(jobs, None)
    if job is not None:
        waiting.add(pool.submit(done, job))


class Distributed:
    """Units on workers of Dask: of a cluster of this machine's, or of one that is there."""

    def __init__(self, client: Any, scheduler: str | None) -> None:
        self._client, self._scheduler = client, scheduler
        self._asked, self._workers = -math.inf, 1
        self.address = str(client.dashboard_link or "")
        self.lacks = ""
        if scheduler is not None and not client.nthreads():
            self.lacks = f"No worker is at {scheduler} yet; start some: dask worker {scheduler}"

    def results(self, jobs: Iterator[str]) -> Iterator[dict[str, Any]]:
        """What comes of jobs, as it comes."""
        from distributed import as_completed

        waiting: Any = as_completed(raise_errors=False)

        def hand_out() -> None:
            for job in islice(jobs, max(AHEAD * self._at_a_time() - waiting.count(), 0)):
                waiting.add(self._handed_out(job))

        hand_out()
        for item in waiting:
            yield self._taken(item)
            item.release()
            hand_out()

    def _at_a_time(self) -> int:
        """How many units its workers do at a time; they come and go, so it is asked now and then."""
        if time.monotonic() - self._asked > ASKED:
            with suppress(OSError, TimeoutError):  # a scheduler that is gone cancels what was handed out, which is told
                self._workers = max(1, sum(int(nthread) for nthread in self._client.nthreads().values()))
            self._asked = time.monotonic()
        return self._workers

    def _handed_out(self, job: str) -> Any:
        key = json.loads(job)["key"]
        return self._client.submit(done, job, key=f"greybox-{key}", retries=RETRIES, pure=False)

    def _taken(self, future: Any) -> dict[str, Any]:
        from distributed import CancelledError
        from distributed.scheduler import KilledWorker

        try:  # where its worker died before it was fetched, it is computed again and waited for
            result: dict[str, Any] = json.loads(future.result())
            return result
        except CancelledError as error:
            raise _gone(self._scheduler) from error
        except KilledWorker:
            return {
                "key": str(future.key).removeprefix("greybox-"), "status": FAILED, "version": MADE_BY, "cpu_s": None,
                "sentence": f"{RETRIES + 1} workers died on this recording; read their logs.", "peak_mb": None,
            }  # fmt: skip


def _gone(scheduler: str | None) -> BadInput:
    where = f"at {scheduler} " if scheduler else ""
    return BadInput(f"The scheduler {where}is gone. What was done is kept: start one, and run the same command again.")


@contextmanager
def engine(name: str, jobs: int, scheduler: str | None = None) -> Iterator[Engine]:
    """The engine of a name, "local" or "dask".

    Parameters
    ----------
    jobs : units at a time on this machine.
    scheduler : address of a scheduler of Dask whose workers do the work; None starts workers here.

    Raises
    ------
    BadInput : Dask is not installed, the scheduler does not answer, or its workers run another version.
    """
    if name == "local":
        yield Local(jobs)
        return
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise BadInput(
            'The engine dask needs Dask: pip install "greybox-id[dask]"; or use the engine local.'
        ) from error
    quiet = {"distributed.worker.memory.target": False, "distributed.worker.memory.spill": False,
             "distributed.worker.memory.pause": False, "distributed.worker.memory.terminate": False,
             "logging.distributed": "critical", "distributed.scheduler.allowed-failures": RETRIES + 1}  # fmt: skip
    with dask.config.set(quiet):
        if scheduler is not None:
            with _client(Client, scheduler) as client:
                _must_be_alike(client, scheduler)
                yield Distributed(client, scheduler)
            return
        with _cluster(LocalCluster, jobs) as cluster, Client(cluster) as client:
            yield Distributed(client, None)


@contextmanager
def _cluster(kind: Any, jobs: int) -> Iterator[Any]:
    """Workers on this machine, each a process; where their start is interrupted, none is left behind."""
    try:
        cluster = kind(
            n_workers=jobs, threads_per_worker=1, processes=True, memory_limit=None, dashboard_address="127.0.0.1:0",
            host="127.0.0.1", silence_logs=50,
        )  # fmt: skip
    except BaseException:
        from distributed.deploy.spec import close_clusters

        atexit.unregister(close_clusters)  # it cannot close what never was open
        for child in active_children():
            child.kill()
        raise
    with cluster:
        yield cluster


@contextmanager
def _client(kind: Any, scheduler: str) -> Iterator[Any]:
    try:
        client = kind(scheduler, timeout="10s", name="greybox-fleet")
    except (OSError, ValueError, TimeoutError) as error:
        raise BadInput(
            f"No scheduler of Dask answers at {scheduler}; start one (dask scheduler), or omit ‹scheduler›."
        ) from error
    try:
        yield client
    finally:
        client.close(timeout=5)


def _must_be_alike(client: Any, scheduler: str) -> None:
    """Refuse workers that would compute something else."""
    versions = client.run(_version)
    others = {version for version in versions.values() if version != MADE_BY}
    if others:
        raise BadInput(
            f"Workers of {scheduler} run greybox-id {', '.join(sorted(others))}, not {MADE_BY}; install the same "
            "version."
        )


def _version() -> str:
    return MADE_BY
