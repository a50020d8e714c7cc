"""Changes of the steering that two columns show by themselves: the commanded angle and the measured one.

Regressed on the commanded one, the measured angle determines gain, offset and delay between them, without tyres, masses
or a motion that informs little. A difference from before, beyond those between recordings from before, is a change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import erfc, log, sqrt

import numpy as np

from ...base.shorthands import Array
from ...datasets.recording import Recording
from ..estimation.calibration import CAL

MEASURED = "steer_measured"
EFFECTS = ("steering_ratio", "steering_offset", "steering_delay")
LAGS = np.arange(-0.1, 0.5, 0.01)
"""Lags of the measured angle behind the commanded one that are tried, s."""
BLOCKS = 12
"""Parts of a recording, each left out once: the scatter of estimates then gives their uncertainty (Quenouille's
jackknife of blocks, Künsch, Annals of Statistics 17, 1989)."""
LEAST = {"steering_ratio": 0.002, "steering_offset": 2e-4, "steering_delay": 0.002}
"""Least standard deviation between runs that is assumed: of the ratio, relative; rad; s. A step of a twelve-bit encoder
over a steering range of 1 rad is 0.25 mrad, and a twentieth of a row of 25 Hz 2 ms."""


@dataclass(frozen=True)
class ByColumns:
    """A change that the two columns show.

    Attributes
    ----------
    effect : name.
    shift : difference from before; of a ratio, of its logarithm.
    sd : its standard deviation, scatter between recordings from before included.
    probability : that it is not due to chance.
    """

    effect: str
    shift: float
    sd: float
    probability: float


def steering_changes(after: Sequence[Recording], since: Sequence[Recording]) -> tuple[ByColumns, ...]:
    """Changes of the steering between recordings from before and after; none where one lacks a column."""
    if not all({"steer", MEASURED} <= item.signals.keys() for item in (*after, *since)):
        return ()
    before, then = ([_steering(item) for item in part] for part in (since, after))
    if not all((*before, *then)):
        return ()
    result = []
    for name in EFFECTS:
        (a, s), (b, t) = (_mean([item[name] for item in part]) for part in (before, then))
        between = float(np.std([item[name][0] for item in before], ddof=1)) if len(before) > 1 else 0.0
        between = max(between, LEAST[name])
        sd = sqrt(s**2 + t**2 + between**2 * (1.0 / len(before) + 1.0 / len(then)))
        result.append(ByColumns(name, b - a, sd, 1.0 - erfc(abs(b - a) / sd / sqrt(2.0))))
    return tuple(item for item in result if abs(item.shift) > CAL.surely * item.sd)


def _mean(several: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean of estimates, and its standard deviation by their own uncertainties."""
    values, sds = np.array(several).T
    return float(np.mean(values)), float(np.sqrt(np.sum(sds**2)) / len(sds))


def _steering(recording: Recording) -> Mapping[str, tuple[float, float]]:
    """Effect -> estimate and its standard deviation; nothing where the steering hardly moves."""
    measured, part = recording[MEASURED], np.arange(len(recording)) * BLOCKS // len(recording)
    sums = np.zeros((BLOCKS, len(LAGS), 6))
    for k, lag in enumerate(LAGS):
        late = np.full(len(recording), np.nan)
        for start, stop in recording.runs:
            at = recording.time[start:stop]
            late[start:stop] = np.interp(at - lag, at, recording["steer"][start:stop], left=np.nan, right=np.nan)
        there = np.isfinite(late) & np.isfinite(measured)
        c, m = np.where(there, late, 0.0), np.where(there, measured, 0.0)
        for column, values in enumerate((there * 1.0, c, m, c * c, c * m, m * m)):
            sums[:, k, column] = np.bincount(part, weights=values, minlength=BLOCKS)
    total = np.sum(sums, axis=0)
    best, left_out = _best(total), [_best(total - one) for one in sums]
    if best is None or None in left_out:
        return {}
    spread = np.array(left_out, dtype=float)
    sds = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((spread - np.mean(spread, axis=0)) ** 2, axis=0))
    return {name: (float(value), float(sd)) for name, value, sd in zip(EFFECTS, best, sds, strict=True)}


def _best(sums: Array) -> tuple[float, float, float] | None:
    """Logarithm of the gain, offset and delay by least squares, from sums by lag; None where nothing is steered."""
    n, c, m, cc, cm, mm = sums.T
    with np.errstate(invalid="ignore", divide="ignore"):
        variance, common = cc / n - (c / n) ** 2, cm / n - c * m / n**2
        gain = common / variance
        left = mm / n - (m / n) ** 2 - gain * common
    k = int(np.argmin(np.where(np.isfinite(left), left, np.inf)))
    if not np.isfinite(left[k]) or not gain[k] > 0 or not variance[k] > 1e-8:
        return None
    lag = float(LAGS[k])
    if 0 < k < len(LAGS) - 1:  # the parabola through the three smallest
        bend = left[k - 1] - 2 * left[k] + left[k + 1]
        lag += float(0.5 * (LAGS[1] - LAGS[0]) * (left[k - 1] - left[k + 1]) / bend) if bend > 0 else 0.0
    return log(gain[k]), float((m[k] - gain[k] * c[k]) / n[k]), lag
