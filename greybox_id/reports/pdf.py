"""A report as PDF: reproducible byte by byte, self-contained, with all fonts embedded."""

from __future__ import annotations

import json
import struct
import tempfile
import zlib
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import typst

from ..base.errors import BadInput
from ..base.files import replacing
from ..base.guard import MARK
from .document import Document, Drawing, Formulas, Pairs, Part, Points, Section, Table, Text, Together, VerdictBox
from .equations.typesetting import in_typst
from .words import Span, is_symbol_index, named, spans

LAYOUT = "document.typ"


def write_pdf(document: Document, out: str | Path) -> Path:
    """Write a report as PDF, atomically. Raises `BadInput` if the file cannot be written."""
    return _write(rendered(document), Path(out))


def write_png(document: Document, out: str | Path, dots_per_inch: int = 150) -> Path:
    """Write the first page of a report as PNG, atomically. Raises `BadInput` if the file cannot be written."""
    return _write(_marked(rendered(document, "png", dots_per_inch)), Path(out))


def rendered(document: Document, kind: Literal["pdf", "png"] = "pdf", dots_per_inch: int = 150) -> bytes:
    """The bytes of the PDF, or of its first page as PNG. They contain no date, so they depend on the content alone.

    Raises
    ------
    BadInput : if the folder for temporary files cannot be written.
    """
    try:
        return _rendered(document, kind, dots_per_inch)
    except OSError as error:
        raise BadInput(
            f"Pages cannot be laid out in {tempfile.gettempdir()}: {error.strerror or error}. Make room there, or name "
            "another folder in TMPDIR."
        ) from error


def _rendered(document: Document, kind: Literal["pdf", "png"], dots_per_inch: int) -> bytes:
    with tempfile.TemporaryDirectory(prefix="greybox-") as name:
        folder = Path(name)
        text = resources.files(__package__).joinpath(LAYOUT).read_text("utf-8")
        (folder / LAYOUT).write_text(text, encoding="utf-8")
        tree = json.dumps(as_plain_data(document), ensure_ascii=False)
        (folder / "document.json").write_text(tree, encoding="utf-8")
        for one in document.drawings:
            (folder / f"{one.name}.svg").write_text(one.svg, encoding="utf-8")
        pages = typst.compile(
            str(folder / LAYOUT),
            root=str(folder),
            format=kind,
            ppi=float(dots_per_inch),
            timestamp=0,
            ignore_system_fonts=True,  # same report on all computers
        )
    result = pages[0] if isinstance(pages, list) else pages
    assert isinstance(result, bytes)
    return result


def as_plain_data(document: Document) -> dict[str, Any]:
    """The tree of parts as input for the layout."""
    return {
        "title": document.title,
        "about": _spans(document.about),
        "of": document.of,
        "written_by": document.written_by,
        "endless": document.endless,
        "parts": [_part(part) for part in document.parts],
    }


def _part(part: Part) -> dict[str, Any]:
    match part:
        case Section():
            return {"kind": "section", "title": _spans(part.title), "level": part.level}
        case Text():
            entry = {"words": _spans(part.words), "lead": _spans(part.lead), "small": part.small}
            return {"kind": "text"} | entry
        case Points():
            return {"kind": "points", "items": [_spans(item) for item in part.items]}
        case VerdictBox():
            return {"kind": "verdict", "pairs": [[_spans(lead), _spans(words)] for lead, words in part.pairs]}
        case Pairs():
            pairs = [
                {"what": _spans(what), "value": value, "spans": _spans(value), "code": what in part.code}
                for what, value in part.pairs
            ]
            return {"kind": "pairs", "pairs": pairs}
        case Table():
            rows = [
                [{"spans": _plain(named(cell) if k == 0 else spans(cell))} for k, cell in enumerate(row)]
                for row in part.rows
            ]
            size = 8.2 if part.dense else 8.6
            head = [_spans(cell) for cell in part.head]
            return {"kind": "table", "head": head, "rows": rows, "letters": list(part.letters), "size": size}
        case Formulas():
            return {"kind": "formulas", "lines": [in_typst(equation) for equation in part.equations]}
        case Drawing():
            return {"kind": "figure", "name": part.name, "alt": part.alt, "caption": _spans(part.caption)}
        case Together():
            return {"kind": "together", "parts": [_part(part) for part in part.parts]}


def _spans(words: str) -> list[dict[str, Any]]:
    return _plain(spans(words))


def _plain(result: tuple[Span, ...]) -> list[dict[str, Any]]:
    return [
        {
            "words": span.words,
            "symbol": span.symbol,
            "index": [{"words": item, "letter": is_symbol_index(item)} for item in span.index],
        }
        for span in result
    ]


def _marked(png: bytes) -> bytes:
    """A PNG with the name of this software after its header, which is 33 bytes long."""
    words = b"tEXtSoftware\0" + MARK.encode()
    chunk = struct.pack(">I", len(words) - 4) + words + struct.pack(">I", zlib.crc32(words))
    return png[:33] + chunk + png[33:]


def _write(content: bytes, target: Path) -> Path:
    with replacing(target) as beside:
        beside.write_bytes(content)
    return target
