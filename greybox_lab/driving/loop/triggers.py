"""When it is time to learn anew: by counts of rows, as published, or by evidence that the vehicle is another one.

Evidence is a path error that was not foretold; as long as nothing but its file is known of the vehicle, a gap between
that and what was driven (`greybox gap`); then innovations of the model that was made of the vehicle: what is read half
a second later less what it foretells. Normalised by their covariance and squared (NIS, normalised innovation squared;
Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, Sec. 5.4) they are
distributed as chi-square where the vehicle is still that one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher

from greybox_id.api.diagnosing import diagnose
from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.vehicle import Vehicle

from ..learned.open_loop import OpenLoop

FIRST, EVERY, LEAST = 5_000, 10_000, 2_000
"""Rows before the first time, between times, and since the last time at least, as published."""
EXCESS = 1.5
"""How many times the foretold path error is too much."""

HORIZON, APART = 0.5, 0.1
"""s that are foretold, the middle one of the horizons of a diagnosis; s between two predictions. A single row ahead
sensors' noise is all that is seen."""
LEVEL = 0.99
"""Of the band: of windows of a vehicle that has not changed 1 % are beyond it."""
SHORTEST = 10.0
"""s of predictions that a band is made of at least."""


def rows_due(rows: int, *, first: bool) -> str:
    """Why it is time after so many rows since it was learned last, or, the first time, in all; "" where it is not."""
    return f"{rows} rows since the last learning" if rows >= (FIRST if first else EVERY) else ""


def path_error_beyond(path_error: float, foretold: float) -> str:
    """Why a path error over a lap, m, is more than what was foretold; "" where it is not."""
    if foretold > 0 and path_error > EXCESS * foretold:
        return f"path error {path_error:.3f} m, where {foretold:.3f} m was expected"
    return ""


def gap_told(vehicle: Vehicle, recordings: Sequence[Recording]) -> str:
    """Why rows are not those of the vehicle that a file states, as `greybox gap` finds; "" where they may be."""
    if not diagnose(vehicle, list(recordings), vehicle=vehicle).gap_detected:
        return ""
    return "the simulation of the vehicle file deviates from what was driven (greybox gap)"


@dataclass(frozen=True)
class InnovationBand:
    """What innovations of a model are like while the vehicle is the one that it was made of.

    Predictions overlap, and errors of a model last longer than a horizon, so that innovations are correlated, and their
    tails are not those of a normal distribution. A mean NIS over a window is therefore taken as chi-square with as many
    degrees of freedom as its variance says (Satterthwaite 1946), with the sum of autocorrelations in it. The covariance
    is estimated itself, which makes the ratio of two of them one of Fisher's.

    Attributes
    ----------
    model : what foretells.
    channels : (k,) columns of v_x, v_y and yaw rate that are read.
    inverse : (k, k) of the covariance of innovations.
    freedom : degrees of freedom of a mean NIS per prediction.
    count : predictions that this was estimated from.
    """

    model: MotionModel
    channels: tuple[int, ...]
    inverse: Array
    freedom: float
    count: int

    @classmethod
    def of(cls, model: MotionModel, recordings: Sequence[Recording]) -> InnovationBand:
        """The band of the rows that a model was made of.

        Raises
        ------
        BadInput : they are too few, or the model cannot be laid along them.
        """
        parts = _innovations(model, recordings)
        every = np.concatenate(parts) if parts else np.empty((0, 3))
        channels = tuple(np.flatnonzero(np.any(np.isfinite(every), axis=0)).tolist())
        kept = [part[:, channels] for part in parts]
        kept = [run[np.all(np.isfinite(run), axis=1)] for run in kept]
        count = sum(len(run) for run in kept)
        if not channels or count < SHORTEST / APART:
            length = f"{count * APART:.0f} s of rows are too few to judge a model's errors"
            raise BadInput(f"{length}; {SHORTEST:g} s are needed.")
        joined = np.concatenate(kept)
        inverse = np.asarray(np.linalg.inv(joined.T @ joined / count), dtype=np.float64)
        runs = [_squared(run, inverse) / len(channels) for run in kept]
        return cls(model, channels, inverse, _freedom(runs), count)

    def mean(self, recordings: Sequence[Recording]) -> tuple[float, int]:
        """Mean NIS of rows over what it is expected to be, and the predictions that it is of."""
        parts = [innovation[:, self.channels] for innovation in _innovations(self.model, recordings)]
        result = np.concatenate([_squared(part, self.inverse) for part in parts]) if parts else np.empty(0)
        return (float(np.mean(result)) / len(self.channels) if len(result) else float("nan")), len(result)

    def limit(self, count: int) -> float:
        """What the mean of so many is below in 99 % of cases where nothing has changed."""
        return float(fisher.ppf(LEVEL, self.freedom * count, self.freedom * self.count))

    def beyond(self, recordings: Sequence[Recording]) -> str:
        """Why rows are not those of the vehicle that the model was made of; "" where they may be, or are too few."""
        nis, count = self.mean(recordings)
        if count * APART < SHORTEST or nis <= self.limit(count):
            return ""
        return (
            f"squared innovations have grown by a factor of {nis:.2f}; by chance it would be at most "
            f"{self.limit(count):.2f}"
        )


def _innovations(model: MotionModel, recordings: Sequence[Recording]) -> list[Array]:
    """(n, 3) of each recording that is long enough: read less foretold."""
    result = []
    for recording in recordings:
        ahead = OpenLoop(model, recording)
        try:
            forecast = ahead.ahead(HORIZON, APART)
        except BadInput:  # too short for a prediction
            continue
        result.append(forecast.measured - forecast.predicted)
    return result


def _squared(innovations: Array, inverse: Array) -> Array:
    """(n,) NIS; infinite where a prediction went beyond all numbers, without those where nothing was read."""
    result = np.einsum("ni,ij,nj->n", innovations, inverse, innovations)
    return np.asarray(np.where(np.isnan(result), np.inf, result))


def _freedom(runs: Sequence[Array]) -> float:
    """Degrees of freedom per value of a mean of values that are 1 on average: 2 / (variance times sum of correlations).

    The sum ends where a pair of correlations is not above zero any more (Geyer 1992).
    """
    joined = np.concatenate(runs)
    level = float(np.mean(joined))
    variance = float(np.mean((joined - level) ** 2))
    total, lag = np.float64(1.0), 1
    while lag + 1 < max(len(run) for run in runs):
        pair = sum(_correlated(runs, level, run) / variance for run in (lag, lag + 1))
        if pair <= 0:
            break
        total, lag = total + 2.0 * pair, lag + 2
    return float(2.0 * level**2 / (variance * total))


def _correlated(runs: Sequence[Array], level: float, lag: int) -> float:
    products = np.concatenate([(run[lag:] - level) * (run[:-lag] - level) for run in runs])
    return float(np.mean(products)) if len(products) else 0.0
