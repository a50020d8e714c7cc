"""Texts that others chose, such as names of files, put into generated code: they end nothing and begin nothing there.

A function for each language and place; nothing else of this package writes a foreign text into code.
"""

from __future__ import annotations

import json
import re
import unicodedata

_PLAIN = re.compile(r"[A-Za-z]\w*", re.ASCII)
_NO_TEXTS = {"null", "true", "false", "yes", "no", "on", "off", "y", "n"}
"""Words that YAML 1.1 takes for something else than a text."""


def one_line(text: str) -> str:
    """A text without ends of lines and other characters of control, for comments that end with their line."""
    return "".join(" " if unicodedata.category(item) in ("Cc", "Cf", "Zl", "Zp", "Cs") else item for item in text)


def c_comment(text: str) -> str:
    """A text between the marks of a comment of C; backslashes, which join lines, become slashes."""
    return re.sub(r"\*(?=/)|/(?=\*)|\?(?=\?)", r"\g<0> ", one_line(text).replace("\\", "/"))


def c_string(text: str) -> str:
    """A text as a string of C."""
    escaped = one_line(text).replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?")
    return f'"{escaped}"'


def matlab_comment(text: str) -> str:
    """A text behind a per cent sign of MATLAB; a comment that is a brace alone would begin a block."""
    return one_line(text).strip().strip("{}") or "-"


def matlab_text(text: str) -> str:
    """A text as a string of MATLAB."""
    return "'" + one_line(text).replace("'", "''") + "'"


def docstring(text: str) -> str:
    """A text between the three quotation marks of a docstring of Python."""
    return one_line(text).replace("\\", "\\\\").replace('"', '\\"')


def xml_attribute(text: str) -> str:
    """A text as a value of an attribute of XML, with its quotation marks."""
    plain = "".join(item for item in one_line(text) if item not in "\ufffe\uffff")
    escaped = plain.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")
    return f'"{escaped}"'


def yaml_text(text: str) -> str:
    """A text as a value of YAML: as it is where it is a plain word, else in JSON's quotes, which are YAML's as well."""
    if _PLAIN.fullmatch(text) and text.lower() not in _NO_TEXTS:
        return text
    return json.dumps(one_line(text), ensure_ascii=False)
