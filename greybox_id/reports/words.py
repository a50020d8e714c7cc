"""Words in which names of quantities are symbols: v_x is a letter with an index, yaw_rate stays a word."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "theta": "θ", "kappa": "κ",
    "lambda": "λ", "mu": "μ", "rho": "ρ", "sigma": "σ", "tau": "τ", "phi": "φ", "psi": "ψ", "omega": "ω",
}  # fmt: skip
_HEAD = "|".join(("[A-Za-z]", *GREEK))
_ALONE = re.compile(r"([A-Za-z])(?= \[)")
_SYMBOL = re.compile(rf"(?<![\w.])({_HEAD})((?:_[0-9A-Za-z]+)+)(?![\w.]*\w)")

ORDERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Characters that move a cursor, change colours or turn the direction of letters; ends of lines and tabs are none."""


def clean(text: str) -> str:
    """A text as it may be shown: an escape character is shown as its picture, other orders as a question mark."""
    return ORDERS.sub(lambda item: "␛" if item[0] == "\x1b" else "\ufffd", text)


@dataclass(frozen=True)
class Span:
    """Words alike.

    Attributes
    ----------
    words : plain words, or the letter of a symbol.
    index : of a symbol, each letter or word of it; empty for plain words.
    symbol : whether `words` is the letter of a symbol.
    """

    words: str
    index: tuple[str, ...] = ()
    symbol: bool = False


def spans(text: str) -> tuple[Span, ...]:
    """A text in plain words and symbols."""
    return tuple(_parts(text.replace(" %", "\u00a0%")))


def named(name: str) -> tuple[Span, ...]:
    """A name alone, as in the first column of a table: a bare letter is a symbol too."""
    return (Span(name, symbol=True),) if re.fullmatch("[A-Za-z]", name) else spans(name)


def is_symbol_index(index: str) -> bool:
    """Whether a part of an index is set as a symbol."""
    return index in GREEK.values() or bool(re.fullmatch("[a-z]", index))


def _parts(text: str) -> Iterator[Span]:
    at = 0
    if alone := _ALONE.match(text):  # a label: a letter and its unit
        yield Span(alone[1], symbol=True)
        at = 1
    for item in _SYMBOL.finditer(text):
        if item.start() > at:
            yield Span(text[at : item.start()])
        head, indices = item[1], item[2].split("_")[1:]
        yield Span(GREEK.get(head, head), tuple(GREEK.get(index, index) for index in indices), symbol=True)
        at = item.end()
    if at < len(text):
        yield Span(text[at:])
