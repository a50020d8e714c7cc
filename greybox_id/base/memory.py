"""Freed memory is returned to the system."""

from __future__ import annotations

import ctypes
import sys

MMAP_THRESHOLD = -3
"""`M_MMAP_THRESHOLD` of glibc's malloc.h."""
LARGE = 1024 * 1024
"""Size in bytes from which an allocation gets separate pages: a signal of 130 000 rows."""


def give_back() -> None:
    """Allocate large arrays in separate pages, which are returned when freed; no effect without glibc.

    By default glibc raises this threshold with the size of freed blocks, up to 32 MB: columns of a recording of hours
    and its parsed text then lie between small objects, and their memory stays with the process when they are freed.
    """
    if sys.platform.startswith("linux"):
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
        if mallopt is not None:
            mallopt(MMAP_THRESHOLD, LARGE)
