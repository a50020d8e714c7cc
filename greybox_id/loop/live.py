"""What is happening, for people: events that a page of plain HTML shows as they come."""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from typing import Any

from ..json_data import finite

KEPT = 500
"""Events that who comes later is told."""
WAITING = 2000
"""Events that wait for a slow listener; older ones are dropped."""
LONGEST = 4000
"""Characters of an event; longer ones are not shown."""

PAGE = resources.files(__package__).joinpath("live.html").read_text("utf-8")


class Feed:
    """Events, and who follows them."""

    def __init__(self) -> None:
        self._past: deque[str] = deque(maxlen=KEPT)
        self._following: set[asyncio.Queue[str]] = set()

    def tell(self, event: Mapping[str, Any]) -> None:
        """Tell an event; its `time` is now, in s since 1970."""
        text = json.dumps(finite({"time": time.time(), **event}), allow_nan=False)
        if len(text) > LONGEST:
            return
        self._past.append(text)
        for own in self._following:
            if own.full():
                own.get_nowait()
            own.put_nowait(text)

    @contextmanager
    def followed(self) -> Iterator[asyncio.Queue[str]]:
        """A queue of events, those before it first."""
        own: asyncio.Queue[str] = asyncio.Queue(WAITING)
        for text in self._past:
            own.put_nowait(text)
        self._following.add(own)
        try:
            yield own
        finally:
            self._following.discard(own)
