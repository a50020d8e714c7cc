"""What things are called in C, and the constants that say so."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from ..equations import Named
from ..quoting import c_comment, c_string


def constant(*words: str) -> str:
    """The name of a constant made of words: CAR_X_V_X."""
    return "_".join(re.sub(r"\W+", "_", word).strip("_").upper() for word in words)


def vector(prefix: str, letter: str, about: str, entries: Sequence[Named]) -> str:
    """Definitions of a vector's size, of where its entries stand and of their units.

    Entries of an array follow one another: only where it begins has a name.
    """
    lines = [f"/* {about} */", f"#define {constant(prefix, 'N' + letter)} {len(entries)}"]
    width = max((len(constant(prefix, letter, entry.name)) for entry in entries), default=0) + len("#define _UNIT ")
    known: set[str] = set()
    for place, entry in enumerate(entries):
        array = entry.name.partition("[")[0]
        if array in known:
            continue
        known.add(array)
        name, size = constant(prefix, letter, array), _entries_of(array, entries)
        current = ", ".join(filter(None, [entry.unit, entry.about, f"{size} entries, row by row" if size > 1 else ""]))
        lines.append(f"{f'#define {name}':<{width}} {place} /* {c_comment(current)} */")
        lines.append(f"{f'#define {name}_UNIT':<{width}} {c_string(entry.unit)}")
    return "\n".join(lines) + "\n"


def names(identifier: str, entries: Sequence[Named]) -> str:
    """The definition of an array of the entries' names."""
    return f"const char *const {identifier}[] = {{\n{_rows([c_string(item.name) for item in entries] or ['0'])}\n}};\n"


def numbers(values: Iterable[float]) -> str:
    """Numbers as C has them, exactly, in rows."""
    return _rows([number(float(value)) for value in values])


def number(value: float) -> str:
    """A number as C has it, exactly."""
    if value != value:
        return "NAN"
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(value)


def _entries_of(array: str, entries: Sequence[Named]) -> int:
    return sum(entry.name.partition("[")[0] == array for entry in entries)


def _rows(words: Sequence[str], width: int = 96) -> str:
    lines, line = [], "   "
    for k, word in enumerate(words):
        piece = f" {word}" + ("," if k + 1 < len(words) else "")
        if len(line) + len(piece) > width:
            lines.append(line)
            line = "   "
        line += piece
    return "\n".join([*lines, line])
