"""The course of a magnitude that varies: along the path where positions are recorded, else over time.

The magnitude is a Gaussian process with covariance sd^2 exp(-d / reach), where d is the distance between two places or
instants (Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006, Sec. 4.2.1); places count as near only
where they are passed in the same direction. It acts on the linearised equations beside unknown forces of their usual
size, and is estimated at knots together with all nuisances. Laps that pass a place again inform the same knot: a course
along the path is a property of the road, one over time is a property of the drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import nan
from typing import Any

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from ...base.shorthands import Array, Mask
from ...datasets.recording import Recording
from .axes import Axis
from .bench import Bench
from .calibration import CAL
from .free_runs import Misfit, misfit, to_first_order
from .hypothesis import Hypothesis
from .model_error import Amplitudes, ForceSizes, linearised, model_error
from .noise import white_noise
from .search import Search
from .strip import recorded_path, running
from .wandering import Wander

PATH, TIME = "path", "time"


@dataclass(frozen=True)
class MagnitudeCourse:
    """The course of a magnitude.

    Attributes
    ----------
    effect, unit : of the magnitude.
    along : "path" or "time".
    sd, reach : standard deviation of the magnitude, and how far it stays similar, m or s.
    at : (knots,) distance driven until a knot's place was first passed, m, or time, s.
    x, y, yaw : (knots,) m, m, rad, its place and the direction of driving; empty over time.
    value, value_sd : (knots,) magnitude there, less its constant part, and its standard deviation.
    closed, closed_interval : share of the excess error of free runs that it removes, and its 95 % interval.
    recordings, held_out : on which that was computed, and whether they are others than it was estimated on.
    """

    effect: str
    unit: str
    along: str
    sd: float
    reach: float
    at: Array
    x: Array
    y: Array
    yaw: Array
    value: Array
    value_sd: Array
    closed: float = nan
    closed_interval: tuple[float, float] = (nan, nan)
    recordings: tuple[str, ...] = ()
    held_out: bool = False

    def to_json(self) -> dict[str, Any]:
        """The course as plain data."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}

    def weights(self, places: Places) -> Array:
        """(N, knots) by which rows take the knots' magnitudes: their expectation, which is none far from all knots."""
        return _weights(places.coordinates(self.along, self.reach), self._coordinates(), self.reach)

    def _coordinates(self) -> Array:
        return Places(self.at, self.at, self.x, self.y, self.yaw).coordinates(self.along, self.reach)


@dataclass(frozen=True)
class Places:
    """Where and when rows are.

    Attributes
    ----------
    time, distance : (N,) s and m, continued from recording to recording.
    x, y, yaw : (N,) m, m, rad; empty where positions are not recorded.
    """

    time: Array
    distance: Array
    x: Array
    y: Array
    yaw: Array

    @classmethod
    def of(cls, bench: Bench, recordings: Sequence[Recording]) -> Places:
        """Those of a bench's rows; directions are taken over half a second."""
        time, nothing = running(bench.time), np.empty(0)
        recorded = recorded_path(bench, recordings)
        if recorded is None:
            return cls(time, nothing, nothing, nothing, nothing)
        x, y = (_filled(values) for values in recorded)
        apart = max(1, round(0.25 / bench.sample_time))
        dx, dy = (_across(values, bench.rows, apart) for values in (x, y))
        steps = np.hypot(dx, dy) / (2 * apart)
        return cls(time, np.cumsum(steps), x, y, np.arctan2(dy, dx))

    def at(self, rows: Array) -> Places:
        """Those of some rows, where positions are recorded."""
        return Places(self.time[rows], self.distance[rows], self.x[rows], self.y[rows], self.yaw[rows])

    def coordinates(self, along: str, reach: float) -> Array:
        """(N, dimensions) coordinates whose distances are those of places or instants."""
        if along == TIME:
            return self.time[:, None]
        return np.column_stack([self.x, self.y, reach * np.cos(self.yaw), reach * np.sin(self.yaw)])


def course(
    search: Search,
    best: Hypothesis,
    wander: Wander,
    axis: Axis,
    quiet: Amplitudes,
    noise: Array,
    good: Mask,
    places: Places,
) -> MagnitudeCourse:
    """The likelier one of the courses of an effect's magnitude along the path and over time.

    Parameters
    ----------
    search : what refitted the hypothesis, on a bench of a model with unknown forces.
    best : the explanation beside which the magnitude varies.
    wander, axis : the effect and by how much it varies, and the axis of its magnitude.
    quiet : amplitudes of model error beside it.
    noise : (channels,) standard deviations of the readings at which runs start.
    good : (N, channels) readings that count.
    """
    bench = search.bench
    assert isinstance(bench, Bench)
    p = search.vector(best)
    whitener = model_error(linearised(bench, p, noise, ForceSizes(bench)), quiet, good)
    with search.counted(whitener):
        search.about(best, delays=False)
        J, precision, off = search.white, search.precision, np.concatenate([best.theta, best.linear]) - search.means
    r, sizes = whitener.white(best.e[:, :, None])[..., 0].ravel(), whitener.white(best.J).reshape(len(J), -1)
    sizes = sizes[:, np.any(sizes != 0, axis=0)]  # of the other effects
    J, off = np.hstack([J, sizes]), np.append(off, np.zeros(sizes.shape[1]))
    precision = block_diag(precision, np.zeros((sizes.shape[1],) * 2))
    speed = float(places.distance[-1] / max(np.ptp(places.time), 1e-9)) if len(places.distance) else 0.0
    ways = [(TIME, wander.correlation_time), *([(PATH, speed * wander.correlation_time)] if speed > 0 else [])]
    result = list[tuple[float, MagnitudeCourse]]()
    for along, reach in ways:
        coordinates = places.coordinates(along, reach)
        knots = _knots(coordinates, CAL.knots_apart * reach)
        at = coordinates[knots]
        response = responses(bench, p, axis.index, _weights(coordinates, at, reach))
        W = whitener.white(response).reshape(len(r), len(knots))
        prior = wander.sd**2 * np.exp(-_apart(at, at) / reach)
        value, covariance, evidence = _posterior(W, prior, J, precision, off, r)
        here = places.at(knots) if along == PATH else Places(places.time[knots], *[np.empty(0)] * 4)
        one = MagnitudeCourse(
            wander.effect, wander.unit, along, wander.sd, reach, here.distance if along == PATH else here.time,
            here.x, here.y, here.yaw, value, np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        )  # fmt: skip
        result.append((evidence, one))
    return max(result, key=lambda each: each[0])[1]


def with_course(
    search: Search, freed: Hypothesis, course: MagnitudeCourse, index: int, sd: Array, good: Mask, places: Places
) -> tuple[Misfit, Misfit]:
    """Errors of free runs without and with a course, nuisances refitted to first order with it.

    Parameters
    ----------
    search, freed : a hypothesis refitted to free runs, and what refitted it.
    course, index : of a magnitude, and the index of its parameter.
    sd, good : (channels,) of noise; (N, channels) readings that count.
    """
    bench = search.bench
    assert isinstance(bench, Bench)
    response = responses(bench, search.vector(freed), index, (course.weights(places) @ course.value)[:, None])[..., 0]
    with search.counted(white_noise(sd, good, bench.rows)):
        search.about(freed, delays=False)
        return misfit(search, freed), to_first_order(search, freed, freed.e + response)


def responses(bench: Bench, p: Array, index: int, weights: Array) -> Array:
    """(N, channels, K) what readings change by, per unit of K courses of a parameter, to first order.

    Parameters
    ----------
    bench : of a model that has the parameter.
    p : (parameters,) about which simulations are linearised.
    index : of the parameter.
    weights : (N, K) its value at each row in each course; it is held until the next row.
    """
    about = linearised(bench, p, np.ones(len(bench.channels)), ForceSizes(bench), [index])
    along = weights[_rows_of_segments(bench, p)]
    result = np.zeros((*bench.measured.shape, along.shape[1]))
    state = np.zeros((about.A.shape[1], along.shape[1]))
    B, D = about.B[:, :, -1:], about.D[:, :, -1:]
    for k in range(len(along)):
        if about.first[k]:
            state[:] = 0.0
        a, b = about.pointer[k], about.pointer[k + 1]
        if a < b:
            channels = about.channel[a:b]
            result[about.row[a:b], channels] = about.C[k, channels] @ state + D[k, channels] * along[k]
        state = about.A[k] @ state + B[k] * along[k]
    return result


def _rows_of_segments(bench: Bench, p: Array) -> Array:
    """(S,) row from which the commands of each segment are."""
    return np.concatenate([
        rows.start + np.maximum(np.searchsorted(plan.row_segment, np.arange(len(plan.segments)), side="right") - 1, 0)
        for rows, (plan, _) in zip(bench.rows, bench.trajectory(p), strict=True)
    ])  # fmt: skip


def _posterior(W: Array, prior: Array, J: Array, precision: Array, off: Array, r: Array) -> tuple[Array, Array, float]:
    """Posterior mean and covariance of knots with nuisances marginalised, and the log evidence up to a constant.

    Parameters
    ----------
    W, J : whitened derivatives by knots and by nuisances.
    prior : (knots, knots) covariance.
    precision, off : of nuisances, and how far they are from their prior means.
    r : whitened residuals.
    """
    H = J.T @ J + precision + CAL.ridge * np.diag(np.maximum(np.diag(J.T @ J + precision), 1e-300))
    factor = cho_factor(H)
    cross, g = J.T @ W, J.T @ r + precision @ off
    S = W.T @ W - cross.T @ cho_solve(factor, cross)
    b = W.T @ r - cross.T @ cho_solve(factor, g)
    root = np.linalg.cholesky(prior + CAL.ridge * np.trace(prior) / len(prior) * np.eye(len(prior)))
    inner = cho_factor(np.eye(len(prior)) + root.T @ S @ root)
    covariance = root @ cho_solve(inner, root.T)
    value = -covariance @ b
    evidence = -0.5 * float(b @ value) - float(np.sum(np.log(np.diag(inner[0]))))
    return value, covariance, evidence


def _knots(coordinates: Array, apart: float) -> Array:
    """Rows, in order, that are at least so far from all knots before them; farther where knots are many."""
    left, knots = np.full(len(coordinates), np.inf), list[int]()
    while np.any(far := left >= apart):
        if len(knots) == CAL.most_knots:
            return _knots(coordinates, 1.5 * apart)
        knots.append(int(np.argmax(far)))
        left = np.minimum(left, np.linalg.norm(coordinates - coordinates[knots[-1]], axis=1))
    return np.array(knots)


def _weights(coordinates: Array, knots: Array, reach: float) -> Array:
    """(N, knots) by which the process is interpolated between knots."""
    between = cho_factor(np.exp(-_apart(knots, knots) / reach))
    return np.asarray(cho_solve(between, np.exp(-_apart(knots, coordinates) / reach)).T)


def _apart(these: Array, those: Array) -> Array:
    """(these, those) distances."""
    from scipy.spatial.distance import cdist  # imported here: few diagnoses follow a course

    return np.asarray(cdist(these, those))


def _filled(values: Array) -> Array:
    rows, read = np.arange(len(values)), np.isfinite(values)
    return np.interp(rows, rows[read], values[read])


def _across(values: Array, runs: Sequence[slice], apart: int) -> Array:
    """(N,) differences over `apart` rows to either side, within runs."""
    result = np.zeros(len(values))
    for rows in runs:
        one = np.pad(values[rows], apart, mode="edge")
        result[rows] = one[2 * apart :] - one[: -2 * apart]
    return result
