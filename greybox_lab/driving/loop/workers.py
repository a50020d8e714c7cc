"""Jobs of a server, in processes of their own: two at a time, each with a budget, gone with whoever started them."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

from greybox_id.base.contained.process import Broken
from greybox_id.base.contained.units import Nursery
from greybox_id.base.errors import BadInput

from .store import FAILED, QUEUED, TRAINING, Job, ServerStore

AT_ONCE = 2
MEMORY = 6 << 30
"""Bytes that a job may hold."""
WORK = "greybox_lab.driving.loop.work:worked"


class Workers:
    """The queue's hands.

    Parameters
    ----------
    store : where jobs are.
    tell : shows what happens, as `feed.Feed.tell`.
    """

    def __init__(self, store: ServerStore, tell: Callable[[Mapping[str, Any]], None]) -> None:
        self._store, self._tell = store, tell
        self._wake = asyncio.Event()
        self._nurseries = [Nursery() for _ in range(AT_ONCE)]
        self._free = list(self._nurseries)
        self._progress: dict[str, str] = {}
        self._unkept: set[str] = set()
        self._closed = False

    async def run(self) -> None:
        """Do jobs as they come; those that were under way when a server ended are begun anew."""
        under_way: dict[str, asyncio.Task[None]] = {}
        for job in self._store.jobs():
            if job.status == TRAINING:
                self._keep(replace(job, status=QUEUED))
        self._wake.set()
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                for job in await asyncio.to_thread(self._store.jobs):
                    if job.status == QUEUED and self._free and job.id not in {*under_way, *self._unkept}:
                        under_way[job.id] = asyncio.create_task(self._do(job, self._free.pop()))

                        def over(_: asyncio.Task[None], name: str = job.id) -> None:
                            del under_way[name]
                            self._wake.set()

                        under_way[job.id].add_done_callback(over)
        finally:
            for task in tuple(under_way.values()):
                task.cancel()

    def wake(self) -> None:
        """Look whether there is something to do."""
        self._wake.set()

    def progress(self, name: str) -> dict[str, Any]:
        """What a job that is under way is at."""
        return {"sentence": self._progress[name]} if name in self._progress else {}

    def close(self) -> None:
        """End all processes at once; their jobs stay as they are on disk."""
        self._closed = True
        for nursery in self._nurseries:
            nursery.close()

    async def _do(self, job: Job, nursery: Nursery) -> None:
        """Do a job, and write down what came of it."""
        job = replace(job, status=TRAINING)
        self._keep(job)
        try:
            failure = await self._carry_out(job, nursery)
            if not failure:
                self._announce(await asyncio.to_thread(self._store.finished, job))
                return
        except (BadInput, Broken, OSError) as error:
            failure = str(error)
        finally:
            self._progress.pop(job.id, None)
            self._free.append(nursery)
        if not self._closed:
            self._keep(replace(job, status=FAILED, sentence=failure))

    async def _carry_out(self, job: Job, nursery: Nursery) -> str:
        """Have it done; a sentence where it failed."""
        loop = asyncio.get_running_loop()

        def hear(body: Mapping[str, Any]) -> None:
            if "said" in body:
                with suppress(RuntimeError):  # the server has ended
                    loop.call_soon_threadsafe(self._progressed, job, str(body["said"]))

        order = {"folder": str(self._store.folder.resolve()), "job": job.id}
        ended = await asyncio.to_thread(nursery.unit, WORK, order, job.seconds, MEMORY, hear)
        if ended.how in ("time", "clock"):
            return f"The job's budget of {job.seconds:g} s is used up; ask for more seconds, or fewer steps."
        if ended.how == "memory":
            return f"More than {MEMORY >> 30} GB of memory would be needed; send fewer rows."
        if ended.how != "done":
            return f"Its process {ended.how:.400}; ask again."
        return next((str(body["failed"]) for body in ended.messages if "failed" in body), "")

    def _progressed(self, job: Job, sentence: str) -> None:
        self._progress[job.id] = sentence
        self._tell({"kind": "progress", "session": job.session, "id": job.id, "said": sentence})

    def _keep(self, job: Job) -> None:
        """Write down how far a job is; where that cannot be written, the job waits for the next start."""
        try:
            self._store.keep(job)
        except BadInput as error:
            self._unkept.add(job.id)
            self._progress[job.id] = f"Its progress cannot be written: {error}"
        self._announce(job)

    def _announce(self, job: Job) -> None:
        self._tell({"kind": "job", **job.shown(), "at": time.time()})
