"""The isolated process's side of `Contained`: it calls an object's methods on request until its input is closed.

It imports nothing else of the package, so that it starts quickly.

Messages over a pipe: a length, a JSON object, the bytes of an array. No pickle: a sender may be corrupted.
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
"""numpy's dtype kinds that are plain bytes."""
LONGEST = 2**25
"""Limit on the bytes of a message without its array."""
PIECE = 2**20
"""Bytes read at a time."""


def send(stream: IO[bytes], message: Mapping[str, Any], array: NDArray[Any] | None = None) -> None:
    """Send a message, with an array of one of `KINDS` if there is one.

    Raises
    ------
    TypeError, ValueError
        The message is no JSON, the array is of another kind, or the message is too long; nothing has been sent then.
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
    stream : the pipe.
    most : limit on the bytes of the array.

    Raises
    ------
    EOFError
        The stream ends.
    Exception
        The bytes are not a message; the type of exception depends on them.
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
    """Serve the object that the command-line argument describes."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the parent reports the interrupt
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print to standard output must not mix with messages
    serve(json.loads(sys.argv[1]), questions, answers)


def serve(begun: dict[str, Any], questions: BufferedReader, answers: BufferedWriter) -> None:
    """Answer calls until the stream of questions ends.

    Parameters
    ----------
    begun : kind, given and limits, as `Contained` takes them.
    questions, answers : streams of incoming and outgoing messages.
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
        except Exception as error:  # damaged binary files make readers raise exceptions of any type
            send(answers, {"failed": ("failed", next(iter(str(error).splitlines()), "") or type(error).__name__)})


def located(place: str) -> Any:
    """The object at module:name."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def _told(answer: Generator[Any, None, Any], answers: BufferedWriter) -> Any:
    """Send every value that a generator yields, then return what the generator returns."""
    while True:
        try:
            send(answers, {"told": next(answer)})
        except StopIteration as end:
            return end.value


def limit(seconds: float, memory: int) -> None:
    """Limit the further CPU time (s) and memory (bytes) of this process, on platforms that can."""
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
