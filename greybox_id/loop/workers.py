"""Jobs of a server, in processes of their own: two at a time, each with a budget, gone with whoever started them."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

from ..errors import BadInput
from ..fleet.contained import QUIET
from .store import FAILED, QUEUED, TRAINING, Job, ServerStore

AT_ONCE = 2
PATIENCE, SLACK = 3.0, 60.0
"""How many times its budget of the processor's time a job may take by the clock, and s besides for imports."""
START = "import sys; sys.path[:] = {!r}; from greybox_id.loop.work import main; main()"
"""What a job's process runs: it finds modules where this process does."""


class Workers:
    """The queue's hands.

    Parameters
    ----------
    store : where jobs are.
    tell : told of what happens, as `live.Feed.tell`.
    """

    def __init__(self, store: ServerStore, tell: Callable[[Mapping[str, Any]], None]) -> None:
        self._store, self._tell = store, tell
        self._wake = asyncio.Event()
        self._processes: dict[str, asyncio.subprocess.Process] = {}
        self._said: dict[str, str] = {}

    async def run(self) -> None:
        """Do jobs as they come; those that were under way when a server ended are begun anew."""
        under_way: set[asyncio.Task[None]] = set()
        at_work: set[str] = set()
        for job in self._store.jobs():
            if job.status == TRAINING:
                self._store.keep(replace(job, status=QUEUED))
        self._wake.set()
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                for job in self._store.jobs():
                    if job.status == QUEUED and len(at_work) < AT_ONCE and job.id not in at_work:
                        at_work.add(job.id)
                        task = asyncio.create_task(self._done(job))
                        under_way.add(task)

                        def over(own: asyncio.Task[None], name: str = job.id) -> None:
                            under_way.discard(own)
                            at_work.discard(name)
                            self._wake.set()

                        task.add_done_callback(over)
        finally:
            for task in under_way:
                task.cancel()

    def wake(self) -> None:
        """Look whether there is something to do."""
        self._wake.set()

    def progress(self, own: str) -> dict[str, Any]:
        """What a job that is under way said last."""
        return {"sentence": self._said[own]} if own in self._said else {}

    def kill(self) -> None:
        """End all processes at once; their jobs stay as they are on disk."""
        for process in self._processes.values():
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)

    async def _done(self, job: Job) -> None:
        """Do a job, and write down what came of it."""
        self._keep(replace(job, status=TRAINING))
        try:
            failed = await self._carried_out(job)
            if not failed:
                self._announce(await asyncio.to_thread(self._store.finished, job.id))
                return
        except (BadInput, OSError) as error:
            failed = str(error)
        finally:
            self._said.pop(job.id, None)
        self._keep(replace(job, status=FAILED, sentence=failed))

    async def _carried_out(self, job: Job) -> str:
        """Run its process; a sentence where it failed."""
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-c", START.format(sys.path), str(self._store.folder.resolve()), job.id,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
            env={**os.environ, **QUIET}, start_new_session=True, limit=1 << 20,
        )  # fmt: skip
        self._processes[job.id] = process
        failed = ""
        try:
            async with asyncio.timeout(PATIENCE * job.seconds + SLACK):
                assert process.stdout is not None
                async for line in process.stdout:
                    said = json.loads(line)
                    failed = str(said.get("failed", failed))
                    if "said" in said:
                        self._said[job.id] = str(said["said"])
                        self._tell({"kind": "progress", "session": job.session, "id": job.id, "said": said["said"]})
                code = await process.wait()
        except TimeoutError:
            return (
                f"It was not done after {PATIENCE * job.seconds + SLACK:.0f} s; ask for fewer steps, or more seconds."
            )
        except ValueError:
            return "Its process said what nobody understands."
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            del self._processes[job.id]
        if failed or code == 0:
            return failed
        if code == -signal.SIGXCPU:
            return f"Its budget of {job.seconds:g} s was over; ask for more seconds, or fewer steps."
        return f"Its process ended with {signal.Signals(-code).name if code < 0 else code}; ask again."

    def _keep(self, job: Job) -> None:
        self._store.keep(job)
        self._announce(job)

    def _announce(self, job: Job) -> None:
        told = job.told()
        self._tell({"kind": "job", **{name: told[name] for name in ("id", "session", "arm", "status", "sentence")},
                    "result": told["result"], "at": time.time()})  # fmt: skip
