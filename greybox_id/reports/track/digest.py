"""What the report of a track is made from: numbers of all rows, and as many rows as a picture shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...filters.findings import Consistency
from ...parameter import Array
from ...provenance import DataRecord


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
