"""Recordings as innovations: prediction errors of a filter that follows the vehicle, as a function of its numbers.

A simulation of minutes spins where a car with half its grip is driven; a filter stays with the car. Beside the model's
states it follows unknown forces on the axles and along the car (first-order Gauss-Markov processes, `unknown_forces`)
and a slow error of every reading. Readings are taken a tenth of a second apart, so that predictions are about motion.

Innovations of one second are a block, distributed as a multivariate Student's t: a recording that is noisier than
others costs the logarithm of that and no more, and so does a moment in which something happened. Source: prediction
errors, Ljung, System Identification, 2nd ed., Sec. 7.2; t-blocks, Lange, Little & Taylor, J. Am. Stat. Assoc. 84, 1989.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from ...base.errors import BadInput
from ...base.shorthands import Array, Index, Mask
from ...datasets.recording import Recording, join
from ...filters.filtering import LaidRun, filtering, laid
from ...filters.kernel import SigmaPoints
from ...filters.state_space import SLOWEST, StateSpace, Tracked
from ...filters.tuning import beginning, noise_coordinates, resolution_of, scatter_of, start_levels, tuned
from ...models.effects.memory import LATEST
from ...models.motion_model import MotionModel
from ...models.single_track import G
from ..estimation.calibration import CAL
from ..estimation.preparing import excerpt
from ..estimation.unknown_forces import FORCES, with_unknown_forces

NO_GATE = 1e9


@dataclass(frozen=True)
class FollowedRun:
    """A recording as it is filtered.

    Attributes
    ----------
    recording : while in motion, its readings thinned.
    scatter, floors : reading -> standard deviation of what is faster than motion, and its lower limit by resolution.
    """

    recording: Recording
    scatter: Mapping[str, float]
    floors: Mapping[str, float]

    @classmethod
    def of(cls, recording: Recording, read: Sequence[str], seconds: float = CAL.followed) -> FollowedRun:
        """The parts in motion, of at most `seconds` in all; of their readings, those that are far enough apart.

        Raises `BadInput` where the vehicle never moves.
        """
        moving = recording
        if "v_x" in recording:
            high = float(np.nanpercentile(recording["v_x"], 95.0))
            moving = recording.where(f"v_x > {max(SLOWEST, CAL.slow * high)}")
        if not moving.sample_time > 0:
            raise BadInput(f"{recording.name} has no two successive rows in which the vehicle moves.")
        step = max(1, round(CAL.apart / moving.sample_time))
        moving = join(excerpt([moving], round(seconds / moving.sample_time)), recording.name)
        kept = np.zeros(len(moving), dtype=bool)
        for start, stop in moving.runs:
            kept[start:stop:step] = True
        signals = {name: np.where(kept, values, np.nan) if name in read else values
                   for name, values in moving.signals.items()}  # fmt: skip
        return cls(replace(moving, signals=signals), scatter_of(moving, read), resolution_of(moving, read))

    def halves(self) -> tuple[FollowedRun, FollowedRun]:
        """Its first and its second half."""
        whole, middle = self.recording, len(self.recording) // 2
        return replace(self, recording=whole.rows(0, middle)), replace(self, recording=whole.rows(middle, len(whole)))


@dataclass(frozen=True)
class FilterInnovations:
    """Innovations in B blocks of R rows of m readings.

    Attributes
    ----------
    white : (B, R m) innovations over their predicted standard deviations; zero where nothing was read.
    there : (B, R m) whether something was read.
    spread : (B, R m) logarithms of the standard deviations; zero likewise.
    runs : (B,) index of the unbroken run of each block.
    """

    white: Array
    there: Mask
    spread: Array
    runs: Index


@dataclass(frozen=True)
class InnovationNoise:
    """Distribution of innovations.

    Attributes
    ----------
    root : (R m, R m) lower triangular root of a block's covariance.
    channels : m.
    degrees : of freedom of Student's t.
    temper : how many independent blocks one counts as, for neighbours are correlated.
    """

    root: Array
    channels: int
    degrees: float
    temper: float

    def white(self, innovations: FilterInnovations, scales: Array) -> Array:
        """(B, R m) whitened innovations; a shorter block is the beginning of a whole one.

        Parameters
        ----------
        scales : (channels,) standard deviations over predicted ones.
        """
        scaled = innovations.white / np.tile(scales, innovations.white.shape[1] // self.channels)
        return np.where(innovations.there, solve_triangular(self.root, scaled.T, lower=True).T, 0.0)

    def scales(self, innovations: FilterInnovations) -> Array:
        """(channels,) most likely standard deviations over predicted ones; bounded below, as sensors do not improve.

        They must be at the minimum of the cost: only there do derivatives of the cost not depend on them.
        """
        columns = np.arange(innovations.white.shape[1]) % self.channels
        parts = [np.where(columns == c, innovations.white, 0.0) for c in range(self.channels)]
        parts = [solve_triangular(self.root, part.T, lower=True).T * innovations.there for part in parts]
        products = np.array([[np.sum(one * other, axis=1) for other in parts] for one in parts])  # of each block
        count, read = np.sum(innovations.there, axis=1), self._by_channel(innovations.there)

        def cost(logarithms: Array) -> tuple[float, Array]:
            u = np.exp(-logarithms)
            each = u[:, None] * np.einsum("cdb,d->cb", products, u)
            energy = np.sum(each, axis=0)
            weights = (self.degrees + count) / (self.degrees + energy)
            value = 0.5 * np.sum((self.degrees + count) * np.log1p(energy / self.degrees)) + read @ logarithms
            return float(value), read - each @ weights

        bounds = [(log(CAL.least_scale), None)] * self.channels
        start = np.zeros(self.channels)
        result: Any = minimize(
            cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 1e-14, "gtol": 1e-7}
        )
        return np.asarray(np.exp(result.x))

    def cost(self, innovations: FilterInnovations) -> float:
        """Negative log-likelihood, up to a constant."""
        scales = self.scales(innovations)
        energy, count = np.sum(self.white(innovations, scales) ** 2, axis=1), np.sum(innovations.there, axis=1)
        blocks = 0.5 * float(np.sum((self.degrees + count) * np.log1p(energy / self.degrees)))
        louder = float(np.sum(self._by_channel(innovations.there) * np.log(scales)))
        return self.temper * (blocks + louder + float(np.sum(innovations.spread)))

    def weights(self, innovations: FilterInnovations, white: Array) -> Array:
        """(B,) weights of the squares of whitened innovations."""
        degrees = self.degrees + np.sum(innovations.there, axis=1)
        return np.asarray(self.temper * degrees / (self.degrees + np.sum(white**2, axis=1)))

    def _by_channel(self, values: Array | Mask) -> Array:
        return np.asarray(np.sum(values.reshape(-1, self.channels), axis=0), dtype=float)


def plain_noise(size: int, channels: int) -> InnovationNoise:
    """The distribution that the filter itself predicts."""
    return InnovationNoise(np.eye(size), channels, CAL.block_degrees, 1.0)


def noise_of(of_rides: Sequence[FilterInnovations], channels: int) -> InnovationNoise:
    """Distribution of the innovations of rides.

    Their covariance is that of a stationary series, to which each ride contributes relative to its scales.
    """
    size = of_rides[0].white.shape[1]
    rows = size // channels
    start, gamma, total = plain_noise(size, channels), np.zeros((rows, channels, channels)), 0.0
    for item in of_rides:
        scales = start.scales(item)
        white = start.white(item, scales)
        white *= np.sqrt(start.weights(item, white))[:, None]
        for run in np.unique(item.runs):
            series = white[item.runs == run].reshape(-1, channels)
            for lag in range(min(rows, len(series))):
                gamma[lag] += series[: len(series) - lag].T @ series[lag:]
        total += float(np.sum(item.there)) / channels
    gamma /= total
    parts = [[gamma[b - a] if b >= a else gamma[a - b].T for b in range(rows)] for a in range(rows)]
    covariance = np.block(parts) + CAL.block_ridge * np.eye(size)
    return replace(start, root=np.asarray(np.linalg.cholesky(covariance), dtype=float))


class Follower:
    """A filter of a model, for any of its numbers.

    Parameters
    ----------
    model : equations of motion with all effects that may change.
    read : outputs that are read.

    Attributes
    ----------
    p : (parameters,) the model's numbers and sizes of noise.
    size : readings in a block.
    """

    def __init__(self, model: MotionModel, read: Sequence[str]) -> None:
        self.model = with_unknown_forces(model)
        self.read = tuple(read)
        self.size = round(CAL.block / CAL.apart) * len(self.read)
        weight = float(self.model["m"].array) * G if "m" in self.model else 1.0
        forces = [name for name, _ in FORCES.values() if name in self.model]
        tracked = [Tracked(name, "N", 0.0, CAL.floor_of_weight * weight, False, True) for name in forces]
        self.space = StateSpace(self.model, tracked, self.read, throughout=True)  # rows are cut where delays move
        self._filter = filtering(self.space, "ekf", SigmaPoints(), NO_GATE, many=True)
        self.p = np.empty(0)
        self._places = {parameter.name: self.space.place(parameter.name) for parameter in self.model.parameters}
        self._laid: dict[tuple[int, tuple[float, ...]], list[LaidRun]] = {}

    def tune(self, rides: Sequence[FollowedRun], values: Mapping[str, float]) -> None:
        """Find the sizes of noise that make all rides together most probable, given these numbers."""
        scatter, floors = (
            {name: float(np.median([getattr(ride, kind)[name] for ride in rides])) for name in self.read}
            for kind in ("scatter", "floors")
        )
        levels = start_levels(self.space, scatter, self.read, {})
        p = np.concatenate([self._numbers(values), levels.values])
        longest_first = (
            sorted(self._runs(ride, p), key=lambda item: item.run.time[0] - item.run.time[-1]) for ride in rides
        )
        runs = [item for each in longest_first for item in beginning(each, CAL.tuned_on)]
        memories = {f"memory_{one.name}": CAL.memory for one in self.space.tracked}
        memories |= {f"memory_{name}": CAL.sensor_memory for name in self.space.coloured}
        for name, seconds in memories.items():
            p[self.model.size + self.space.noises.index(name)] = seconds
        open_ones = [name for name in levels.open if name not in memories]
        coordinates = noise_coordinates(self._filter, p, open_ones, floors)
        if len(self.p):  # from earlier estimates
            p[self.model.size :] = self.p[self.model.size :]
        result = tuned(self._filter, runs, p, coordinates, [])
        self.p = np.concatenate([self.model.values, result.p[self.model.size :]])

    def innovations(self, ride: FollowedRun, tried: Sequence[Mapping[str, float]]) -> list[FilterInnovations | None]:
        """Innovations with several sets of numbers of the model, filtered side by side where their delays are alike.

        None where the filter diverges at once. Where it diverges later, innovations are set to a large value, so that
        no number gains by losing the vehicle.
        """
        p = np.array([np.concatenate([self._numbers(values), self.p[self.model.size :]]) for values in tried])
        laid_out = [self._runs(ride, item) for item in p]
        result: list[FilterInnovations | None] = [None] * len(p)
        for runs in {id(item): item for item in laid_out}.values():
            alike = [k for k, item in enumerate(laid_out) if item is runs]
            for k, block in zip(alike, self._blocks(runs, self._filter.innovations(runs, p[alike])), strict=True):
                result[k] = block
        return result

    def _blocks(self, runs: Sequence[LaidRun], parts: Sequence[tuple[Array, Array]]) -> list[FilterInnovations | None]:
        """Innovations (L, S, m) of runs and their variances, in blocks, for each of L filters."""
        columns = [self.model.outputs.index(name) for name in self.read]
        size, filters = round(CAL.block / CAL.apart), len(parts[0][0])
        latest = LATEST[1] if self.model.latencies else 0.0
        result, there, of_run = list[Array](), list[Mask](), list[int]()
        for number, (run, both) in enumerate(zip(runs, parts, strict=True)):
            rows = np.flatnonzero(np.any(np.isfinite(run.run.measured[:, columns]), axis=1))
            rows = rows[run.run.time[rows] > run.run.time[0] + latest]  # earlier ones initialise the filter
            taken = run.read_segment[rows][:, columns]
            off, variance = (each[:, taken, columns] for each in both)
            read = np.isfinite(run.run.measured[rows][:, columns]) & (taken >= 0)
            blocks = -(-len(rows) // size)
            beyond = blocks * size - len(rows)
            with np.errstate(invalid="ignore", divide="ignore"):  # where a filter diverges
                each = np.where(read, [off / np.sqrt(variance), 0.5 * np.log(variance)], 0.0)
            each = np.pad(each, ((0, 0), (0, 0), (0, beyond), (0, 0))).reshape(2, filters, blocks, size * len(columns))
            result.append(each)
            there.append(np.pad(read, ((0, beyond), (0, 0))).reshape(blocks, size * len(columns)))
            of_run.extend([number] * blocks)
        (white, spread), read = np.concatenate(result, axis=2), np.concatenate(there)
        astray = ~(np.isfinite(white) & np.isfinite(spread))
        white[astray], spread[astray] = CAL.astray, 0.0
        return [
            None if np.array_equal(lost, read) else FilterInnovations(item, read, by, np.array(of_run, dtype=np.intp))
            for item, by, lost in zip(white, spread, astray, strict=True)
        ]

    def _numbers(self, values: Mapping[str, float]) -> Array:
        p = np.array(self.model.values)
        for name, value in values.items():
            p[self._places[name]] = value
        return p

    def _runs(self, ride: FollowedRun, p: Array) -> list[LaidRun]:
        """A ride laid out for delays of these numbers."""
        trace, numbers = self.space.trace, p[: self.model.size]
        shifts = tuple(np.asarray(trace.timing(numbers).full()).ravel().tolist()) if trace.shift_count else ()
        key = id(ride), shifts
        if key not in self._laid:
            while len(self._laid) > 64:
                del self._laid[next(iter(self._laid))]
            self._laid[key] = laid(self.space, ride.recording, numbers, self.read)
        return self._laid[key]
