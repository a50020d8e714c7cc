"""Letters in a figure: how wide words are, and their writing with symbols and indices."""

from __future__ import annotations

from xml.sax.saxutils import escape

from ..words import is_symbol_index, named, plain
from .palette import INK

SIZE, SMALL = 8.6, 7.8
"""Of labels, and of ticks, points."""
FAMILY = "'Libertinus Serif','STIX Two Text','Times New Roman',Times,serif"
LOWERED, INDEX = 0.22, 0.72
"""How far below the line an index stands, and how large it is, of the letters' size."""
_WIDTHS = {
    **dict.fromkeys("iljt.,:;'|!()[]fI·/ ", 0.31), **dict.fromkeys("rsceazJ", 0.45), **dict.fromkeys("mwMW@%", 0.86),
    **dict.fromkeys("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", 0.34), **dict.fromkeys("−–±×+=<>", 0.58),
}  # fmt: skip


def width(text: str, size: float = SIZE) -> float:
    """How wide words are, points; rather too much than too little."""
    return 1.03 * size * sum(_WIDTHS.get(letter, 0.7 if letter.isupper() else 0.51) for letter in plain(text))


def text(
    x: float, y: float, words: str, *, size: float = SIZE, anchor: str = "start", colour: str = INK, bold: bool = False,
    turned: bool = False,
) -> str:  # fmt: skip
    """Words at a place; `turned` by a quarter, upwards."""
    more = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
    heavy = ' font-weight="bold"' if bold else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}" class="f-{colour}"{heavy}{more}>'
        f"{_spans(words, size)}</text>"
    )


def _spans(words: str, size: float) -> str:
    down, back, parts = f"{LOWERED * size:.2f}", "", []
    for span in named(words):
        shift = f' dy="{back}"' if back else ""
        if not span.symbol:
            parts.append(f"<tspan{shift}>{escape(span.words)}</tspan>" if shift else escape(span.words))
            back = ""
            continue
        parts.append(f'<tspan font-style="italic"{shift}>{escape(span.words)}</tspan>')
        for k, index in enumerate(span.index):
            first = f' dy="{down}"' if k == 0 else ""
            slanted = ' font-style="italic"' if is_symbol_index(index) else ""
            comma = "," if k else ""
            parts.append(f'<tspan font-size="{INDEX * size:.2f}"{first}{slanted}>{comma}{escape(index)}</tspan>')
        back = f"-{down}" if span.index else ""
    return "".join(parts)
