"""Names in C, and their constants.

Also escaping of texts from users, such as names of files, in generated code, so that they cannot end or begin a
construct there. There is one function per language and place; no other code of this package inserts foreign texts.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Iterable, Sequence

from ..equations import Named

_PLAIN = re.compile(r"[A-Za-z]\w*", re.ASCII)
_NO_TEXTS = {"null", "true", "false", "yes", "no", "on", "off", "y", "n"}
"""Words that YAML 1.1 does not read as text."""


def one_line(text: str) -> str:
    """A text without line ends and other control characters, for comments that end with their line."""
    return "".join(" " if unicodedata.category(item) in ("Cc", "Cf", "Zl", "Zp", "Cs") else item for item in text)


def c_comment(text: str) -> str:
    """A text inside a C comment; backslashes, which join lines, become slashes."""
    return re.sub(r"\*(?=/)|/(?=\*)|\?(?=\?)", r"\g<0> ", one_line(text).replace("\\", "/"))


def c_string(text: str) -> str:
    """A text as a C string."""
    escaped = one_line(text).replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?")
    return f'"{escaped}"'


def matlab_comment(text: str) -> str:
    """A text after MATLAB's per cent sign; a comment that is a single brace would begin a block."""
    return one_line(text).strip().strip("{}") or "-"


def matlab_text(text: str) -> str:
    """A text as a MATLAB string."""
    return "'" + one_line(text).replace("'", "''") + "'"


def docstring(text: str) -> str:
    """A text inside a Python docstring."""
    return one_line(text).replace("\\", "\\\\").replace('"', '\\"')


def xml_text(text: str) -> str:
    """A text without characters that XML forbids; the writer escapes the others."""
    return "".join(item for item in one_line(text) if item not in "\ufffe\uffff")


def yaml_text(text: str) -> str:
    """A text as a YAML value: unchanged if it is a plain word, else in JSON's quotes, which YAML accepts."""
    if _PLAIN.fullmatch(text) and text.lower() not in _NO_TEXTS:
        return text
    return json.dumps(one_line(text), ensure_ascii=False)


def constant(*words: str) -> str:
    """The name of a constant, made of words: CAR_X_V_X."""
    return "_".join(re.sub(r"\W+", "_", word).strip("_").upper() for word in words)


def vector(prefix: str, letter: str, about: str, entries: Sequence[Named]) -> str:
    """Definitions of a vector's size, of its entries' indices and of their units.

    Entries of an array are consecutive: only the first one has a name.
    """
    lines = [f"/* {about} */", f"#define {constant(prefix, 'N' + letter)} {len(entries)}"]
    width = max((len(constant(prefix, letter, entry.name)) for entry in entries), default=0) + len("#define _UNIT ")
    known: set[str] = set()
    for place, entry in enumerate(entries):
        array = entry.name.partition("[")[0]
        if array in known:
            continue
        known.add(array)
        name, size = constant(prefix, letter, array), sum(entry.name.partition("[")[0] == array for entry in entries)
        current = ", ".join(filter(None, [entry.unit, entry.about, f"{size} entries, row by row" if size > 1 else ""]))
        lines.append(f"{f'#define {name}':<{width}} {place} /* {c_comment(current)} */")
        lines.append(f"{f'#define {name}_UNIT':<{width}} {c_string(entry.unit)}")
    return "\n".join(lines) + "\n"


def names(identifier: str, entries: Sequence[Named]) -> str:
    """The definition of an array of the entries' names."""
    return f"const char *const {identifier}[] = {{\n{_rows([c_string(item.name) for item in entries] or ['0'])}\n}};\n"


def numbers(values: Iterable[float]) -> str:
    """Numbers in C notation, exactly, in rows."""
    return _rows([number(float(value)) for value in values])


def number(value: float) -> str:
    """A number in C notation, exactly."""
    if value != value:
        return "NAN"
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(value)


def _rows(words: Sequence[str], width: int = 96) -> str:
    lines, line = [], "   "
    for k, word in enumerate(words):
        piece = f" {word}" + ("," if k + 1 < len(words) else "")
        if len(line) + len(piece) > width:
            lines.append(line)
            line = "   "
        line += piece
    return "\n".join([*lines, line])
