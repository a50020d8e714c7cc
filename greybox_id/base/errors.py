"""What went wrong, as a sentence.

Every error a user can cause is a `GreyboxError`. Its text says what is wrong, where (file, column,
row) and what to do about it; the command line prints it and exits with 2, without a traceback.
"""

import re
from collections.abc import Callable, Iterable

_ARGUMENT = re.compile(r"‹(\w+)(?:\|([^›]*))?›")
"""An argument in a sentence: ‹columns›, or ‹own|models=, effects=› where functions call it differently."""


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
        """The sentence as callers of functions read it: arguments by their names."""
        return _ARGUMENT.sub(lambda match: match[2] or match[1], super().__str__())

    def said(self, call: Callable[[str], str]) -> str:
        """The sentence with arguments called as `call` says: a command line calls ‹columns› by an option of its own."""
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
    """A model whose equations cannot be traced, or that does not fit the recording it meets.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.longitudinal() + gb.effects.steering_delay
    Traceback (most recent call last):
    ...
    greybox_id.base.errors.BadModel: Effect steering_delay acts on steer, but model longitudinal has inputs ...
    """


def near(name: str, known: Iterable[str]) -> str:
    """A question that names what was meant, with a leading space; empty if nothing is near."""
    meant = nearest(name, known)
    return f" Did you mean {meant}?" if meant is not None else ""


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that is most like another; None if nothing is."""
    from difflib import get_close_matches

    lowered = {item.lower(): item for item in known}
    result = get_close_matches(name.lower(), list(lowered), 1)
    return lowered[result[0]] if result else None


def must_be_one_of(known: Iterable[str], value: object, sentence: str) -> None:
    """Raise `BadInput` for a value that is none of those known, in a sentence that begins so: "There is no target"."""
    names = list(known)
    if value not in names:
        raise BadInput(f"{sentence} {value!r:.40}.{near_or_all(str(value), names)}")


def must_be_whole(value: object, name: str, least: int, most: int | None = None) -> None:
    """Raise `BadInput` for what is no whole number from `least` on."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= (value if most is None else most):
        up_to = "on" if most is None else f"to {most}"
        raise BadInput(f"‹{name}›: a whole number from {least} {up_to} is needed, not {value!r:.40}.")


def near_or_all(name: str, known: Iterable[str]) -> str:
    """What was meant, or where nothing is near all there is; with a leading space."""
    names = list(known)
    return near(name, names) or f" Possible names: {', '.join(names)}."
