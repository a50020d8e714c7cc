"""Files that grow beyond reason once they are laid out end in a sentence with the size and the limit."""

import gzip
import resource
import subprocess
import sys

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets import formats
from greybox_id.datasets.formats import LARGEST, MOST_COLUMNS
from greybox_id.datasets.read import read

BOMB = """
import resource, sys
sys.path[:] = {path!r}
from greybox_id.cli import main
resource.setrlimit(resource.RLIMIT_AS, (int({most}), int({most})))
main()
"""


def read_apart(file, most=3.5e9):
    """Exit code, sentence and seconds of the processor's time of `data check`, with so many bytes of memory at most."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", BOMB.format(path=sys.path, most=most), "data", "check", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.returncode, done.stderr, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.parametrize("longer", [True, False])
def test_memory_is_given_back_beside_long_files_alone(tmp_path, monkeypatch, longer):
    file, given = tmp_path / "lap.csv", []
    file.write_text("time,v_x\n0.0,1.0\n0.1,1.0\n", encoding="utf-8")
    monkeypatch.setattr(formats, "LONG", file.stat().st_size - longer)
    monkeypatch.setattr(formats, "give_back", lambda: given.append(file))
    read(file)
    assert given == [file] * longer


def test_a_zipped_file_that_grows_without_end_is_not_laid_out(tmp_path):
    file = tmp_path / "lap.csv.gz"
    piece = gzip.compress(b"0.0,1.0\n" * (1 << 20), 9)
    file.write_bytes(gzip.compress(b"time,v_x\n") + piece * 550)  # members of 8 MB each
    assert file.stat().st_size < 8e6
    code, said, seconds = read_apart(file)
    assert (code, "Traceback" in said) == (2, False)
    assert "more than 1 GB" in said
    assert seconds < 30


def test_a_table_of_absurd_length_is_not_laid_out(tmp_path):
    file = tmp_path / "lap.parquet"
    rows = 20_000_000
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int8)), pa.array([1.0]))
    table = pa.table({"time": column, "v_x": column})
    with pq.ParquetWriter(file, table.schema, compression="zstd") as writer:
        for _ in range(4):
            writer.write_table(table)
    assert file.stat().st_size < 1e6
    code, said, seconds = read_apart(file)
    assert (code, "Traceback" in said) == (2, False)
    assert "1.28 GB" in said
    assert "1 GB are read at most" in said
    assert seconds < 30


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz"])
def test_a_million_columns_are_not_told_apart(suffix, tmp_path):
    file = tmp_path / f"lap{suffix}"
    text = ",".join(["time", "v_x", *(f"c{k}" for k in range(1_000_000))]) + "\n"
    text += ("0" + ",1" * 1_000_001 + "\n") * 3
    file.write_bytes(gzip.compress(text.encode(), 1) if suffix.endswith("gz") else text.encode())
    code, said, seconds = read_apart(file)
    assert (code, "Traceback" in said) == (2, False)
    assert "has 1000002 columns, and 20000 are read at most" in said
    assert seconds < 20


def test_too_many_columns_of_parquet_are_a_sentence(tmp_path, monkeypatch):
    file = tmp_path / "lap.parquet"
    pd.DataFrame({f"c{k}": [1.0] for k in range(12)}).to_parquet(file)
    monkeypatch.setattr(sys.modules["greybox_id.datasets.formats"], "MOST_COLUMNS", 10)
    with pytest.raises(BadInput, match="has 12 columns, and 10 are read at most"):
        read(file)


def test_a_plain_file_beyond_the_limit_is_not_read(tmp_path):
    file = tmp_path / "lap.csv"
    with file.open("wb") as opened:
        opened.write(b"time,v_x\n0,1\n")
        opened.truncate(LARGEST + 1)
    with pytest.raises(BadInput, match="1 GB are read at most"):
        read(file)


def test_of_a_parquet_file_only_mapped_columns_are_laid_out(tmp_path):
    file, rows = tmp_path / "lap.parquet", 1000
    table = {f"other{k}": np.zeros(rows) for k in range(300)} | {"time": np.arange(rows) / 100, "v_x": np.ones(rows)}
    pq.write_table(pa.table({**table, "a.b": np.ones(rows)}), file)
    assert list(read(file).signals) == ["v_x"]
    assert MOST_COLUMNS > 10_000
