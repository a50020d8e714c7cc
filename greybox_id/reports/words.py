"""Typesetting of names of quantities in text: v_x is a symbol with an index, yaw_rate remains a word."""

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
"""Control characters that move a cursor, change colours or reverse the direction of text; not line ends and tabs."""


def clean(text: str) -> str:
    """Text without control characters: an escape character becomes its picture, others become question marks."""
    return ORDERS.sub(lambda item: "␛" if item[0] == "\x1b" else "\ufffd", text)


@dataclass(frozen=True)
class Span:
    """A stretch of text of one kind.

    Attributes
    ----------
    words : plain words, or the letter of a symbol.
    index : letters or words of a symbol's index; empty for plain words.
    symbol : whether `words` is the letter of a symbol.
    """

    words: str
    index: tuple[str, ...] = ()
    symbol: bool = False


def spans(text: str) -> tuple[Span, ...]:
    """A text, divided into plain words and symbols."""
    return tuple(_parts(text.replace(" %", "\u00a0%")))


def named(name: str) -> tuple[Span, ...]:
    """A single name, as in the first column of a table: here a single letter is a symbol, too."""
    return (Span(name, symbol=True),) if re.fullmatch("[A-Za-z]", name) else spans(name)


def is_symbol_index(index: str) -> bool:
    """Whether a part of an index is typeset as a symbol."""
    return index in GREEK.values() or bool(re.fullmatch("[a-z]", index))


def _parts(text: str) -> Iterator[Span]:
    at = 0
    if alone := _ALONE.match(text):  # label of a letter and its unit
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
