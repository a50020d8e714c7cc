"""Results of a fleet on disk: Parquet datasets that any tool reads, written so that kill -9 loses no result.

A result is a line of the journal as soon as it is there. Now and then, and when a run begins, the journal becomes a
part of each dataset: one file, which takes its place atomically and is not written again. A journal that is left by a
process which was killed becomes the part it was going to be, under the same name, so that no result is there twice.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from greybox_id.base.errors import BadInput
from greybox_id.base.files import held, new_folder, replacing, writable

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

SCHEMA = "2"
"""Version of the columns; kept in every file."""
MARK = "greybox_fleet"
JOURNAL = "journal"
TEXT, NUMBER, COUNT, YES = "string", "double", "int64", "bool"
COLUMNS: Mapping[str, Mapping[str, str]] = {
    "recordings": {
        "key": TEXT, "path": TEXT, "vehicle": TEXT, "time": NUMBER, "odometer": NUMBER, "tags": TEXT, "rows": COUNT,
        "seconds": NUMBER, "verdict": TEXT, "reasons": "texts", "findings": "texts", "status": TEXT, "sentence": TEXT,
        "cpu_s": NUMBER, "peak_mb": NUMBER, "version": TEXT, "refit_of": TEXT,
    },
    "parameters": {
        "key": TEXT, "vehicle": TEXT, "time": NUMBER, "name": TEXT, "unit": TEXT, "value": NUMBER, "sd": NUMBER,
        "low": NUMBER, "high": NUMBER, "dof": NUMBER, "told": YES,
    },
    "covariances": {
        "key": TEXT, "names": "texts", "units": "texts", "logarithm": "flags", "centre": "numbers", "lower": "numbers",
        "dof": "numbers", "at_bound": "flags", "prior_mean": "numbers", "prior_sd": "numbers",
    },
    "gaps": {
        "key": TEXT, "p": NUMBER, "detected": YES, "unknown": NUMBER, "effect": TEXT, "probability": NUMBER,
        "magnitude": NUMBER, "unit": TEXT, "low": NUMBER, "high": NUMBER, "aliases": "texts", "applied": YES,
    },
    "manifest": {
        "key": TEXT, "path": TEXT, "vehicle": TEXT, "time": NUMBER, "odometer": NUMBER, "tags": TEXT, "sha256": TEXT,
        "size": COUNT, "changed": COUNT,
    },
    "population": {
        "name": TEXT, "unit": TEXT, "logarithm": YES, "mean": NUMBER, "low": NUMBER, "high": NUMBER, "spread": NUMBER,
        "spread_low": NUMBER, "spread_high": NUMBER, "vehicles": COUNT, "recordings": COUNT, "mu": NUMBER,
        "mu_sd": NUMBER, "tau": NUMBER,
    },
    "vehicles": {
        "vehicle": TEXT, "name": TEXT, "unit": TEXT, "recordings": COUNT, "time": NUMBER, "value": NUMBER,
        "low": NUMBER, "high": NUMBER, "next_low": NUMBER, "next_high": NUMBER, "outlier": NUMBER, "sentence": TEXT,
    },
    "drift": {
        "vehicle": TEXT, "name": TEXT, "unit": TEXT, "model": TEXT, "over": TEXT, "probability": NUMBER, "p": NUMBER,
        "drifts": YES, "change": NUMBER, "low": NUMBER, "high": NUMBER, "at": NUMBER, "at_low": NUMBER,
        "at_high": NUMBER, "at_time": NUMBER, "at_time_low": NUMBER, "at_time_high": NUMBER, "at_key": TEXT,
        "recordings": COUNT, "sentence": TEXT,
    },
    "apart": {
        "key": TEXT, "path": TEXT, "vehicle": TEXT, "time": NUMBER, "name": TEXT, "unit": TEXT, "value": NUMBER,
        "low": NUMBER, "high": NUMBER, "distance": NUMBER, "p": NUMBER, "sentence": TEXT,
    },
}  # fmt: skip
"""Dataset -> column -> kind. Units are SI; time is s since 1970 in UTC, odometer m."""
OF_RESULTS = ("recordings", "parameters", "covariances", "gaps")
"""Datasets that a run adds to; the others are made anew each time, in one file."""
ESTIMATED = ("population", "vehicles", "drift", "apart")
"""Those that an estimate makes."""


class Store:
    """A folder of results.

    Parameters
    ----------
    folder : where; it is made by `opened`.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    @classmethod
    def existing(cls, folder: str | Path) -> Store:
        """The results of a fleet that was run. Raises `BadInput` where there are none."""
        store = cls(folder)
        if not (store.folder / "manifest").is_dir():
            raise BadInput(f"{folder} holds no results of a fleet; make them: greybox fleet run fleet.toml.")
        return store

    @contextmanager
    def opened(self) -> Iterator[Store]:
        """The folder, for one run at a time, with what a killed run left in order.

        Raises
        ------
        BadInput : it cannot be written to, holds something else, or another run is at work.
        """
        with writable(self.folder):
            if self.folder.exists() and not self.folder.is_dir():
                raise BadInput(f"{self.folder} is a file; name another folder with ‹out›.")
            strangers = [item.name for item in self._inside() if item.name not in (*COLUMNS, JOURNAL, "fleet.json")]
            if strangers and not (self.folder / "manifest").is_dir():
                raise BadInput(
                    f"{self.folder} holds {strangers[0]}, and no results of a fleet; name another with ‹out›."
                )
            (self.folder / JOURNAL).mkdir(parents=True, exist_ok=True)
        with held(self.folder):
            for left in self._journals():
                self._settle(left)
            for name in OF_RESULTS:  # readers find every dataset, with no rows if need be
                if not self.parts(name):
                    self.replace(name, ())
            yield self

    def _inside(self) -> list[Path]:
        if not self.folder.is_dir():
            return []
        return [path for path in self.folder.iterdir() if not path.name.startswith((".", "report", "prior"))]

    def done(self) -> dict[str, str]:
        """Key -> status of what is done."""
        table = self.read("recordings", ["key", "status"])
        return dict(zip(table["key"], table["status"], strict=True))

    def read(self, name: str, columns: list[str] | None = None) -> pd.DataFrame:
        """A dataset as a table; without rows where there is none."""
        import pyarrow as pa

        tables = [_read(file, columns) for file in self.parts(name)]
        if not tables:
            made = schema(name).empty_table()
            tables = [made.select(columns) if columns else made]
        result: pd.DataFrame = pa.concat_tables(tables).to_pandas()
        return result

    def current(self) -> pd.DataFrame:
        """Rows of recordings that the fleet has now; those of files that changed or are gone are left out."""
        keys = self.read("manifest", ["key"])["key"]
        recordings = self.read("recordings")
        return recordings[recordings["key"].isin(set(keys))].reset_index(drop=True)

    def refits(self) -> pd.DataFrame:
        """Rows of recordings that the fleet has now and that were fitted again, by the keys of their first fits."""
        keys = self.read("manifest", ["key"])["key"]
        recordings = self.read("recordings")
        return recordings[recordings["refit_of"].isin(set(keys))].reset_index(drop=True)

    def parts(self, name: str) -> list[Path]:
        """The files of a dataset, oldest first."""
        return sorted((self.folder / name).glob("*.parquet"))

    def replace(self, name: str, rows: Iterable[Mapping[str, Any]]) -> None:
        """Make a dataset anew, as one file."""
        self._write(self.folder / name / "part-000000.parquet", table_of(name, rows))

    def keep(self, keys: set[str]) -> None:
        """Rewrite the results so that they are those of some keys alone, each in one part: what compaction does."""
        import pyarrow as pa
        import pyarrow.compute as pc

        for name in reversed(OF_RESULTS):
            parts = self.parts(name)
            if not parts:
                continue
            whole = pa.concat_tables([_read(file, None) for file in parts])
            kept = whole.filter(pc.is_in(whole["key"], pa.array(sorted(keys), pa.string())))
            with new_folder(self.folder / name) as made:
                _written(kept, made / parts[-1].name)

    def journal(self) -> Journal:
        """A journal to add results to."""
        seen = [int(file.stem.split("-")[-1]) for name in OF_RESULTS for file in self.parts(name)]
        return Journal(self, max(seen, default=0) + 1)

    def waiting(self) -> dict[str, str]:
        """Key -> status of what is done and is no part yet."""
        ended = [result["recordings"][0] for file in self._journals() for result in _results(file)]
        return {item["key"]: item["status"] for item in ended}

    def _journals(self) -> list[Path]:
        return sorted((self.folder / JOURNAL).glob("*.jsonl"))

    def _settle(self, file: Path) -> None:
        """Make parts of a journal's lines, then remove it."""
        rows: dict[str, list[Mapping[str, Any]]] = {name: [] for name in OF_RESULTS}
        seen = set[str]()
        for result in _results(file):
            if result["recordings"][0]["key"] in seen:
                continue
            seen.add(result["recordings"][0]["key"])
            for name in OF_RESULTS:
                rows[name] += result.get(name, [])
        for name in reversed(OF_RESULTS):  # what says that a result is there comes last
            if rows[name]:
                self._write(self.folder / name / f"part-{file.stem}.parquet", table_of(name, rows[name]))
        file.unlink()

    def _write(self, file: Path, table: pa.Table) -> None:
        with replacing(file, continued=True) as beside:
            _written(table, beside)


class Journal:
    """Where results go, one line each, until they are made parts."""

    MOST = 1000
    """Results of one part."""

    def __init__(self, store: Store, number: int) -> None:
        self._store, self._number, self._held = store, number, 0
        self._file: Any = None

    def add(self, result: Mapping[str, Any]) -> None:
        """Keep a result: dataset -> rows."""
        if self._file is None:
            self._file = (self._store.folder / JOURNAL / f"{self._number:06d}.jsonl").open("ab", buffering=0)
        self._file.write(json.dumps(result).encode() + b"\n")
        self._held += 1
        if self._held >= self.MOST:
            self.settle()

    def settle(self) -> None:
        """Make parts of what is held."""
        if self._file is None:
            return
        name = Path(self._file.name)
        self._file.close()
        self._file, self._held = None, 0
        self._number += 1
        self._store._settle(name)


def _results(journal: Path) -> Iterator[dict[str, Any]]:
    """The results of a journal; a line that was not finished is none, and one that became a part meanwhile has none."""
    with suppress(FileNotFoundError):
        for line in journal.read_bytes().split(b"\n")[:-1]:
            with suppress(ValueError):
                yield json.loads(line)


def schema(name: str) -> pa.Schema:
    """The columns of a dataset."""
    import pyarrow as pa

    kinds = {
        TEXT: pa.string(), NUMBER: pa.float64(), COUNT: pa.int64(), YES: pa.bool_(), "texts": pa.list_(pa.string()),
        "numbers": pa.list_(pa.float64()), "flags": pa.list_(pa.bool_()),
    }  # fmt: skip
    known = {MARK: name, f"{MARK}_schema": SCHEMA}
    return pa.schema([(column, kinds[kind]) for column, kind in COLUMNS[name].items()], metadata=known)


def table_of(name: str, rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    """Rows as a table; numbers that are not there are null, infinite ones stay."""
    import pyarrow as pa

    listed = list(rows)
    columns = {column: [_cell(row.get(column)) for row in listed] for column in COLUMNS[name]}
    return pa.table(columns, schema=schema(name))


def _cell(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value


def _written(table: pa.Table, file: Path) -> None:
    import pyarrow.parquet as pq

    pq.write_table(table, file, compression="zstd")


def _read(file: Path, columns: list[str] | None) -> pa.Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        result = pq.ParquetFile(file).read(columns)
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = next(iter(str(error).splitlines()), "")
        raise BadInput(
            f"{file} is damaged ({reason:.100}); restore it, or remove it and run the fleet again."
        ) from error
    known = (result.schema.metadata or {}).get(f"{MARK}_schema".encode(), b"").decode()
    if known != SCHEMA:
        was = f"columns of version {known}" if known else "no results of a fleet"
        raise BadInput(
            f"{file} holds {was}; this version of greybox-id reads version {SCHEMA}. Run the fleet into a new folder."
        )
    return result
