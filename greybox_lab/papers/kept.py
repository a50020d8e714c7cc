"""What benches of papers share: what was measured so far, in a file that a later run goes on from, and report pages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from greybox_id.base.errors import BadInput
from greybox_id.base.files import ensure_writable, write_atomically
from greybox_id.base.guard import claim
from greybox_id.base.json_data import checksum, plain
from greybox_id.base.saved import Kind
from greybox_id.reports.document import Document
from greybox_id.reports.html import write_html
from greybox_id.reports.pdf import write_pdf

from .bench import markdown

BENCH = Kind("greybox-bench", 1, "a bench", "greybox bench", "run it again")


class KeptBench:
    """What a bench has measured so far.

    Parameters
    ----------
    paper : whose tables they are, as the command calls it.
    out : a file to keep it in, or a folder, whose file bears the paper's name; None keeps nothing.
    minutes : after so many, trainings that are not kept already are left out.

    Raises
    ------
    BadInput : what is there is no bench of this paper, or cannot be written.
    """

    def __init__(self, paper: str, out: str | Path | None = None, minutes: float | None = None) -> None:
        self.paper, self.left_out = paper, 0
        self.file = None if out is None else _file_of(Path(out), paper)
        self._body: dict[str, Any] = {}
        self._end = time.monotonic() + 60.0 * minutes if minutes is not None else float("inf")
        if self.file is not None:
            claim(self.file, becomes="a bench")
            if self.file.is_file() and self.file.stat().st_size:
                self._body = BENCH.load(self.file, self._sound, going_on=True)
            ensure_writable(self.file.parent)

    def training(self, about: Mapping[str, Any], train: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any] | None:
        """A training that was kept, or is made now and kept; None where there is no time left for it.

        Parameters
        ----------
        about : plain data that tell it from others: model, size, windows, seed, hashes of what it is trained on.
        train : makes it, as plain data.
        """
        key = str(checksum(plain(about)))
        result: dict[str, Any] = self._body.setdefault("trainings", {})
        if key not in result:
            if time.monotonic() > self._end:
                self.left_out += 1
                return None
            result[key] = {"about": dict(about), **train()}
            self.keep()
        value: Mapping[str, Any] = result[key]
        return value

    def keep(self, **more: Any) -> None:
        """Write what there is, and more, atomically."""
        self._body.update(more)
        if self.file is not None:
            body = {"paper": self.paper, **{name: item for name, item in self._body.items() if name != "paper"}}
            write_atomically(self.file, BENCH.text(body), continued=True)

    def _sound(self, body: Mapping[str, Any]) -> dict[str, Any]:
        if body["paper"] != self.paper:
            raise BadInput(f"{self.file} holds the bench of {body['paper']!r:.40}; name another place with ‹out›.")
        trainings = body.get("trainings", {})
        if not all(isinstance(training, dict) for training in trainings.values()):
            raise ValueError("its trainings are none")
        return {"trainings": trainings} if trainings else {}


def _file_of(out: Path, paper: str) -> Path:
    return out if out.suffix.lower() == ".json" else out / f"{paper}.json"


def pages_of(report: str | Path | None, name: str) -> tuple[Path, ...]:
    """Where pages go, with the right to write them: a .md file as it is named, or NAME.html and NAME.pdf in a folder.

    Raises
    ------
    BadInput : it cannot be written, or something else is there.
    """
    if report is None:
        return ()
    place = Path(report)
    pages = (place,) if place.suffix.lower() == ".md" else (place / f"{name}.html", place / f"{name}.pdf")
    for page in pages:
        claim(page, "‹report›", becomes="a report")
    ensure_writable(pages[0].parent)
    return pages


def write_pages(document: Document, pages: Iterable[Path], command: str) -> list[Path]:
    """Write a page for a browser, as PDF or for the documentation, by its suffix, each atomically."""
    written = []
    for page in pages:
        match page.suffix.lower():
            case ".md":
                written.append(write_atomically(page, markdown(document, command)))
            case ".html":
                written.append(write_html(document, page))
            case _:
                written.append(write_pdf(document, page))
    return written
