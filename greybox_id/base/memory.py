"""What is freed goes back to the system."""

from __future__ import annotations

import ctypes
import sys

MMAP_THRESHOLD = -3
"""`M_MMAP_THRESHOLD` of glibc's malloc.h."""
LARGE = 1024 * 1024
"""Bytes from which an allocation has pages of its own: a signal of 130 000 rows."""


def give_back() -> None:
    """Let large arrays have pages of their own, which go back when they are freed; elsewhere than on glibc nothing.

    By itself glibc raises that threshold with what was freed, to 32 MB: of a recording of hours, columns and what was
    parsed of its text then lie among small things, and what is freed between those stays with the process.
    """
    if sys.platform.startswith("linux"):
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
        if mallopt is not None:
            mallopt(MMAP_THRESHOLD, LARGE)
