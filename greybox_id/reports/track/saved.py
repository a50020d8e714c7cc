"""The file of a track: what its report shows, and what the track was made with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...filters.findings import Consistency
from ...parameter import Array
from ...provenance import DataRecord
from ...saved import Kind
from .digest import Course, Digest, Estimate, Innovations, Measured, NoiseSize, TrackMade

KIND = Kind("greybox-track", 1, "a track", "greybox track", "track again")


def as_text(digest: Digest) -> str:
    """The text of the file."""
    return KIND.text(asdict(digest))


def load_track(path: str | Path) -> Digest:
    """Read a track back.

    Raises
    ------
    BadInput : the file is no track, is damaged, or was written by another version.
    """
    return KIND.load(path, _from_plain_data)


def _from_plain_data(body: Mapping[str, Any]) -> Digest:
    return Digest(
        model=str(body["model"]),
        about=str(body["about"]),
        settings=dict(body["settings"]),
        effects=_numbers(body["effects"]),
        made=TrackMade(**body["made"]),
        data=DataRecord(**body["data"]),
        filter=str(body["filter"]),
        smoothed=bool(body["smoothed"]),
        parameters=_words(body["parameters"]),
        disturbances=_words(body["disturbances"]),
        rows=int(body["rows"]),
        runs=int(body["runs"]),
        estimates={name: Estimate(**own) for name, own in body["estimates"].items()},
        truth={name: Measured(**own) for name, own in body["truth"].items()},
        noise={name: NoiseSize(**own) for name, own in body["noise"].items()},
        calibrated={name: (float(value), float(sd)) for name, (value, sd) in body["calibrated"].items()},
        consistency={name: Consistency(**own) for name, own in body["consistency"].items()},
        signals={
            name: (str(unit), str(role), tuple(float(own) for own in ends))
            for name, (unit, role, ends) in body["signals"].items()
        },
        widened=float(body["widened"]),
        log_likelihood=float(body["log_likelihood"]),
        sentences=_words(body["sentences"]),
        course=_course(body["course"]),
        innovations={name: _innovations(own) for name, own in body["innovations"].items()},
    )


def _course(body: Mapping[str, Any]) -> Course:
    time, run = (np.array(body[name], dtype=float) for name in ("time", "run"))
    values, sds, measured = (
        {name: np.array(own, dtype=float) for name, own in body[kind].items()} for kind in ("values", "sds", "measured")
    )
    _alike(time, run, *values.values(), *sds.values(), *measured.values())
    if not sds.keys() <= values.keys():
        raise ValueError("its estimates and their standard deviations do not belong together")
    return Course(int(body["every"]), time, run, values, sds, measured)


def _innovations(body: Mapping[str, Any]) -> Innovations:
    time, nis, lags, told = (np.array(body[name], dtype=float) for name in ("time", "nis", "lags", "correlation"))
    _alike(time, nis)
    _alike(lags, told)
    return Innovations(time, nis, float(body["low"]), float(body["high"]), lags, told)


def _alike(*lines: Array) -> None:
    if any(own.ndim != 1 or own.shape != lines[0].shape for own in lines):
        raise ValueError("the lines of its pictures do not belong together")


def _numbers(body: Mapping[str, Any]) -> dict[str, float]:
    return {str(name): float(value) for name, value in body.items()}


def _words(body: Any) -> tuple[str, ...]:
    if not isinstance(body, list):
        raise TypeError(f"{body!r} is no list of words")
    return tuple(str(own) for own in body)
