"""Bodies of requests are read and judged by processes with limits: a hostile one costs its sender alone."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

from greybox_id.base.contained.units import Nursery
from greybox_id.base.errors import BadInput

from .protocol import Declined

AT_ONCE = 2
SECONDS, MEMORY = 20.0, 1 << 30
"""s of the processor, ten times what 32 MB of rows take, and bytes of memory, twice what they take."""
DEEPEST = 32
"""Brackets within brackets; what is asked for has three."""
WORK = f"{__package__}.checking:checked"


class BodyChecks:
    """Processes that check bodies."""

    def __init__(self) -> None:
        self._nurseries = [Nursery() for _ in range(AT_ONCE)]
        self._free: asyncio.Queue[Nursery] = asyncio.LifoQueue()  # those that have begun first
        for nursery in self._nurseries:
            self._free.put_nowait(nursery)

    async def check(self, kind: str, file: Path, vehicle: str = "") -> int:
        """Have a file checked that holds a body, and unpacked where it is packed.

        Parameters
        ----------
        kind : "rows", "policy" or "vehicle".
        file : of the body.
        vehicle : text of the vehicle file of those who drove the rows.

        Returns
        -------
        How many rows it has; 0 of what has none.

        Raises
        ------
        Declined : it cannot be used.
        """
        nursery = await self._free.get()
        try:
            job = {"kind": kind, "file": str(file.resolve()), "vehicle": vehicle}
            ended = await asyncio.to_thread(nursery.unit, WORK, job, SECONDS, MEMORY)
        finally:
            self._free.put_nowait(nursery)
        if ended.how in ("time", "clock"):
            raise Declined(413, f"The {kind} cannot be read within {SECONDS:g} s; send less at a time.")
        if ended.how == "memory":
            raise Declined(413, f"The {kind} cannot be read within {MEMORY >> 30} GB of memory; send less at a time.")
        if ended.how != "done" or not ended.messages:
            raise Declined(422, f"The {kind} cannot be read: the process that did {ended.how:.200}.")
        answer = ended.messages[-1]
        if "refused" in answer:
            raise Declined(int(answer["status"]), str(answer["refused"]))
        return int(answer["rows"])

    def close(self) -> None:
        """End all processes at once."""
        for nursery in self._nurseries:
            nursery.close()


def json_object(body: bytes) -> dict[str, Any]:
    """The object in a body. Raises `BadInput`."""
    try:
        value = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"The body is not JSON ({error}).") from error
    if not isinstance(value, dict):
        raise BadInput("The body has to be one JSON object.")
    level: list[Any] = [value]
    for _ in range(DEEPEST):
        inner = (part.values() if isinstance(part, dict) else part for part in level if isinstance(part, (dict, list)))
        level = [item for items in inner for item in items]
    if level:
        raise BadInput(f"The body has more than {DEEPEST} levels of nested brackets.")
    return value
