"""A report as one self-contained page for a browser, light or dark as the reader prefers."""

from __future__ import annotations

from html import escape
from importlib import resources
from pathlib import Path

from ..base.files import write_atomically
from ..base.guard import MARK
from .document import Document, Drawing, Formulas, Pairs, Part, Points, Section, Table, Text, Together, VerdictBox
from .equations.typesetting import in_mathml
from .figures.sheet import DARK, LIGHT
from .words import Span, clean, is_symbol_index, named, spans

STYLE = "page.css"
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content security policy of the page: it may load nothing from elsewhere."""


def write_html(document: Document, out: str | Path) -> Path:
    """Write a report as an HTML page, atomically. Raises `BadInput` if the file cannot be written."""
    return write_atomically(Path(out), page(document))


def style() -> str:
    """The style of every page, light and dark, as CSS."""
    light, dark = (
        f":root{{{''.join(f'--{name}:{colour};' for name, colour in colours.items())}}}" for colours in (LIGHT, DARK)
    )
    look = resources.files(__package__).joinpath(STYLE).read_text("utf-8")
    return f"{look}{light}@media(prefers-color-scheme:dark){{{dark}}}"


def page(document: Document) -> str:
    """The page, without control characters, so that its text is safe to show in a terminal."""
    body = "\n".join(part_html(part) for part in document.parts)
    return clean(
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<meta name="generator" content="{MARK}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(document.title)}: report of {escape(document.of)}</title>\n"
        f"<style>\n{style()}\n</style>\n</head>\n<body>\n<main>\n"
        f'<h1>{escape(document.title)}</h1>\n<p class="about">{_words(document.about)}</p>\n'
        f"{body}\n<footer>{escape(document.written_by)}, report of {escape(document.of)}</footer>\n"
        "</main>\n</body>\n</html>\n"
    )


def part_html(part: Part) -> str:
    """A part of a report as escaped HTML; its style is that of the page around it."""
    match part:
        case Section(title, level):
            return f"<h{level + 1}>{_words(title)}</h{level + 1}>"
        case Text(words, lead, small):
            first = f"<strong>{_words(lead)}</strong> " if lead else ""
            return f"<p{' class=small' if small else ''}>{first}{_words(words)}</p>"
        case Points(items):
            return f"<ul class=small>{''.join(f'<li>{_words(item)}</li>' for item in items)}</ul>"
        case VerdictBox(pairs):
            inside = "".join(f"<dt>{_words(lead)}</dt><dd>{_words(words)}</dd>" for lead, words in pairs)
            return f"<dl class=verdict>{inside}</dl>"
        case Pairs(pairs, code):
            inside = "".join(
                f"<dt>{_words(what)}</dt><dd>{f'<code>{escape(value)}</code>' if what in code else _words(value)}</dd>"
                for what, value in pairs
            )
            return f"<dl class=small>{inside}</dl>"
        case Table():
            return _table(part)
        case Formulas(equations):
            return f"<div class=formulas>{''.join(f'<div>{in_mathml(item)}</div>' for item in equations)}</div>"
        case Drawing():
            assert part.figure is not None
            caption = f"<figcaption>{_words(part.caption)}</figcaption>" if part.caption else ""
            return f"<figure>{part.figure.svg(part.alt, colours=False)}{caption}</figure>"
        case Together(parts):
            return "\n".join(part_html(part) for part in parts)


def _table(table: Table) -> str:
    classes = [
        " ".join(name for name, is_so in (("r", letter in "rR"), ("n", letter.islower())) if is_so)
        for letter in table.letters
    ]
    kinds = [f' class="{name}"' if name else "" for name in classes]
    head = "".join(f"<th{kind}>{_words(cell)}</th>" for kind, cell in zip(kinds, table.head, strict=True))
    rows = "".join(
        "<tr>"
        + "".join(
            f"<td{kind}>{_set(named(cell) if k == 0 else spans(cell))}</td>"
            for k, (kind, cell) in enumerate(zip(kinds, row, strict=True))
        )
        + "</tr>\n"
        for row in table.rows
    )
    kind = " class=dense" if table.dense else ""
    return f"<div class=wide><table{kind}><thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div>"


def _words(text: str) -> str:
    return _set(spans(text))


def _set(result: tuple[Span, ...]) -> str:
    parts = []
    for span in result:
        words = escape(span.words)
        index = ",".join(f"<i>{escape(item)}</i>" if is_symbol_index(item) else escape(item) for item in span.index)
        parts.append((f"<i>{words}</i>" if span.symbol else words) + (f"<sub>{index}</sub>" if index else ""))
    return "".join(parts)
