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
    tell : told of what happens, as `live.Feed.tell`.
    """

    def __init__(self, store: ServerStore, tell: Callable[[Mapping[str, Any]], None]) -> None:
        self._store, self._tell = store, tell
        self._wake = asyncio.Event()
        self._nurseries = [Nursery() for _ in range(AT_ONCE)]
        self._free = list(self._nurseries)
        self._said: dict[str, str] = {}

    async def run(self) -> None:
        """Do jobs as they come; those that were under way when a server ended are begun anew."""
        under_way: dict[str, asyncio.Task[None]] = {}
        for job in self._store.jobs():
            if job.status == TRAINING:
                self._store.keep(replace(job, status=QUEUED))
        self._wake.set()
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                for job in self._store.jobs():
                    if job.status == QUEUED and self._free and job.id not in under_way:
                        under_way[job.id] = asyncio.create_task(self._done(job, self._free.pop()))

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

    def progress(self, own: str) -> dict[str, Any]:
        """What a job that is under way said last."""
        return {"sentence": self._said[own]} if own in self._said else {}

    def kill(self) -> None:
        """End all processes at once; their jobs stay as they are on disk."""
        for nursery in self._nurseries:
            nursery.close()

    async def _done(self, job: Job, nursery: Nursery) -> None:
        """Do a job, and write down what came of it."""
        self._keep(replace(job, status=TRAINING))
        try:
            failed = await self._carried_out(job, nursery)
            if not failed:
                self._announce(await asyncio.to_thread(self._store.finished, job.id))
                return
        except (BadInput, Broken, OSError) as error:
            failed = str(error)
        finally:
            self._said.pop(job.id, None)
            self._free.append(nursery)
        self._keep(replace(job, status=FAILED, sentence=failed))

    async def _carried_out(self, job: Job, nursery: Nursery) -> str:
        """Have it done; a sentence where it failed."""
        loop = asyncio.get_running_loop()

        def told(body: Mapping[str, Any]) -> None:
            if "said" in body:
                with suppress(RuntimeError):  # the server has ended
                    loop.call_soon_threadsafe(self._progressed, job, str(body["said"]))

        order = {"folder": str(self._store.folder.resolve()), "job": job.id}
        ended = await asyncio.to_thread(nursery.unit, WORK, order, job.seconds, MEMORY, told)
        if ended.how in ("time", "clock"):
            return f"Its budget of {job.seconds:g} s was over; ask for more seconds, or fewer steps."
        if ended.how == "memory":
            return f"More than {MEMORY >> 30} GB of memory would be needed; send fewer rows."
        if ended.how != "done":
            return f"Its process {ended.how:.400}; ask again."
        return next((str(body["failed"]) for body in ended.told if "failed" in body), "")

    def _progressed(self, job: Job, said: str) -> None:
        self._said[job.id] = said
        self._tell({"kind": "progress", "session": job.session, "id": job.id, "said": said})

    def _keep(self, job: Job) -> None:
        self._store.keep(job)
        self._announce(job)

    def _announce(self, job: Job) -> None:
        told = job.told()
        self._tell({"kind": "job", **{name: told[name] for name in ("id", "session", "arm", "status", "sentence")},
                    "result": told["result"], "at": time.time()})  # fmt: skip
