"""Content of a track's report: statistics over all rows, a subset of rows for figures, and their file."""

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
    """Provenance of a track.

    Attributes
    ----------
    vehicle : its name, or that of the fit; "" for none.
    command : reproduces the track.
    version : of greybox-id.
    tuned_on, calibrated_on : seconds at the beginning on which noise and the model's parameters were tuned.
    """

    vehicle: str
    command: str
    version: str
    tuned_on: float = 0.0
    calibrated_on: float = 0.0


@dataclass(frozen=True)
class Estimate:
    """Statistics of one estimate over all rows.

    Attributes
    ----------
    unit : SI unit.
    low, median, high : quantiles at 5, 50 and 95 %.
    sd : median of the standard deviations.
    told : share of rows in which the estimate is identifiable; None if it is not tracked.
    """

    unit: str
    low: float
    median: float
    high: float
    sd: float
    told: float | None


@dataclass(frozen=True)
class Measured:
    """Comparison of an estimate with measurements that the filter did not use.

    Attributes
    ----------
    unit : SI unit.
    rows : number of rows compared.
    rmse, bias, worst : of estimate minus measurement; `worst` is that of the largest magnitude.
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
    """Size of a noise in its unit, and its origin."""

    size: float
    unit: str
    origin: str


@dataclass(frozen=True)
class Innovations:
    """Innovations of one reading over time and lags.

    Attributes
    ----------
    time, nis : (n,) centres of windows, s, and mean squares of the normalised innovations in them.
    low, high : 95 % bounds of these if the filter is consistent.
    lags, correlation : (k,) s, and the autocorrelation of normalised innovations.
    """

    time: Array
    nis: Array
    low: float
    high: float
    lags: Array
    correlation: Array


@dataclass(frozen=True)
class Course:
    """A subset of rows, evenly spaced in each run.

    Attributes
    ----------
    every : step between the rows.
    time, run : (n,) s, continuous across runs whose clocks start again, and number of the run.
    values, sds, measured : name -> (n,) estimates, their standard deviations, and measurements.
    """

    every: int
    time: Array
    run: Array
    values: Mapping[str, Array]
    sds: Mapping[str, Array]
    measured: Mapping[str, Array]


@dataclass(frozen=True)
class Digest:
    """The part of a track that a report shows.

    Attributes
    ----------
    model, about : name and description of the model.
    settings, effects : of the model; magnitudes of effects.
    made, data : provenance; the recording.
    filter, smoothed : "ekf" or "ukf", and whether estimates use later readings, too.
    parameters, disturbances : tracked as random walks, and as processes that return to their initial value.
    rows, runs : number of each.
    estimates, truth, noise, calibrated, consistency : by name; `calibrated` has values and standard deviations.
    signals : input or reading -> (unit, role, quantiles at 0.5, 50 and 99.5 %).
    widened, log_likelihood, sentences : as in the track.
    course, innovations : for figures.
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
"""Quantities drawn if the model has them, followed by those that are tracked."""
SLIPS = ("alpha_f", "alpha_r")
"""Additional quantities for the figure of forces over slip."""
MOST_DRAWN, MOST_ROWS = 7, 3000
DIGITS = 6
LAGS, MOST_LAGS = 1.0, 50
"""Largest lag of the autocorrelation of innovations, s, and most lags in rows."""
WITHIN = (0.05, 0.5, 0.95)
RANGE = (0.005, 0.5, 0.995)


def digest(track: Track, recording: Recording, made: TrackMade) -> Digest:
    """The content of a track's report.

    Parameters
    ----------
    track : the track.
    recording : as read; its measurements of estimated quantities are compared, whether the filter used them or not.
    made : provenance of the track.
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
    """Tracked factors -> scaled parameters, which are shown instead."""
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
    shares = {_scaled(track).get(name, name): share for name, share in track.told.items()}
    return Estimate(track.units[name], low, median, high, sd, shares.get(name))


def measured_of(recording: Recording, name: str) -> Array | None:
    """Measurements of an estimated quantity in each row of a recording; None if there are none."""
    if name in recording:
        return recording[name]
    if name == "sideslip" and "v_x" in recording and "v_y" in recording:
        return np.asarray(np.arctan2(recording["v_y"], recording["v_x"]))
    return None


def _entered(track: Track, name: str) -> bool:
    """Whether the filter used the measurements of an estimated quantity."""
    seen = {*track.innovations, *track.model.inputs}
    return name in seen or (name == "sideslip" and "v_y" in seen and "sideslip" not in track.recording)


def _truth(track: Track, recording: Recording, name: str) -> Measured | None:
    reference = measured_of(recording, name)
    if reference is None or _entered(track, name):
        return None
    measured, values, sds = reference[track.rows.astype(int)], track.values[name], track.sds[name]
    both = np.isfinite(measured) & np.isfinite(values)
    if not np.any(both):
        return None
    error = (values - measured)[both]
    return Measured(
        unit=track.units[name],
        rows=int(np.count_nonzero(both)),
        rmse=float(np.sqrt(np.mean(error**2))),
        bias=float(np.mean(error)),
        worst=float(error[np.argmax(np.abs(error))]),
        inside=float(np.mean(np.abs(error) <= 2 * sds[both])),
        size=float(np.sqrt(np.mean(measured[both] ** 2))),
    )


def _used(track: Track) -> dict[str, float]:
    """The noises that influence the estimates; those of outputs without readings do not."""
    unread = {f"noise_{name}" for name in track.model.outputs if name not in track.innovations}
    return {name: size for name, size in track.noise.items() if name not in unread}


def _signals(track: Track, recording: Recording) -> dict[str, tuple[str, str, tuple[float, ...]]]:
    """Signals that the filter used, and their range."""
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
    """(n,) s; continuous across runs whose clocks start again."""
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
    finite = np.isfinite(scaled)
    stretches = np.split(scaled[finite], breaks(track.rows[finite], track.run[finite]))
    parts = [item for item in stretches if len(item) > 1]
    most = max(1, min(round(LAGS / step), MOST_LAGS))
    autocorrelation = correlation([(part, part) for part in parts], most) if parts else np.full(most + 1, np.nan)
    return Innovations(
        _rounded(windowed(running_time(track)[finite], size)),
        _rounded(windowed(scaled[finite] ** 2, size)),
        *bounds(size),
        _rounded(np.arange(most + 1.0) * step),
        _rounded(autocorrelation),
    )


def _rounded(values: Array) -> Array:
    """Values rounded to the significant digits that a figure needs."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in values])


KIND = Kind("greybox-track", 1, "a track", "greybox track", "track again")


def as_text(digest: Digest) -> str:
    """Content of the file."""
    return KIND.text(asdict(digest))


def load_track(path: str | Path) -> Digest:
    """Read a track.

    Raises
    ------
    BadInput : if the file is not a track, is damaged, or was written by another version.
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
