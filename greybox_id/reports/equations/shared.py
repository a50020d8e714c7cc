"""Equations cut to what can be read: what stands in them more than once gets a letter, long sums are shortened."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from .expression import Cases, Equation, Expression, Sum, Symbol, Window, children, with_children

LARGE = 7
"""Parts that an expression has at least to be worth a letter of its own."""
MOST_TERMS, SHOWN = 8, 3
"""Longer sums show so many terms and the last."""
LETTER = "w"
MOST = 60
"""Equations at most; of what is left out, readers are told."""


def readable(equations: Sequence[Equation]) -> tuple[tuple[Equation, ...], int]:
    """The same equations, each behind the letters it needs, and how many definitions were left out."""
    return _Shortened(equations).found()


class _Shortened:
    def __init__(self, equations: Sequence[Equation]) -> None:
        self._equations = equations
        self._sizes: dict[Expression, int] = {}
        self._uses: Counter[Expression] = Counter()
        self._letters: dict[Expression, Symbol] = {}
        self._made: list[Equation] = []
        self._told: set[Expression] = set()
        self._left_out = 0
        seen: set[Expression] = set()
        for own in equations:
            self._count(own.right, seen)

    def found(self) -> tuple[tuple[Equation, ...], int]:
        """Equations in order, definitions behind the first that needs them."""
        for own in self._equations:
            self._add(Equation(own.left, self._inside(own.right)), own.right)
        return tuple(self._made), self._left_out

    def _add(self, equation: Equation, original: Expression) -> None:
        waiting = self._waiting_in(original)
        self._made.append(equation)
        for own in waiting:
            if len(self._made) >= MOST:
                self._left_out += 1
                continue
            self._add(Equation(self._letters[own], self._inside(own)), own)

    def _waiting_in(self, original: Expression) -> list[Expression]:
        """What got a letter while this was written, in order of appearance."""
        new = [own for own in self._letters if own not in self._told and own != original]
        self._told.update(new)
        return new

    def _count(self, of: Expression, seen: set[Expression]) -> int:
        self._uses[of] += 1
        if of in seen:
            return self._sizes[of]
        seen.add(of)
        self._sizes[of] = 1 + sum(self._count(own, seen) for own in children(of))
        return self._sizes[of]

    def _inside(self, of: Expression) -> Expression:
        """An expression whose larger, repeated parts are letters."""
        if isinstance(of, Sum) and len(of.terms) > MOST_TERMS:
            kept = (*of.terms[:SHOWN], of.terms[-1])
            of_kept = tuple((minus, self._written(own)) for minus, own in kept)
            return Sum(of_kept, left_out=len(of.terms) - len(kept))
        return with_children(of, tuple(self._written(own) for own in children(of)))

    def _written(self, of: Expression) -> Expression:
        repeated = self._uses[of] > 1 and self._sizes[of] >= LARGE
        long = isinstance(of, Sum) and len(of.terms) > MOST_TERMS
        if repeated or long or isinstance(of, Cases | Window):
            if of not in self._letters:
                self._letters[of] = Symbol(f"{LETTER}_{len(self._letters) + 1}")
            return self._letters[of]
        return self._inside(of)
