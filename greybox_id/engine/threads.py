"""Lanes of one call shared out between two threads: compiled code holds no lock of Python's, nor do lanes need another.

What comes out is the same to the last digit, as no lane knows of the others. Where other fits run beside (`--jobs`,
fleets, servers) each keeps to one: GREYBOX_THREADS says how many there are to be, 1 or more.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from threading import Thread

WIDEST = 8
"""Lanes that run in one vector: threads get whole ones."""
PAYS = 8_000
"""Lanes times segments from which a call is shared out: half a millisecond, ten times what starting a thread takes."""
MOST = 2
"""Threads where nothing is said: more of them wait for memory."""


def threads() -> int:
    """How many threads a call may run in."""
    stated = os.environ.get("GREYBOX_THREADS", "")
    if stated.isdecimal():
        return max(1, int(stated))
    return min(MOST, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def shared_out(lanes: int, segments: int, run: Callable[[int, int], None]) -> None:
    """Do the work on lanes [first, last), in as many threads as pay."""
    count = threads() if lanes * segments >= PAYS and lanes >= 2 * WIDEST else 1
    blocks = -(-lanes // WIDEST)
    edges = [min(lanes, WIDEST * (blocks * k // count)) for k in range(count)] + [lanes]
    beside = [Thread(target=run, args=item, daemon=True) for item in zip(edges[1:-1], edges[2:], strict=True)]
    for thread in beside:
        thread.start()
    run(edges[0], edges[1])
    for thread in beside:
        thread.join()
