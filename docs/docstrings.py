"""What docstrings of `greybox_id.__all__` do not say: `python docs/docstrings.py`, exit code 1 where one lacks.

The pages themselves are made by `make docs` (docs/reference.md).
"""

from __future__ import annotations

import inspect
import sys

import greybox_id as gb


def lacking() -> list[str]:
    """What a docstring does not say: an example of every name; arguments, returns and errors of every function."""
    missing = []
    for name in gb.__all__:
        thing = getattr(gb, name)
        text = inspect.getdoc(thing) or ""
        needed = ["Examples"]
        if inspect.isfunction(thing):
            takes = bool(inspect.signature(thing).parameters)
            needed += ["Returns", *(["Parameters", "Raises"] if takes else [])]
        missing += [
            f"gb.{name}: no section {section}" for section in needed if f"{section}\n{'-' * len(section)}" not in text
        ]
    return missing


if __name__ == "__main__":
    sentences = lacking()
    print("\n".join(sentences), file=sys.stderr, end="\n" if sentences else "")
    sys.exit(1 if sentences else 0)
