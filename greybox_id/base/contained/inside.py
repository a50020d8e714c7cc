"""What runs in a process of its own: an object whose methods answer questions, until nobody asks any more.

It imports nothing else of the package, since starting has to be quick.

Messages over a pipe: a length, a JSON object, the bytes of an array. No pickle: senders may be out of their mind.
"""

from __future__ import annotations

import json
import math
import os
import signal
import struct
import sys
from collections.abc import Generator, Mapping
from importlib import import_module
from io import BufferedReader, BufferedWriter
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

LENGTH = struct.Struct("<Q")
KINDS = "iufbcSUmM"
"""Kinds of arrays that are plain bytes."""
LONGEST = 2**25
"""Bytes that a message without its array may have."""
PIECE = 2**20
"""Bytes taken at once."""


def send(stream: IO[bytes], message: Mapping[str, Any], array: NDArray[Any] | None = None) -> None:
    """Send a message, with an array of one of `KINDS` if there is one.

    Raises
    ------
    TypeError, ValueError
        JSON does not hold the message, the array is of another kind, or there is too much: nothing has been sent.
    """
    shape = None if array is None else {"dtype": array.dtype.str, "shape": array.shape}
    head = json.dumps({"message": message, "array": shape}).encode()
    if len(head) > LONGEST:
        raise ValueError(f"a message of {len(head)} bytes")
    body = b"" if array is None else np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
    stream.write(LENGTH.pack(len(head)) + head)
    stream.write(body)
    stream.flush()


def receive(stream: IO[bytes], most: float) -> tuple[dict[str, Any], NDArray[Any] | None]:
    """The next message and its array.

    Parameters
    ----------
    stream : where it comes from.
    most : bytes that the array may have.

    Raises
    ------
    EOFError
        The stream ends.
    Exception
        What comes is no message; which exception depends on what it is instead.
    """
    (length,) = LENGTH.unpack(_exactly(stream, LENGTH.size))
    if length > LONGEST:
        raise ValueError(f"a message of {length} bytes")
    head = json.loads(_exactly(stream, length))
    if head["array"] is None:
        return dict(head["message"]), None
    kind, shape = np.dtype(head["array"]["dtype"]), tuple(map(int, head["array"]["shape"]))
    if kind.kind not in KINDS or not kind.itemsize or min(shape, default=0) < 0:
        raise ValueError(f"an array of {kind} and shape {shape}")
    if math.prod(shape) * kind.itemsize > most:
        raise ValueError(f"an array of shape {shape}")
    array = np.empty(shape, kind)
    _fill(stream, array.reshape(-1).view(np.uint8).data)
    return dict(head["message"]), array


def _exactly(stream: IO[bytes], length: int) -> bytes:
    data = bytearray(length)
    _fill(stream, memoryview(data))
    return bytes(data)


def _fill(stream: IO[bytes], room: memoryview) -> None:
    done = 0
    while done < len(room):
        part = stream.read(min(len(room) - done, PIECE))
        if not part:
            raise EOFError
        room[done : done + len(part)] = part
        done += len(part)


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
