"""Detection of raw CAN frames in text files: identifiers and bytes, which need a DBC file to become signals."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ...base.errors import BadInput
from ..column_map import SEPARATORS

FEWEST, MOSTLY, LETTERS = 3, 0.8, 0.1
"""Fewest lines that are frames, their share, and the least share of payload cells with a digit beyond 9: of eight bytes
with random hexadecimal digits 0.99 have one, zeros and counters have fewer."""
_DUMPED = re.compile(r"\s*\(?\d+([.]\d+)?\)?\s+\w+\s+[\dA-Fa-f]{3,8}(#|\s+\[\d+\]\s+[\dA-Fa-f]{2}\b)")
_TRACED = re.compile(r"\s*\d+[.]\d+\s+\d+\s+[\dA-Fa-f]+x?\s+(Rx|Tx)\s+d\s+\d+\s")
"""Lines of candump, and of an ASC file."""
_IDENTIFIER = re.compile(
    r"(can|arb\w*|arbitration|msg|message|frame)?[ _.-]*(id|identifier|addr|address)([ _.-]*\(?hex\)?)?"
)
_BYTES = re.compile(r"(can|msg|message|frame)?[ _.-]*(data|dat|payload|bytes|hex|raw)([ _.-]*\(?(hex|bytes)\)?)?")
_BYTE = re.compile(r"(data|byte|d|b)[ _.-]*\[?\d\d?\]?")
_HEX = re.compile(r"(0x)?([\dA-Fa-f]{2}([ :_-]|(?=[\dA-Fa-f])|$)){1,64}|b'.*'|b\".*\"")


def must_hold_signals(lines: Sequence[str], where: str) -> None:
    """Raise `BadInput` if the first lines of a file are raw frames.

    Parameters
    ----------
    lines : of the file, from its beginning.
    where : the file, as named.
    """
    filled = [line for line in lines if line.strip()]
    if _mostly([bool(_DUMPED.match(line) or _TRACED.match(line)) for line in filled]) or any(
        _is_table(filled, mark) for mark in SEPARATORS
    ):
        raise BadInput(
            f"{where} holds raw CAN frames, identifiers and bytes, not signals. Decode it with the DBC file of the "
            "car (cantools, asammdf and SavvyCAN can do this; opendbc has such files for many cars), write a column "
            "for each signal, "
            "and map that."
        )


def _mostly(frames: Sequence[bool]) -> bool:
    return sum(frames) >= max(FEWEST, MOSTLY * len(frames))


def _is_table(lines: Sequence[str], separator: str) -> bool:
    """Whether lines are a table with an identifier and payload bytes in hexadecimal digits."""
    rows = [[cell.strip().strip('"') for cell in line.split(separator)] for line in lines]
    names = [name.lower().lstrip("# ") for name in rows[0]] if rows else []
    if not any(_IDENTIFIER.fullmatch(name) for name in names):
        return False
    places = [k for k, name in enumerate(names) if _BYTES.fullmatch(name)][:1]
    places = places or [k for k, name in enumerate(names) if _BYTE.fullmatch(name)]
    cells = ["".join(row[k] for k in places if k < len(row)) for row in rows[1:]]
    if not places or not _mostly([bool(_HEX.fullmatch(cell)) for cell in cells]):
        return False
    return sum(bool(re.search("[A-Fa-f]", cell.removeprefix("0x"))) for cell in cells) >= LETTERS * len(cells)
