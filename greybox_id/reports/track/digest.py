"""What the report of a track is made from: numbers of all rows, as many rows as a picture shows, and their file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from ...base.declared import of_plain
from ...base.json_data import Kind
from ...base.shorthands import Array
from ...base.statistics import correlation
from ...datasets.recording import Recording
from ...engine.simulation import breaks
from ...filters.findings import WINDOW, Consistency, bounds, windowed
from ...filters.track import Track
from ...fitting.provenance import DataRecord, data_record


@dataclass(frozen=True)
class TrackMade:
    """What a track was made with.

    Attributes
    ----------
    vehicle : its name, or that of the fit; "" for none.
    command : what reproduces it.
    version : greybox-id's own.
    tuned_on, calibrated_on : seconds at the beginning on which noise, and the model's parameters, were tuned.
    """

    vehicle: str
    command: str
    version: str
    tuned_on: float = 0.0
    calibrated_on: float = 0.0


@dataclass(frozen=True)
class Estimate:
    """One estimate over all rows.

    Attributes
    ----------
    unit : SI unit.
    low, median, high : quantiles of it, at 5, 50 and 95 %.
    sd : median of its standard deviations.
    told : share of rows in which the recording tells it; None where it is not tracked.
    """

    unit: str
    low: float
    median: float
    high: float
    sd: float
    told: float | None


@dataclass(frozen=True)
class Measured:
    """An estimate against what was measured of it and did not enter the filter.

    Attributes
    ----------
    unit : SI unit.
    rows : compared.
    rmse, bias, worst : of estimate less measurement; the last the largest by size.
    inside : share of rows within two standard deviations.
    size : root mean square of the measurement.
    """

    unit: str
    rows: int
    rmse: float
    bias: float
    worst: float
    inside: float
    size: float


@dataclass(frozen=True)
class NoiseSize:
    """One noise: its size in its unit, and where that is from."""

    size: float
    unit: str
    origin: str


@dataclass(frozen=True)
class Innovations:
    """Innovations of one reading over time and lags.

    Attributes
    ----------
    time, nis : (n,) windows' middles, s, and the mean squares of scaled innovations in them.
    low, high : within which 95 % of these lie if the filter is consistent.
    lags, correlation : (k,) s, and the correlation of scaled innovations so far apart.
    """

    time: Array
    nis: Array
    low: float
    high: float
    lags: Array
    correlation: Array


@dataclass(frozen=True)
class Course:
    """Some rows, evenly taken of each run.

    Attributes
    ----------
    every : of so many rows one was taken.
    time, run : (n,) s, runs whose clocks begin anew one behind the other, and number of the run.
    values, sds, measured : name -> (n,) estimates, their standard deviations, and what was measured of them.
    """

    every: int
    time: Array
    run: Array
    values: Mapping[str, Array]
    sds: Mapping[str, Array]
    measured: Mapping[str, Array]


@dataclass(frozen=True)
class Digest:
    """A track, as much of it as a report shows.

    Attributes
    ----------
    model, about : name and sentence of the model.
    settings, effects : from which it is built; magnitudes of effects.
    made, data : what it was made with; the recording.
    filter, smoothed : "ekf" or "ukf", and whether later readings count as well.
    parameters, disturbances : what walks for good, and what comes and goes.
    rows, runs : estimated.
    estimates, truth, noise, calibrated, consistency : by name; calibrated are values and standard deviations.
    signals : what went in -> (unit, role, quantiles at 0.5, 50 and 99.5 %).
    widened, log_likelihood, sentences : as of the track.
    course, innovations : for pictures.
    """

    model: str
    about: str
    settings: Mapping[str, Any]
    effects: Mapping[str, float]
    made: TrackMade
    data: DataRecord
    filter: str
    smoothed: bool
    parameters: tuple[str, ...]
    disturbances: tuple[str, ...]
    rows: int
    runs: int
    estimates: Mapping[str, Estimate]
    truth: Mapping[str, Measured]
    noise: Mapping[str, NoiseSize]
    calibrated: Mapping[str, tuple[float, float]]
    consistency: Mapping[str, Consistency]
    signals: Mapping[str, tuple[str, str, tuple[float, ...]]]
    widened: float
    log_likelihood: float
    sentences: tuple[str, ...]
    course: Course
    innovations: Mapping[str, Innovations]


SHOWN = ("sideslip", "C_alpha_f", "C_alpha_r", "F_yf", "F_yr")
"""Drawn where a model has them, and what is tracked after them."""
SLIPS = ("alpha_f", "alpha_r")
"""Needed beside them for the picture of forces over slip."""
MOST_DRAWN, MOST_ROWS = 7, 3000
DIGITS = 6
LAGS, MOST_LAGS = 1.0, 50
"""Innovations are correlated over lags up to so many s, in so many rows at most."""
WITHIN = (0.05, 0.5, 0.95)
RANGE = (0.005, 0.5, 0.995)


def digest(track: Track, recording: Recording, made: TrackMade) -> Digest:
    """What a report shows of a track.

    Parameters
    ----------
    track : the track.
    recording : as read; what it measures of the estimates stands beside them, whether the filter read it or not.
    made : what the track was made with.
    """
    model = track.model
    return Digest(
        model=model.name,
        about=model.about,
        settings=dict(model.settings),
        effects={name: float(model[name].array) for name in model.effects},
        made=made,
        data=data_record(recording, "track"),
        filter=track.kind,
        smoothed=track.smoothed,
        parameters=track.parameters,
        disturbances=track.disturbances,
        rows=len(track.rows),
        runs=len(np.unique(track.run)),
        estimates={name: _estimate(track, name) for name in _shown(track)},
        truth={name: measured for name in _shown(track) if (measured := _truth(track, recording, name)) is not None},
        noise={n: NoiseSize(size, track.noise_units[n], track.noise_from[n]) for n, size in _used(track).items()},
        calibrated=dict(track.calibrated),
        consistency=dict(track.consistency),
        signals=_signals(track, recording),
        widened=track.widened,
        log_likelihood=track.log_likelihood,
        sentences=track.sentences,
        course=_course(track, recording),
        innovations={name: _innovations(track, name) for name in track.innovations},
    )


def _scaled(track: Track) -> dict[str, str]:
    """Tracked factors -> what they scale, which is shown in their place."""
    return {
        combination.scaled_by: combination.name
        for combination in track.model.combinations
        if combination.scaled_by and combination.name in track.values
    }


def _shown(track: Track) -> list[str]:
    return [name for name in track.values if name not in _scaled(track)]


def _estimate(track: Track, name: str) -> Estimate:
    low, median, high = (float(item) for item in np.nanquantile(track.values[name], WITHIN))
    sd = float(np.nanmedian(track.sds[name]))
    known = {_scaled(track).get(name, name): share for name, share in track.told.items()}
    return Estimate(track.units[name], low, median, high, sd, known.get(name))


def measured_of(recording: Recording, name: str) -> Array | None:
    """What a recording measures of an estimate, row by row; None for nothing."""
    if name in recording:
        return recording[name]
    if name == "sideslip" and "v_x" in recording and "v_y" in recording:
        return np.asarray(np.arctan2(recording["v_y"], recording["v_x"]))
    return None


def _entered(track: Track, name: str) -> bool:
    """Whether the filter saw what was measured of an estimate."""
    seen = {*track.innovations, *track.model.inputs}
    return name in seen or (name == "sideslip" and "v_y" in seen and "sideslip" not in track.recording)


def _truth(track: Track, recording: Recording, name: str) -> Measured | None:
    whole = measured_of(recording, name)
    if whole is None or _entered(track, name):
        return None
    measured, values, sds = whole[track.rows.astype(int)], track.values[name], track.sds[name]
    there = np.isfinite(measured) & np.isfinite(values)
    if not np.any(there):
        return None
    off = (values - measured)[there]
    return Measured(
        unit=track.units[name],
        rows=int(np.count_nonzero(there)),
        rmse=float(np.sqrt(np.mean(off**2))),
        bias=float(np.mean(off)),
        worst=float(off[np.argmax(np.abs(off))]),
        inside=float(np.mean(np.abs(off) <= 2 * sds[there])),
        size=float(np.sqrt(np.mean(measured[there] ** 2))),
    )


def _used(track: Track) -> dict[str, float]:
    """The noises that have a part in the estimates: those of outputs that were not read have none."""
    unread = {f"noise_{name}" for name in track.model.outputs if name not in track.innovations}
    return {name: size for name, size in track.noise.items() if name not in unread}


def _signals(track: Track, recording: Recording) -> dict[str, tuple[str, str, tuple[float, ...]]]:
    """What went into the filter, and between which values it was driven."""
    model = track.model
    inputs = [item for name in model.inputs for item in (name, *model.aliases.get(name, ())) if item in recording]
    roles = dict.fromkeys(inputs, "input") | dict.fromkeys(track.innovations, "reading")
    rows = track.rows.astype(int)
    quantiles = {name: np.nanquantile(recording[name][rows], RANGE) for name in roles}
    return {
        name: (recording.unit(name), role, tuple(float(quantile) for quantile in quantiles[name]))
        for name, role in roles.items()
    }


def _course(track: Track, recording: Recording) -> Course:
    moving = [name for name in _shown(track) if np.nanmax(track.values[name]) > np.nanmin(track.values[name])]
    drawn = [name for name in dict.fromkeys((*SHOWN, *track.tracked)) if name in moving][:MOST_DRAWN]
    every = max(1, ceil(len(track.rows) / MOST_ROWS))
    runs = [np.flatnonzero(track.run == run) for run in np.unique(track.run)]
    kept = np.concatenate([run[::every] for run in runs])
    rows = track.rows[kept].astype(int)
    read = {name: whole[rows] for name in drawn if (whole := measured_of(recording, name)) is not None}
    return Course(
        every=every,
        time=_rounded(running_time(track)[kept]),
        run=track.run[kept].astype(float),
        values={n: _rounded(track.values[n][kept]) for n in (*drawn, *SLIPS) if n in track.values},
        sds={name: _rounded(track.sds[name][kept]) for name in drawn},
        measured={name: _rounded(item) for name, item in read.items()},
    )


def running_time(track: Track) -> Array:
    """(n,) s; runs whose clocks begin anew are laid one behind the other."""
    time = track.time.copy()
    starts = np.flatnonzero(np.diff(track.run)) + 1
    if np.all(np.diff(time)[starts - 1] > 0):
        return time
    for start in starts:
        time[start:] += time[start - 1] - time[start] + track.recording.sample_time
    return np.asarray(time)


def _innovations(track: Track, name: str) -> Innovations:
    step = track.recording.sample_time
    size = max(2, round(WINDOW / step))
    scaled = track.innovations[name] / track.expected[name]
    there = np.isfinite(scaled)
    stretches = np.split(scaled[there], breaks(track.rows[there], track.run[there]))
    parts = [item for item in stretches if len(item) > 1]
    most = max(1, min(round(LAGS / step), MOST_LAGS))
    known = correlation([(part, part) for part in parts], most) if parts else np.full(most + 1, np.nan)
    return Innovations(
        _rounded(windowed(running_time(track)[there], size)),
        _rounded(windowed(scaled[there] ** 2, size)),
        *bounds(size),
        _rounded(np.arange(most + 1.0) * step),
        _rounded(known),
    )


def _rounded(values: Array) -> Array:
    """To so many significant digits as a picture can use."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in values])


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
    digest: Digest = of_plain(Digest, body, "track")
    course = digest.course
    _alike(course.time, course.run, *course.values.values(), *course.sds.values(), *course.measured.values())
    if not course.sds.keys() <= course.values.keys():
        raise ValueError("its estimates and their standard deviations do not match")
    for item in digest.innovations.values():
        _alike(item.time, item.nis)
        _alike(item.lags, item.correlation)
    return digest


def _alike(*lines: Array) -> None:
    if any(line.ndim != 1 or line.shape != lines[0].shape for line in lines):
        raise ValueError("the lines of its figures do not match")
