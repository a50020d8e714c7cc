"""Consistency of a filter: innovations compared with their expected variance, and sentences for the user.

An innovation over its expected standard deviation, squared, is 1 on average (NIS, normalised innovation squared), and
innovations are uncorrelated. Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, Sec. 5.4.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from ..base.errors import BadInput
from ..base.numbers import exact, number
from ..base.shorthands import Array, Mask
from ..base.signals import unit_of
from ..datasets.recording import Recording
from ..engine.motion.schedule import MotionRun
from ..fitting.scores.verdict import distrust
from ..models.motion_model import MotionModel
from .filtering import LaidRun
from .kernel import History
from .state_space import Tracked

WINDOW = 2.0
"""Length of windows over which NIS is averaged, s."""


@dataclass(frozen=True)
class Consistency:
    """Statistics of the innovations of one channel.

    Attributes
    ----------
    count : number of readings used.
    nis : their mean NIS, innovations clipped at the gate.
    inside : share of windows of `WINDOW` seconds whose mean NIS lies within its 95 % bounds.
    correlation : of successive innovations.
    correlation_bound : absolute value below which it lies in 95 % of cases for uncorrelated innovations.
    gated : number of innovations beyond the gate.
    rms : root mean square of the innovations, in the channel's unit.
    """

    count: int
    nis: float
    inside: float
    correlation: float
    correlation_bound: float
    gated: int
    rms: float


def consistency(off: Array, spread: Array, per_window: int, gate: float) -> Consistency:
    """Statistics of a channel's innovations (n,), given their expected variances (n,); NaN without a reading."""
    read = np.isfinite(off)
    count = int(np.count_nonzero(read))
    if count < 2:
        return Consistency(count, np.nan, np.nan, np.nan, np.nan, 0, np.nan)
    scaled = off[read]  # in place from here: for hours of data each copy is large
    rms = float(np.sqrt(np.mean(scaled**2)))
    scaled /= np.sqrt(spread[read])
    windows = windowed(scaled**2, per_window)
    low, high = bounds(per_window)
    inside = float(np.mean((windows > low) & (windows < high))) if len(windows) else np.nan
    beyond = int(np.count_nonzero((scaled > gate) | (scaled < -gate)))
    clipped = np.clip(scaled, -gate, gate, out=scaled)
    correlation = _with_the_next(clipped) if count > 3 and np.std(clipped) > 0 else np.nan
    nis = float(np.mean(clipped**2))
    return Consistency(count, nis, inside, correlation, 1.96 / np.sqrt(count), beyond, rms)


def _with_the_next(values: Array) -> float:
    """Correlation of successive values."""
    before, after = values[:-1], values[1:]
    covariance = float(np.dot(before, after)) / len(before) - float(np.mean(before)) * float(np.mean(after))
    return covariance / float(np.std(before) * np.std(after))


class RunningConsistency:
    """Running statistics of the innovations of one channel, in constant memory.

    Parameters
    ----------
    gate : in standard deviations.

    Attributes
    ----------
    windows, lost : number of windows of `WINDOW` seconds, and of those whose mean NIS exceeds `LOST`.
    """

    def __init__(self, gate: float) -> None:
        self._gate = gate
        self.windows = self.lost = self._inside = self._count = self._gated = self._pairs = 0
        self._squares = self._clipped = self._together = 0.0
        self._before, self._began, self._window = np.nan, np.nan, list[float]()

    def take(self, time: float, off: float, spread: float) -> None:
        """Add one innovation and its expected variance; NaN without a reading."""
        if not time - self._began < WINDOW:
            self._close()
            self._began = time
        if not (np.isfinite(off) and spread > 0):
            self._before = np.nan
            return
        scaled = off / float(np.sqrt(spread))
        clipped = float(np.clip(scaled, -self._gate, self._gate))
        self._count, self._gated = self._count + 1, self._gated + (abs(scaled) > self._gate)
        self._squares, self._clipped = self._squares + off**2, self._clipped + clipped**2
        if np.isfinite(self._before):
            self._pairs, self._together = self._pairs + 1, self._together + clipped * self._before
        self._before = clipped
        self._window.append(scaled**2)

    def _close(self) -> None:
        if len(self._window) > 1:
            mean, (low, high) = float(np.mean(self._window)), bounds(len(self._window))
            self.windows, self.lost = self.windows + 1, self.lost + (mean > LOST)
            self._inside += low < mean < high
        self._window = []

    def consistency(self) -> Consistency:
        """Statistics so far; the correlation assumes a zero mean."""
        if self._count < 2:
            return Consistency(self._count, np.nan, np.nan, np.nan, np.nan, 0, np.nan)
        nis, bound = self._clipped / self._count, 1.96 / float(np.sqrt(self._count))
        inside = self._inside / self.windows if self.windows else np.nan
        correlation = self._together / self._pairs / nis if self._pairs and nis > 0 else np.nan
        rms = float(np.sqrt(self._squares / self._count))
        return Consistency(self._count, nis, inside, correlation, bound, self._gated, rms)


def windowed(values: Array, size: int) -> Array:
    """Means over windows of `size` values; an incomplete window at the end is dropped."""
    whole = len(values) // size
    return np.asarray(values[: whole * size].reshape(whole, size).mean(axis=1)) if whole else np.empty(0)


def bounds(size: int) -> tuple[float, float]:
    """95 % bounds of the mean of so many independent NIS."""
    return float(chdtri(size, 0.975) / size), float(chdtri(size, 0.025) / size)


def widening(channels: Sequence[Consistency]) -> float:
    """Factor by which bands are too narrow, from the channel with the largest NIS; at least 1."""
    result = [np.sqrt(channel.nis) for channel in channels if np.isfinite(channel.nis)]
    return float(max([1.0, *result]))


LOST = 5.0
"""Median NIS of a window beyond which the filter has lost the vehicle; otherwise the median is 0.45."""
IDENTIFIABLE = 0.5
"""Standard deviation of a tracked parameter, relative to its prior one, below which it is identifiable."""
MOSTLY = 0.9
FLOORED = 0.999
"""Share of its floor below which noise counts as below it, not merely by rounding."""


def must_fill_a_window(runs: Sequence[MotionRun], name: str) -> None:
    """Raise `BadInput` if the recording is shorter than one window of innovations."""
    rows, step = sum(len(run) for run in runs), runs[0].sample_time
    if rows < window_rows(step):
        raise BadInput(
            f"{name}: the filter has {rows} rows ({exact(rows * step)} s) and needs {exact(WINDOW)} s to judge its "
            "innovations. Track a longer recording."
        )


def window_rows(sample_time: float) -> int:
    """Rows of a window of innovations."""
    return max(2, round(WINDOW / sample_time))


def must_be_finite(history: History, run: LaidRun, first: int, name: str) -> None:
    """Raise `BadInput` if a filter diverged; `first` is the segment of the run at which the history begins."""
    bad = np.flatnonzero(~np.all(np.isfinite(history.filtered), axis=1))
    if len(bad):
        row = min(int(np.searchsorted(run.row_segment, first + bad[0])), len(run.run) - 1)
        raise BadInput(
            f"{name}: the filter diverges at t = {run.run.time[row]:.2f} s. Check units and signs there (greybox "
            "data check), the vehicle's numbers, or track fewer parameters."
        )


def lost(runs: Sequence[LaidRun], histories: Sequence[History], readings: Sequence[str]) -> list[str]:
    """Sentences on stretches where innovations, one reading to a column, are far larger than expected."""
    result = []
    for column, name in enumerate(readings):
        seconds, first_time = 0.0, np.nan
        for run, history in zip(runs, histories, strict=True):
            size = window_rows(run.run.sample_time)
            nis = (history.off[:, column] ** 2 / history.spread[:, column])[run.row_segment]
            for begin in range(0, len(nis) - size + 1, size):
                window = nis[begin : begin + size]
                if np.any(np.isfinite(window)) and np.nanmedian(window) > LOST:
                    seconds += size * run.run.sample_time
                    first_time = run.run.time[begin] if np.isnan(first_time) else first_time
        if seconds > 0:
            result.append(
                f"{name}: for {seconds:.0f} s, first at t = {first_time:.1f} s, readings are far from what the filter "
                "expects: do not trust the estimates there."
            )
    return result


def distrusted_data(recording: Recording, used: Collection[str]) -> list[str]:
    """Findings of the data checks on signals that a filter uses as inputs or readings."""
    return [f"Data check: {item.sentence}" for item in distrust(used, recording)]


def too_quiet(noise: Mapping[str, float], floors: Mapping[str, float]) -> list[str]:
    """Sentences on noise of readings that is stated or tuned below the resolution of a recording.

    Parameters
    ----------
    noise : name of a noise -> its size.
    floors : reading -> smallest noise, from `resolution_of`.
    """
    result = []
    for name, floor in floors.items():
        size = noise.get(f"noise_{name}", np.inf)
        if size < FLOORED * floor:
            result.append(
                f"noise_{name} = {number(size, 2)} {unit_of(name)} is below the resolution of the recording "
                f"({number(floor, 2)}, from the steps and the scatter of the readings): the filter trusts these "
                "readings too much. "
                "State a larger noise."
            )
    return result


def standing(sideslip: Array | None, slowest: float) -> list[str]:
    """A sentence on rows in which the vehicle is too slow for a sideslip angle."""
    count = 0 if sideslip is None else int(np.count_nonzero(np.isnan(sideslip)))
    if count == 0:
        return []
    return [f"In {count} rows the vehicle is slower than {slowest:g} m/s: sideslip is not defined there."]


def only_over_mass(model: MotionModel) -> list[str]:
    """A sentence on parameters tuned on innovations: forces are identifiable only relative to the mass."""
    over = [combination.name for combination in model.combinations if combination.name.endswith("/ m")]
    if "m" not in model or not over:
        return []
    how = "was fixed" if model["m"].fixed else "comes from its prior"
    return [
        f"Calibrated: {', '.join(over)}. Readings of motion determine the ratios of stiffness and inertia to mass, "
        "not the mass itself; m = "
        f"{float(model['m'].array):g} kg {how}."
    ]


def identifiable_rows(tracked: Tracked, values: Array, sds: Array) -> Mask:
    """(n,) rows in which the recording makes a tracked parameter clearly more precise than its prior."""
    prior_sd = tracked.start_sd * (np.abs(values) if tracked.logarithmic else 1.0)
    return np.asarray(sds < IDENTIFIABLE * prior_sd)


def unidentifiable(name: str, mask: Mask, slip: Array | None, force: str) -> str:
    """A sentence on a cornering stiffness that is not identifiable in some rows; "" if there are few.

    Parameters
    ----------
    name : the stiffness.
    mask : (n,) whether it is identifiable in a row.
    slip : (n,) the axle's slip angle, rad.
    force : name of the axle's lateral force.
    """
    share = float(np.mean(mask))
    if share >= MOSTLY:
        return ""
    where = ""
    if slip is not None and share > 0:
        where = f", mostly where the slip angle is below {np.degrees(np.quantile(np.abs(slip[~mask]), MOSTLY)):.1f}°"
    return (
        f"{name}: not identifiable in {100 * (1 - share):.0f} % of the rows{where}; its band is wide there. Even in"
        f" these rows, the lateral force {force} is identifiable."
    )
