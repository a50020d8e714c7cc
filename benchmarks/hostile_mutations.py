"""Damage at random, the same for the same seed and case."""

from __future__ import annotations

import gzip
import json
import random
import re
import zlib
from collections.abc import Callable
from typing import Any

from greybox_id.base.json_data import NOT_FINITE, checksum, without_nan

WORDS = (
    b"nan", b"inf", b"-1", b"1e999", b"", b"0", b"9" * 400, b"true", b'"', b"[" * 3000, b"{", b"\xff", b"\0", b"../x",
    "größe".encode(), b"1e-320", b"-0.0", b"null", b"0x7f", b"1_0", b"#", b"\n\n", b"=", b",", b";", b"1e300",
)  # fmt: skip
NUMBERS = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 2**31 - 8, 2**63 - 1, 2**64 - 1)
TEXTS = ("csv", "columns", "vehicle", "fit")


def mutated(data: bytes, kind: str, seed: int, case: int) -> bytes:
    """Damaged bytes of a file."""
    rng = random.Random(f"{seed} {case}")
    if kind == "csv.gz" and rng.random() < 0.7:
        return gzip.compress(_text(gzip.decompress(data), rng), mtime=0)
    if kind == "fit" and rng.random() < 0.7:
        return _fit(data, rng)
    if kind == "mat" and rng.random() < 0.6:
        return _inside_mat(data, rng)
    if kind in TEXTS and rng.random() < 0.8:
        return _text(data, rng)
    for _ in range(rng.choice((1, 1, 2, 5))):
        data = rng.choice(BINARY)(data, rng)
    return data


def _flip(data: bytes, rng: random.Random) -> bytes:
    own = bytearray(data)
    for _ in range(rng.choice((1, 3, 30))):
        if own:
            own[rng.randrange(len(own))] ^= 1 << rng.randrange(8)
    return bytes(own)


def _truncate(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _number(data: bytes, rng: random.Random) -> bytes:
    """A number somewhere, more often near the beginning or the end, where lengths and offsets lie."""
    size, number = rng.choice((1, 2, 4, 8)), rng.choice(NUMBERS)
    room = max(len(data) - size, 1)
    place = rng.choice((rng.randrange(room), min(rng.randrange(600), room), max(room - rng.randrange(600), 0)))
    word = (number % 256**size).to_bytes(size, rng.choice(("little", "big")))
    return data[:place] + word + data[place + size :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    a = rng.randrange(len(data) + 1)
    return data[:a] + data[a + rng.choice((1, 8, 100, 4096)) :]


def _doubled(data: bytes, rng: random.Random) -> bytes:
    a, n = rng.randrange(len(data) + 1), rng.choice((1, 8, 100, 4096))
    return data[: a + n] + data[a : a + n] + data[a + n :]


def _noise(data: bytes, rng: random.Random) -> bytes:
    a, n = rng.randrange(len(data) + 1), rng.choice((1, 8, 100))
    return data[:a] + rng.randbytes(n) + data[a + rng.choice((0, n)) :]


def _zeros(data: bytes, rng: random.Random) -> bytes:
    a, n = rng.randrange(len(data) + 1), rng.choice((4, 64, 1024))
    return data[:a] + bytes(min(n, len(data) - a)) + data[a + n :]


BINARY: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _flip, _flip, _number, _number, _number, _truncate, _cut, _doubled, _noise, _zeros,
)  # fmt: skip


def _text(data: bytes, rng: random.Random) -> bytes:
    for _ in range(rng.choice((1, 1, 2, 4))):
        way = rng.randrange(4)
        lines = data.split(b"\n")
        if way == 0 and len(lines) > 1:
            place = rng.randrange(len(lines))
            lines[place : place + 1] = rng.choice(([], [lines[place]] * 2, [lines[place][::-1]], [b""]))
            data = b"\n".join(lines)
        elif way == 1:
            tokens = list(re.finditer(rb"[\w.+-]+", data))
            token = rng.choice(tokens) if tokens else None
            if token:
                data = data[: token.start()] + rng.choice(WORDS) + data[token.end() :]
        elif way == 2:
            a = rng.randrange(len(data) + 1)
            data = data[:a] + rng.choice(WORDS) + data[a:]
        else:
            data = rng.choice(BINARY)(data, rng)
    return data


def _fit(data: bytes, rng: random.Random) -> bytes:
    """A fit with something else in it, and a checksum that says it is sound."""
    body = json.loads(data, object_hook=_numbers)
    for _ in range(rng.choice((1, 2))):
        holder: Any = body
        while True:
            key = rng.choice(list(holder) if isinstance(holder, dict) else range(len(holder))) if holder else None
            if key is None:
                break
            if isinstance(holder[key], (dict, list)) and holder[key] and rng.random() < 0.8:
                holder = holder[key]
                continue
            holder[key] = rng.choice(
                (None, -1, 0, 1e308, -1e308, 1e-308, 10**30, "", "größe", [], {}, [[1]], True, "../../x", [0.0] * 3)
            )
            break
    if isinstance(body, dict) and "checksum" in body:
        body["checksum"] = checksum({name: own for name, own in body.items() if name != "checksum"})
    return json.dumps(without_nan(body)).encode()


def _numbers(held: dict[str, Any]) -> Any:
    """Numbers that are not finite, as fits write them."""
    return float(held[NOT_FINITE]) if set(held) == {NOT_FINITE} else held


def _inside_mat(data: bytes, rng: random.Random) -> bytes:
    """Damage behind the compression of a MAT file, with lengths that are right."""
    parts, place = [data[:128]], 128
    while place + 8 <= len(data):
        size = int.from_bytes(data[place + 4 : place + 8], "little")
        inside = data[place + 8 : place + 8 + size]
        if rng.random() < 0.3:
            try:
                inside = zlib.compress(rng.choice(BINARY)(zlib.decompress(inside), rng))
            except zlib.error:
                inside = _flip(inside, rng)
        parts.append(data[place : place + 4] + len(inside).to_bytes(4, "little") + inside)
        place += 8 + size
    return b"".join(parts)
