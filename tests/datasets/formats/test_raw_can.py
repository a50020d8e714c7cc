"""Raw frames of a CAN bus are no signals: a sentence says to decode them."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.formats.text import csv_table


def payload(k, size=8):
    return np.random.default_rng(k).bytes(size)


def spaced(k):
    return payload(k).hex(" ")


LAYOUTS = {
    "openpilot's": ("time,bus,id,data", lambda t, k: f"{t},0,0x{k % 7 + 580:x},{payload(k).hex()}"),
    "numbers of identifiers": ("time,addr,bus,data", lambda t, k: f"{t},{k % 7 + 580},1,{payload(k).hex().upper()}"),
    "bytes with blanks": ("timestamp;id;dlc;data", lambda t, k: f"{t};{k % 7 + 580:03X};8;{spaced(k)}"),
    "Python's bytes": ("time,address,dat", lambda t, k: f"{t},{k % 7 + 580},{payload(k).replace(b',', b'.')!r}"),
    "a column for each byte": (
        "Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8",
        lambda t, k: f"{t},{k % 7 + 580:08X},false,0,8,{spaced(k).replace(' ', ',')}",
    ),
    "candump": ("", lambda t, k: f"({1.6e9 + t:.6f}) can0 {k % 7 + 580:03X}#{payload(k).hex().upper()}"),
    "an ASC file": ("date Sat Nov 28 10:00:00 2026", lambda t, k: f"   {t} 1  {k % 7 + 580:X}  Rx d 8 {spaced(k)}"),
}


def read(head, row):
    lines = [*([head] if head else []), *(row(round(0.01 * k, 2), k) for k in range(200))]
    return csv_table(("\n".join(lines) + "\n").encode(), "drive.csv")[0]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_raw_frames_are_to_be_decoded_first(layout):
    with pytest.raises(BadInput, match=r"drive\.csv holds raw CAN frames.*DBC file"):
        read(*LAYOUTS[layout])


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("time,id,data", lambda t, k: f"{t},{'speed' if k % 2 else 'yaw_rate'},{10 + k % 80}"),
        ("time,id,speed", lambda t, k: f"{t},{k},{k % 80 + 1}"),
        ("time,id,data", lambda t, k: f"{t},{k % 3},{k % 90 + 10}"),
        ("time,speed,hash", lambda t, k: f"{t},{k % 80},{payload(k).hex()}"),
    ],
    ids=["a long table", "a counter of rows", "numbers of two digits", "a checksum of each row"],
)
def test_tables_of_signals_are_read(head, row):
    assert len(read(head, row)) == 200
