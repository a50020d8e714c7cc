"""The C functions of an export: what each is called, takes, gives and does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from ..quoting import c_comment
from .mathematics import definitions
from .scalar import Body, body

INLINE = """\
#if defined __GNUC__
#define INLINE inline __attribute__((always_inline, unused))
#else
#define INLINE inline
#endif
"""
FRAME = 1024
"""Bytes that a C function may take beside its own numbers: saved registers, arguments, what functions it calls take."""


@dataclass(frozen=True)
class Argument:
    """An argument of a C function.

    Attributes
    ----------
    name : in C.
    size : its length as the header's constants say it, such as "CAR_NX"; "" is a number.
    """

    name: str
    size: str

    @property
    def given(self) -> str:
        """Its declaration where it is read."""
        return f"const double *{self.name}" if self.size else f"double {self.name}"


@dataclass(frozen=True)
class CFunction:
    """A function written from a CasADi function.

    Attributes
    ----------
    name : in C.
    function : column vectors -> dense results.
    arguments, results : in its order.
    about : what it computes.
    """

    name: str
    function: cs.Function
    arguments: tuple[Argument, ...]
    results: tuple[Argument, ...]
    about: str

    @cached_property
    def body(self) -> Body:
        """Its statements."""
        arguments = [own.name if own.size else f"{own.name}*" for own in self.arguments]
        return body(self.function, arguments, [own.name for own in self.results])

    @property
    def stack_bytes(self) -> int:
        """What it needs of the stack at most, however little a compiler keeps in registers."""
        return 8 * sum(line.startswith(("const", "double")) for line in self.body.lines) + FRAME

    @property
    def _all(self) -> tuple[Argument, ...]:
        return (*self.arguments, *self.results)

    @property
    def signature(self) -> str:
        """Its declaration, without what ends it."""
        told = [own.given for own in self.arguments] + [f"double *{own.name}" for own in self.results]
        return wrapped(f"void {self.name}(", told)

    @property
    def declaration(self) -> str:
        """Its declaration with what it computes, for a header."""
        sizes = ", ".join(f"{own.name} {own.size}" for own in self._all if own.size)
        return f"/* {c_comment(self.about)}\n   Lengths: {sizes}. */\n{self.signature};\n"

    @property
    def definition(self) -> str:
        """Its C."""
        unused = [f"(void){own.name};" for own in self._all if not self.body.reads(own.name)]
        lines = "\n".join(f"    {line}" for line in (*self.body.lines, *unused))
        return f"{self.signature}\n{{\n{lines}\n}}\n"


def wrapped(head: str, arguments: Sequence[str], width: int = 100) -> str:
    """A declaration's arguments in lines that are not too long."""
    lines, line = [], head
    for k, argument in enumerate(arguments):
        piece = argument + ("," if k + 1 < len(arguments) else ")")
        joined = f"{line}{'' if line.endswith('(') or not line.strip() else ' '}{piece}"
        if len(joined) > width and line.strip():
            lines.append(line)
            line = f"    {piece}"
        else:
            line = joined
    return "\n".join([*lines, line])


def mathematics_of(functions: Sequence[CFunction]) -> str:
    """C of the elementary functions that these call."""
    called = frozenset().union(*[own.body.functions for own in functions])
    return f"{INLINE}\n{definitions(called)}"
