"""Messages over a pipe: a length, a JSON object, the bytes of an array. No pickle: senders may be out of their mind."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
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
