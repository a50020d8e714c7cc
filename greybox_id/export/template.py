"""Templates: exported code that is the same for every model, in the folder templates, in its own language."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources

from .c.naming import constant

FOLDER = "templates"
_VARIANT = re.compile(r"^#if ([A-Z_0-9]+)\n(.*?)(?:^#else\n(.*?))?^#endif\n", re.MULTILINE | re.DOTALL)
_PLACE = re.compile(r"@([A-Z_]+)@|[@$]")


def filled(template: str, name: str, package: str = __package__, **words: object) -> str:
    """The text of a template, filled in for an export.

    In a template, @ is the name of the export, $ the name in capitals and @WORD@ a word; lines from `#if WORD` to
    `#else` and `#endif` are kept if that word is true.

    Parameters
    ----------
    template : name of the file.
    name : prefix of functions.
    package : whose folder `templates` contains the file.
    words : WORD -> its replacement, or whether it is true.
    """
    text = _VARIANT.sub(lambda lines: lines[2] if words[lines[1]] else lines[3] or "", _read(package, template))
    return _PLACE.sub(
        lambda place: str(words[place[1]]) if place[1] else name if place[0] == "@" else constant(name), text
    )


@cache
def _read(package: str, template: str) -> str:
    return resources.files(package).joinpath(FOLDER, template).read_text("utf-8")
