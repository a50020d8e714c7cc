"""The process in which a reader runs: it answers questions until nobody asks any more."""

from __future__ import annotations

import math
import os
import signal
import sys
import tempfile
from importlib import import_module
from io import BufferedReader, BufferedWriter
from pathlib import Path
from typing import Any

import numpy as np

from .wire import LONGEST, receive, send


def main() -> None:
    """Serve a file's reader; module, file, folder for temporary files, seconds and bytes are arguments."""
    module, file, folder, seconds, memory = sys.argv[1:]
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the parent tells of it
    tempfile.tempdir = folder
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print where they like
    serve(module, file, folder, (float(seconds), int(memory)), questions, answers)


def serve(
    module: str,
    file: str,
    folder: str,
    limits: tuple[float, int],
    questions: BufferedReader,
    answers: BufferedWriter,
) -> None:
    """Answer questions about a file.

    Parameters
    ----------
    module, file, folder : the reader as module:class, and what it is made with.
    limits : s of the processor's time and bytes of memory from when the modules are imported.
    questions, answers : where messages come from and go to.
    """
    reader: Any = None
    while True:
        try:
            question, _ = receive(questions, LONGEST)
        except EOFError:
            return
        try:
            if reader is None:
                place, _, name = module.partition(":")
                made = getattr(import_module(place), name)
                limit(*limits)
                reader = made(file, folder)
            found = getattr(reader, question["ask"])(*question["of"])
            if isinstance(found, np.ndarray):
                send(answers, {}, found)
            else:
                send(answers, {"answer": found})
        except ImportError as error:
            send(answers, {"missing": error.name or str(error)})
        except MemoryError:
            send(answers, {"memory": True})
        except Exception as error:  # readers of binary files fail over damage in ways nobody has listed
            send(answers, {"failed": next(iter(str(error).splitlines()), "") or type(error).__name__})


def limit(seconds: float, memory: int) -> None:
    """Let this process have so much more of the processor's time and of memory, where the platform can say so."""
    if sys.platform == "win32":
        return
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF)
    pages = Path("/proc/self/statm")
    wanted = [(resource.RLIMIT_CORE, 0), (resource.RLIMIT_CPU, math.ceil(used.ru_utime + used.ru_stime + seconds))]
    if pages.exists():
        wanted += [(resource.RLIMIT_AS, int(pages.read_text().split()[0]) * resource.getpagesize() + memory)]
    for which, most in wanted:
        _, hardest = resource.getrlimit(which)
        resource.setrlimit(which, (most if hardest == resource.RLIM_INFINITY else min(most, hardest), hardest))
