"""What a body holds is looked at here, in a process that bodies may take along: see `bodies.BodyChecks`."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from greybox_id.api.diagnosing import must_be_diagnosable
from greybox_id.base.errors import BadInput
from greybox_id.base.files import replacing
from greybox_id.base.toml_file import parse_toml
from greybox_id.datasets.read import read
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import motion_model_of, vehicle_parameters
from greybox_id.models.vehicle import Vehicle, parse_vehicle

from .protocol import GZIP, LARGEST, PARQUET
from .swap import drivers_policy

NAMES = {"rows": "The body of rows", "policy": "The policy", "vehicle": "The vehicle file"}


class TooLarge(BadInput):
    """More than a body may hold."""


def checked(job: dict[str, str], tell: Callable[[dict[str, Any]], None]) -> None:
    """Check the file of a body; tells how many rows it has, or why it is refused."""
    file, kind = Path(job["file"]), job["kind"]
    try:
        rows = 0
        if kind == "rows":
            rows = usable_rows(file, vehicle_of(job["vehicle"]))
        elif kind == "policy":
            drivers_policy(file)
        else:
            vehicle_of(file.read_text("utf-8"))
        tell({"rows": rows})
    except BadInput as error:
        sentence = str(error).replace(str(file), NAMES[kind]).replace(file.stem, NAMES[kind])
        tell({"status": 413 if isinstance(error, TooLarge) else 422, "refused": sentence})


def vehicle_of(text: str) -> Vehicle:
    """A vehicle from the text of its file, which names no other file. Raises `BadInput`."""
    if "tyre_file" in parse_toml(text, "vehicle.toml"):
        raise BadInput("tyre_file: a vehicle file that is sent names no other file; write the tyre's parameters in it.")
    vehicle = parse_vehicle(text, Path("vehicle.toml"), vehicle_parameters(), EFFECTS)
    motion_model_of(vehicle)
    return vehicle


def usable_rows(file: Path, vehicle: Vehicle) -> int:
    """How many rows a file holds that a vehicle recorded. Raises `BadInput` where they cannot be diagnosed."""
    unpack(file)
    model, recording = motion_model_of(vehicle), read(file)
    must_be_diagnosable(model, [recording])
    needed = [name for name in ("v_x", "yaw_rate", *model.inputs) if name in recording]
    bare = [name for name in needed if not np.any(np.isfinite(recording[name]))]
    if bare:
        raise BadInput(f"rows: {bare[0]} holds no number.")
    return len(recording)


def unpack(file: Path) -> None:
    """Unpack a file in its place. Raises `TooLarge` where it would be larger than a body."""
    with file.open("rb") as opened:
        begins = opened.read(4)
    if begins == PARQUET:
        _bounded_parquet(file)
    if not begins.startswith(GZIP):
        return
    try:
        with gzip.open(file) as opened:
            body = opened.read(LARGEST + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise BadInput(f"{file} is damaged: it cannot be unzipped ({error}).") from error
    if len(body) > LARGEST:
        raise TooLarge(f"{file} has more than {LARGEST >> 20} MB once it is unzipped; send it in parts.")
    with replacing(file, continued=True) as beside:
        beside.write_bytes(body)


def _bounded_parquet(file: Path) -> None:
    """Columns of one number a million times take no room in a file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        about = pq.read_metadata(file)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise BadInput(f"{file} is damaged: it is not a Parquet file ({str(error).splitlines()[0]}).") from error
    if 8 * about.num_rows * about.num_columns > LARGEST:
        raise TooLarge(f"{file} has more than {LARGEST >> 23} million numbers; send it in parts.")
