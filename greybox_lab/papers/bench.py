"""The frame of all benches: rows that stand beside published ones, and a page of them, the same for every bench.

What benches of papers share: what was measured so far, in a file that a later run goes on from, and report pages.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from greybox_id.base.errors import BadInput
from greybox_id.base.files import ensure_writable, write_atomically
from greybox_id.base.guard import PAGE_MARK, claim
from greybox_id.base.json_data import Kind, checksum, plain
from greybox_id.base.numbers import number, with_sd
from greybox_id.base.shorthands import Array
from greybox_id.base.version import __version__
from greybox_id.reports.document import Document, Part, Points, Section, Table, Text, titled
from greybox_id.reports.html import write_html
from greybox_id.reports.pdf import write_pdf


@dataclass(frozen=True)
class Row:
    """One figure of a bench.

    Attributes
    ----------
    task : what is measured, and on what.
    model : whose figure it is.
    value : in `unit`.
    unit : SI, or as the source prints it.
    spread : standard error, or half an interval of 95 % where `task` says so; None where there is none.
    parameters : free numbers of the model; None where that means nothing.
    cpu_seconds : of this machine, for fitting; None for what was not run.
    published : whether it is the authors' printed figure.
    """

    task: str
    model: str
    value: float
    unit: str
    spread: float | None = None
    parameters: int | None = None
    cpu_seconds: float | None = None
    published: bool = False


@dataclass(frozen=True)
class PublishedBench:
    """What a bench measured.

    Attributes
    ----------
    name : as the command calls it.
    title, about : the head of its page.
    protocol : sentences: the task, what chose what, what is scored.
    rows : in order; those of one task stand in one table.
    answers : sentences that say first what a reader does with the tables.
    found : further plain data, for --json.
    """

    name: str
    title: str
    about: str
    protocol: tuple[str, ...]
    rows: tuple[Row, ...]
    answers: tuple[str, ...] = ()
    found: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        rows = [asdict(row) for row in self.rows]
        return {"bench": self.name, "answers": list(self.answers), "rows": rows, "found": dict(self.found)}

    def document(self) -> Document:
        """The page."""
        tasks = dict.fromkeys(row.task for row in self.rows)
        parts: tuple[Part, ...] = (
            *titled("Answer", Points(self.answers)),
            *(part for task in tasks for part in titled(task, table([row for row in self.rows if row.task == task]))),
            *titled("How it was measured", Points(self.protocol)),
        )
        return Document(self.title, self.about, "a bench", f"greybox-id {__version__}", parts)


def table(rows: Sequence[Row]) -> Table:
    """Rows of one task, the authors' marked."""
    body = tuple(
        (f"{row.model} (published)" if row.published else row.model, _with_spread(row),
         "–" if row.parameters is None else str(row.parameters),
         "–" if row.cpu_seconds is None else number(row.cpu_seconds, 2))
        for row in rows
    )  # fmt: skip
    return Table(("model", rows[0].unit, "parameters", "CPU s"), body, "lrrr")


def _with_spread(row: Row) -> str:
    return number(row.value, 3) if row.spread is None else with_sd(row.value, row.spread)


def markdown(document: Document, command: str) -> str:
    """A page without its figures, for the documentation; `command` made it."""
    lines = [PAGE_MARK, "", f"# {document.title}", "", document.about, "", f"    {command}", ""]
    for part in document.flat:
        match part:
            case Section():
                lines += [f"## {part.title}", ""]
            case Points():
                lines += [*(f"- {item}" for item in part.items), ""]
            case Text():
                lines += [f"{f'**{part.lead}** ' if part.lead else ''}{part.words}", ""]
            case Table():
                rules = [":---" if letter.lower() == "l" else "---:" for letter in part.letters]
                cells = [part.head, tuple(rules), *part.rows]
                lines += [*(f"| {' | '.join(one.replace('|', '∣') for one in row)} |" for row in cells), ""]
    return "\n".join(lines).rstrip() + "\n"


def frame(data: Path, name: str, columns: Sequence[str], fetched: str) -> pd.DataFrame:
    """A recording's columns as the authors wrote them.

    Parameters
    ----------
    data : folder.
    name : of the file, without .csv or .csv.gz.
    columns : that it must have, as numbers.
    fetched : the dataset that `greybox datasets fetch` knows it by.

    Raises
    ------
    BadInput : it is not there, or is none of these.
    """
    must_be_folder(data, f"{name}.csv")
    path = next((item for item in (data / f"{name}.csv.gz", data / f"{name}.csv") if item.is_file()), None)
    if path is None:
        raise BadInput(
            f"{data / name}.csv is not there; greybox datasets fetch {fetched} downloads it, or name its folder."
        )
    try:
        one = pd.read_csv(path)
        missing = [column for column in columns if column not in one]
        if missing:
            raise BadInput(f"{path} has no column {missing[0]}; its columns are {', '.join(map(str, one.columns))}.")
        values = one[list(columns)].astype(float)
    except (OSError, ValueError, EOFError) as error:
        raise BadInput(f"{path} cannot be read as a table of numbers ({error}); fetch it again.") from error
    if len(values) < LEAST_ROWS or not np.isfinite(values.to_numpy()).all():
        raise BadInput(f"{path} needs {LEAST_ROWS} rows or more, all of them numbers; it has {len(values)}.")
    return values


def must_be_folder(data: Path, files: str) -> None:
    """Raise `BadInput` where the folder of recordings is none."""
    if not data.is_dir():
        raise BadInput(f"{data} is not a folder; name the folder that holds {files} (‹data›).")


def hashes(data: Path | None) -> dict[str, str]:
    """File -> SHA-256, hexadecimal, of the recordings in a folder; empty where there is none."""
    files = sorted(data.iterdir()) if data is not None and data.is_dir() else []
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files if file.suffix in RECORDED}


RECORDED = (".csv", ".gz", ".parquet", ".json")
"""Suffixes of what benches read."""
LEAST_ROWS = 200
"""Ten seconds at 20 Hz."""


def rmse(errors: Array) -> float:
    """Root mean square of what is known."""
    return float(np.sqrt(np.nanmean(errors**2)))


@contextmanager
def clocked() -> Iterator[list[float]]:
    """CPU seconds of this process, appended at the end."""
    spent: list[float] = []
    start = time.process_time()
    yield spent
    spent.append(time.process_time() - start)


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
        place = None if out is None else Path(out)
        self.file = place / f"{paper}.json" if place and place.suffix.lower() != ".json" else place
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
