"""What went wrong, as a sentence.

Every error a user can cause is a `GreyboxError`. Its text says what is wrong, where (file, column,
row) and what to do about it; the command line prints it and exits with 2, without a traceback.
"""

from collections.abc import Iterable
from difflib import get_close_matches


class GreyboxError(Exception):
    """Base of all errors that a user can cause and mend."""


class BadInput(GreyboxError):
    """A file, a column map, a setting or a value that cannot be used."""


class BadModel(GreyboxError):
    """A model whose equations cannot be traced, or that does not fit the recording it meets."""


def near(name: str, known: Iterable[str]) -> str:
    """A question that names what was meant, with a leading space; empty if nothing is near."""
    found = nearest(name, known)
    return f" Did you mean {found}?" if found is not None else ""


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that is most like another; None if nothing is."""
    lowered = {own.lower(): own for own in known}
    found = get_close_matches(name.lower(), list(lowered), 1)
    return lowered[found[0]] if found else None


def near_or_all(name: str, known: Iterable[str]) -> str:
    """What was meant, or where nothing is near all there is; with a leading space."""
    names = list(known)
    return near(name, names) or f" There are {', '.join(names)}."
