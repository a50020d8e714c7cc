"""One small sound file of every kind, to be damaged."""

from __future__ import annotations

import gzip
import sys
from contextlib import redirect_stdout
from pathlib import Path

import h5py
import numpy as np

from greybox_id import datasets
from greybox_id.cli import main
from greybox_id.datasets.formats import write
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.shipped import shipped

WRITTEN = ("csv", "parquet", "mat", "h5", "mcap", "mf4")
KINDS = (*WRITTEN, "csv.gz", "mat73", "db3", "columns", "vehicle", "fit")
"""Recordings by suffix (mat73: a MAT file of version 7.3), a column map, a vehicle, a fit."""
PACKAGE = Path(datasets.__file__).parent


def sound_files(folder: Path) -> dict[str, Path]:
    """Make them."""
    folder.mkdir(parents=True, exist_ok=True)
    lap = read(shipped("racer_valid"), "roboracer").rows(0, 100)
    files = {kind: folder / f"lap.{kind}" for kind in KINDS}
    for kind in WRITTEN:
        write(lap, files[kind])
    files["csv.gz"].write_bytes(gzip.compress(files["csv"].read_bytes()))
    _mat73(lap, files["mat73"])
    _db3(lap, folder / "bag", files["db3"])
    files["columns"].write_bytes((PACKAGE / "columns" / "canonical.toml").read_bytes())
    vehicle = PACKAGE / "vehicles" / "roboracer.toml"
    files["vehicle"].write_bytes(vehicle.read_bytes())
    arguments = ["fit", "--model", "lateral", "--vehicle", str(vehicle), str(files["csv"]), "--out", str(folder)]
    before, sys.argv = sys.argv, ["greybox", *arguments]
    try:
        with redirect_stdout(sys.stderr):
            main()
    except SystemExit as ended:
        if ended.code not in (0, 3):  # 3: written, though a hundred rows make no usable fit
            raise
    finally:
        sys.argv = before
    files["fit"] = folder / "fit.json"
    return files


def _mat73(lap: Recording, file: Path) -> None:
    with h5py.File(file, "w", userblock_size=512) as made:
        for name, values in {"time": lap.time, **lap.signals}.items():
            made["log/" + name] = np.reshape(values, (1, -1))
    with file.open("r+b") as opened:
        opened.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _db3(lap: Recording, folder: Path, file: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/Float64"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for name, values in lap.signals.items():
            connection = writer.add_connection(f"/{name}", kind, typestore=store)
            for when, value in zip(range(10**18, 10**18 + len(lap), 1), values.tolist(), strict=True):
                message = store.types[kind](value)
                writer.write(connection, 10**18 + (when - 10**18) * 50_000_000, store.serialize_cdr(message, kind))
    next(folder.glob("*.db3")).replace(file)
