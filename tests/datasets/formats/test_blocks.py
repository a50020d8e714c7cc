"""Long text files, block by block: the same table as when it is read at once."""

import gzip
import subprocess
import sys

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets import formats
from greybox_id.datasets.column_map import ColumnMap, column_map
from greybox_id.datasets.formats import blocks, text
from greybox_id.datasets.read import read

ROWS = [f"{0.01 * k:.2f},{5 + k},{0.1 * (k % 7):.3f},{k % 3}" for k in range(250)]
NAMES = "time,v_x,yaw_rate,lap"
ALL = column_map("canonical")
NONE = ColumnMap("none", ALL.time, {})


def rows(change):
    return "\n".join([NAMES, *(change(k, row) for k, row in enumerate(ROWS))]) + "\n"


REGULAR = {
    "plain": rows(lambda k, row: row),
    "whole numbers, then fractions": rows(lambda k, row: row.replace(f",{5 + k},", f",{5 + k}{'.5' * (k > 120)},")),
    "empty cells": rows(lambda k, row: row.replace(f",{5 + k},", ",,") if k > 180 else row),
    "dates": rows(lambda k, row: f"2026-03-01T10:00:{0.1 * k:06.3f},{row.partition(',')[2]}"),
    "decimal commas": rows(lambda k, row: row.replace(",", ";").replace(".", ",")).replace(
        NAMES, NAMES.replace(",", ";")
    ),
    "units": rows(lambda k, row: row).replace(NAMES, NAMES + "\ns,m/s,rad/s,"),
    "preamble": "made by a logger\n\nvehicle,7\n" + rows(lambda k, row: row),
    "means at the end": rows(lambda k, row: row) + "mean,1,2,3\n",
    "empty rows at the end": rows(lambda k, row: row) + ",,,\n,,,\n",
    "cut within the last row": rows(lambda k, row: row)[:-6],
    "CRLF": rows(lambda k, row: row).replace("\n", "\r\n"),
}
OTHER = {
    "no rows": NAMES + "\n",
    "words among the rows": rows(lambda k, row: row if k != 130 else f"{NAMES}\n{row}"),
    "comments": rows(lambda k, row: row if k != 130 else f"# began anew\n{row}"),
    "null bytes": rows(lambda k, row: row).replace("0.13,", "0.1\0,"),
    "numbers here and words there": rows(lambda k, row: row if k < 130 else f"{row[:-1]}north"),
}


@pytest.fixture(autouse=True)
def short_blocks(monkeypatch):
    monkeypatch.setattr(blocks, "ROWS", 40)
    monkeypatch.setattr(blocks, "AT_ONCE", 333)


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("name", REGULAR)
def test_it_is_the_table_that_reading_at_once_makes(tmp_path, name, zipped):
    file = tmp_path / ("log.csv.gz" if zipped else "log.csv")
    file.write_bytes(gzip.compress(REGULAR[name].encode()) if zipped else REGULAR[name].encode())
    result, right = blocks.contents(file, NONE), text.contents(file, NONE)
    assert (result.names, result.notes, result.kind) == (right.names, right.notes, right.kind)
    table, whole = (item.groups[0].load(()) for item in (result, right))
    assert (table.first_row, dict(table.units), table.names) == (whole.first_row, dict(whole.units), whole.names)
    for column in table.names:
        assert table.column(column).tolist() == pytest.approx(whole.column(column).tolist(), nan_ok=True)
        assert table.column(column).dtype == whole.column(column).dtype


@pytest.mark.parametrize("name", OTHER)
def test_what_is_no_regular_table_is_left_to_the_other_reader(tmp_path, name):
    (tmp_path / "log.csv").write_bytes(OTHER[name].encode())
    assert blocks.contents(tmp_path / "log.csv", NONE) is None


def test_only_columns_that_a_map_names_are_kept(tmp_path):
    (tmp_path / "log.csv").write_text(REGULAR["plain"])
    result = blocks.contents(tmp_path / "log.csv", ALL)
    assert result.names == tuple(NAMES.split(","))
    assert set(result.groups[0].load(()).names) == {"time", "v_x", "yaw_rate"}


def test_a_row_that_is_too_long_is_named(tmp_path):
    (tmp_path / "log.csv").write_text(rows(lambda k, row: row + ",7" * (k == 130)))
    for reader in (blocks, text):
        with pytest.raises(BadInput, match="row 132 has more cells than the header line has names"):
            reader.contents(tmp_path / "log.csv", ALL)


def test_long_files_are_read_so(tmp_path, monkeypatch):
    (tmp_path / "log.csv").write_text(REGULAR["plain"])
    once = read(tmp_path / "log.csv")
    monkeypatch.setattr(formats, "LONG", 100)
    monkeypatch.setattr(text, "contents", None)
    parts = read(tmp_path / "log.csv")
    assert once.signals.keys() == parts.signals.keys()
    for name in once.signals:
        np.testing.assert_array_equal(once[name], parts[name])


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the most memory is told in kB by Linux")
def test_five_hours_at_100_hz_are_read_in_half_a_gigabyte(tmp_path):
    rng = np.random.default_rng(1)
    names = ["time", "v_x", "yaw_rate", "a_x", "a_y", "steer", "drive_force", "further"]
    with (tmp_path / "log.csv").open("w") as file:
        file.write(",".join(names) + "\n")
        for hour in range(5):
            block = np.round(rng.standard_normal((360_000, len(names))), 5)
            block[:, 0] = 3600 * hour + 0.01 * np.arange(360_000)
            np.savetxt(file, block, "%.5f", ",")
    program = (
        "import sys; from greybox_id.datasets.read import read; r = read(sys.argv[1]); "
        "status = open('/proc/self/status').read(); print(len(r), status.split('VmHWM:')[1].split()[0])"
    )
    out = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "log.csv"], capture_output=True, check=True, text=True
    )
    length, most = map(float, out.stdout.split())
    assert length == 1_800_000
    assert most / 1024 < 512  # not of `getrusage`, which holds the most of the process that started it, too
