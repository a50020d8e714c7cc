"""What runs in a process of its own: an object whose methods answer questions, until nobody asks any more.

It imports nothing else of the package, since starting has to be quick.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
from collections.abc import Generator
from importlib import import_module
from io import BufferedReader, BufferedWriter
from pathlib import Path
from typing import Any

import numpy as np

from .wire import LONGEST, receive, send


def main() -> None:
    """Answer questions about the object that the argument describes."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the parent tells of it
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print where they like
    serve(json.loads(sys.argv[1]), questions, answers)


def serve(begun: dict[str, Any], questions: BufferedReader, answers: BufferedWriter) -> None:
    """Answer questions.

    Parameters
    ----------
    begun : kind, given and limits, as `Contained` takes them.
    questions, answers : where messages come from and go to.
    """
    made: Any = None
    while True:
        try:
            question, _ = receive(questions, LONGEST)
        except EOFError:
            return
        try:
            if made is None:
                kind = located(begun["kind"])
                if begun["limits"]:
                    limit(*begun["limits"])
                made = kind(*begun["given"])
            answer = getattr(made, question["ask"])(*question["of"])
            if isinstance(answer, Generator):
                answer = _told(answer, answers)
            if isinstance(answer, np.ndarray):
                send(answers, {}, answer)
            else:
                send(answers, {"answer": answer})
        except ImportError as error:
            send(answers, {"failed": ("missing", error.name or str(error))})
        except MemoryError:
            send(answers, {"failed": ("memory", "")})
        except Exception as error:  # readers of binary files fail over damage in ways nobody has listed
            send(answers, {"failed": ("failed", next(iter(str(error).splitlines()), "") or type(error).__name__)})


def located(place: str) -> Any:
    """What stands at module:name."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def _told(answer: Generator[Any, None, Any], answers: BufferedWriter) -> Any:
    """What a generator returns, after what it yields has been told."""
    while True:
        try:
            send(answers, {"told": next(answer)})
        except StopIteration as end:
            return end.value


def limit(seconds: float, memory: int) -> None:
    """Let this process have so much more of the processor's time and of memory, where the platform can say so."""
    if sys.platform == "win32":
        return
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF)
    pages = Path("/proc/self/statm")
    limits = [(resource.RLIMIT_CORE, 0), (resource.RLIMIT_CPU, math.ceil(used.ru_utime + used.ru_stime + seconds))]
    if pages.exists():
        limits += [(resource.RLIMIT_AS, int(pages.read_text().split()[0]) * resource.getpagesize() + memory)]
    for which, most in limits:
        _, hardest = resource.getrlimit(which)
        resource.setrlimit(which, (most if hardest == resource.RLIM_INFINITY else min(most, hardest), hardest))
