"""Errors as sentences.

Every error a user can cause is a `GreyboxError`. Its text says what is wrong, where (file, column,
row) and what to do about it; the command line prints it and exits with 2, without a traceback.
"""

import re
from collections.abc import Callable, Iterable

_ARGUMENT = re.compile(r"‹(\w+)(?:\|([^›]*))?›")
"""An argument in a sentence: ‹columns›, or ‹option|models=, effects=› if option and arguments differ in name."""


class GreyboxError(Exception):
    """Base of all errors that a user can cause and mend: its text is a sentence that says what to do.

    Examples
    --------
    >>> import greybox_id as gb
    >>> try:
    ...     gb.fit("laterl", "lap.csv")
    ... except gb.GreyboxError as error:
    ...     print(error)
    model: there is no model 'laterl'. Did you mean lateral?
    """

    def __str__(self) -> str:
        """The sentence with arguments by their names in Python."""
        return _ARGUMENT.sub(lambda match: match[2] or match[1], super().__str__())

    def said(self, call: Callable[[str], str]) -> str:
        """The sentence with each argument's name replaced by `call` of it, such as an option of the command line."""
        return _ARGUMENT.sub(lambda match: call(match[1]), super().__str__())


class BadInput(GreyboxError):
    """A file, a column map, a setting or a value that cannot be used.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.Vehicle.load("roboracr")
    Traceback (most recent call last):
    ...
    greybox_id.base.errors.BadInput: There is no vehicle "roboracr". Did you mean roboracer? ...
    """


class BadModel(GreyboxError):
    """A model whose equations cannot be traced, or whose signals the recording does not have.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.longitudinal() + gb.effects.steering_delay
    Traceback (most recent call last):
    ...
    greybox_id.base.errors.BadModel: Effect steering_delay acts on steer, but model longitudinal has inputs ...
    """


def near(name: str, known: Iterable[str]) -> str:
    """The question " Did you mean ...?" with the most similar known name; empty if none is similar."""
    meant = nearest(name, known)
    return f" Did you mean {meant}?" if meant is not None else ""


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name most similar to a given one; None if none is similar."""
    from difflib import get_close_matches

    lowered = {item.lower(): item for item in known}
    result = get_close_matches(name.lower(), list(lowered), 1)
    return lowered[result[0]] if result else None


def must_be_one_of(known: Iterable[str], value: object, sentence: str) -> None:
    """Raise `BadInput` for an unknown value; `sentence` is its beginning, such as "There is no target"."""
    names = list(known)
    if value not in names:
        raise BadInput(f"{sentence} {value!r:.40}.{near_or_all(str(value), names)}")


def must_be_whole(value: object, name: str, least: int, most: int | None = None) -> None:
    """Raise `BadInput` unless the value is a whole number from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= (value if most is None else most):
        up_to = "on" if most is None else f"to {most}"
        raise BadInput(f"‹{name}›: a whole number from {least} {up_to} is needed, not {value!r:.40}.")


def near_or_all(name: str, known: Iterable[str]) -> str:
    """The question of `near`, or a list of all known names if none is similar; with a leading space."""
    names = list(known)
    return near(name, names) or f" Possible names: {', '.join(names)}."
