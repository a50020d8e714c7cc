"""Events of vehicles and jobs as they happen, for whoever watches the page."""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any

from greybox_id.base.json_data import finite

KEPT = 500
"""Past events that a viewer who comes later gets."""
WAITING = 2000
"""Events that wait for a slow viewer; older ones are dropped."""
LONGEST = 4000
"""Characters of an event; longer ones are not shown."""
VIEWERS = 8
"""Streams at a time: anybody on this machine may open one, so a further one ends the oldest."""
BEAT = 15.0
"""s of silence after which a stream says that it lives."""


class Feed:
    """Events, and who follows them."""

    def __init__(self) -> None:
        self._past: deque[str] = deque(maxlen=KEPT)
        self._viewers: dict[asyncio.Queue[str], Callable[[], None]] = {}

    def tell(self, event: Mapping[str, Any]) -> None:
        """Show an event; its `time` is now, in s since 1970."""
        text = json.dumps(finite({"time": time.time(), **event}), allow_nan=False)
        if len(text) > LONGEST:
            return
        self._past.append(text)
        for viewer in self._viewers:
            if viewer.full():
                viewer.get_nowait()
            viewer.put_nowait(text)

    async def stream(self, hang_up: Callable[[], None]) -> AsyncIterator[str]:
        """The past events, then those that come, as server-sent events.

        Parameters
        ----------
        hang_up : ends the viewer's connection, also one that takes nothing any more.
        """
        events: asyncio.Queue[str] = asyncio.Queue(WAITING)
        for text in self._past:
            events.put_nowait(text)
        if len(self._viewers) >= VIEWERS:
            self._viewers.pop(next(iter(self._viewers)))()
        self._viewers[events] = hang_up
        try:
            while True:
                try:
                    event = await asyncio.wait_for(events.get(), BEAT)
                except TimeoutError:
                    yield ": still here\n\n"
                else:
                    yield f"data: {event}\n\n"
        finally:
            self._viewers.pop(events, None)

    def close(self) -> None:
        """End all streams."""
        while self._viewers:
            self._viewers.popitem()[1]()
