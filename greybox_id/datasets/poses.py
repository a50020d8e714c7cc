"""Motion from poses: velocities, yaw rate and accelerations at the centre of gravity from x, y and yaw alone.

Two fixed-interval smoothers, one after the other. The yaw acceleration is a random walk, and so are the accelerations
along and across the vehicle, which the smoothed yaw rotates into the map's axes:

    psi' = r,  r' = alpha,  dalpha = q_psi dw            measured: psi
    p' = v,  v' = R(psi) a,  da = diag(q_x, q_y) dw      measured: p

Readings have white noise of standard deviation r_psi and r_p. The five levels q and r maximise the likelihood of the
poses; nothing is tuned by hand. The same likelihood decides whether the poses were taken at their time stamps or at
even steps (motion capture samples evenly; its stamps scatter by the computer's delays). Poses that no plausible motion
explains are removed as glitches. A pose that equals the previous one in x, y and yaw is a repeated reading and ignored.

Filter: Kalman, in Joseph's form; backwards the modified Bryson-Frazier recursion, which inverts no covariance.
Sources: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, Sec. 6.2.3 (white
noise jerk); Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, Ch. X; de Jong, A cross-validation
filter for time series models, Biometrika 75, 1988 (each reading against all others).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import ndtri

from ..base.errors import BadInput
from ..base.numbers import number
from ..base.shorthands import Array
from .column_map import Reference
from .pose_smoother import log_likelihood, smooth
from .recording import split_runs

MADE = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")
"""Signals computed from poses."""
BLOCK_ROWS = 500
"""Rows of a block on which the levels are estimated; each block counts as a run."""
BLOCKS = 4
"""Number of blocks: 2 000 rows determine the levels to about 5 %."""
GLITCHES = 0.05
"""Expected number of sound poses in a whole file that are wrongly removed as glitches."""
AROUND = 10
"""Rows around the worst glitch that are judged again without it."""
PASSES = 20
"""Largest number of rounds of removing glitches."""
FEWEST = 10
"""Fewest poses from which their noise is estimated."""
UNTOLD = 0.5
"""Share of a run's initial sd above which a smoothed value becomes NaN: the poses hardly inform it."""
LEAST_SCATTER = 1e-4
"""Scatter of stamps, as a share of a step, below which they are even."""
TOLERANCE = 0.03
"""Tolerance of the search for the logarithms of the levels: 3 % of a level."""


@dataclass(frozen=True)
class PoseMotion:
    """Motion estimated from poses.

    Attributes
    ----------
    time : (n,) s: the time stamps, or even steps within each run.
    signals : x, y, yaw and those of `MADE` at the centre of gravity, (n,) each; NaN where the poses hardly inform a
        value, for example at a single pose between two gaps.
    sd : their standard deviations, (n,) each. The pose's mounting point on the vehicle is assumed exact.
    notes : steps taken, as sentences.
    """

    time: Array
    signals: Mapping[str, Array]
    sd: Mapping[str, Array]
    notes: tuple[str, ...]


def motion(time: Array, x: Array, y: Array, yaw: Array, reference: Reference, where: str) -> PoseMotion:
    """Estimate the motion of the centre of gravity from poses.

    Parameters
    ----------
    time : (n,) s; where it jumps or steps back, a new run begins.
    x, y, yaw : (n,) m, m, rad in fixed axes, y and yaw to the left; NaN where missing. Yaw may wrap after a full turn.
    reference : mounting point of the poses on the vehicle.
    where : the file, for errors.

    Raises
    ------
    BadInput
        There are too few poses.
    """
    complete = np.flatnonzero(np.isfinite(x) & np.isfinite(y) & np.isfinite(yaw) & np.isfinite(time))
    moved = [np.diff(values[complete]) != 0 for values in (x, y, yaw)]
    fresh = np.zeros(len(time), dtype=bool)
    fresh[complete[:1]] = True
    fresh[complete[1:][moved[0] | moved[1] | moved[2]]] = True
    if np.count_nonzero(fresh) < FEWEST:
        raise BadInput(
            f"{where}: {np.count_nonzero(fresh)} poses that differ are too few to estimate motion from; "
            "remove the [poses] table from the column map."
        )
    notes = []
    if repeated := len(complete) - int(np.count_nonzero(fresh)):
        notes.append(f"{repeated} of {len(complete)} poses repeat the previous pose; they do not count as readings.")
    poses = _Poses(time, fresh, x, y, yaw)
    levels = _likeliest(poses, None)
    even = _evened(time)
    scatter = float(np.sqrt(np.mean((even - time) ** 2)))
    if scatter > LEAST_SCATTER * float(np.median(poses.steps[poses.steps > 0])):
        stepped = replace(poses, time=even)
        even_levels = _likeliest(stepped, levels)
        if even_levels.evidence > levels.evidence:
            poses, levels = stepped, even_levels
            notes.append(
                f"the poses' stamps scatter by {number(1e3 * scatter, 2)} ms about even steps, and even steps "
                "explain the poses better: the time was set to even steps."
            )
    poses, levels, smoothed = _without_glitches(poses, levels, notes)
    return _at_centre(poses, levels, smoothed, reference, notes)


@dataclass(frozen=True)
class _Poses:
    """Poses, with a mask of those that count as readings (`fresh`)."""

    time: Array
    fresh: NDArray[np.bool_]
    x: Array
    y: Array
    yaw: Array

    @functools.cached_property
    def begins(self) -> Array:
        """(n,) 1 at the first row of each run, else 0."""
        begins = np.zeros(len(self.time))
        begins[[start for start, _ in split_runs(self.time)]] = 1.0
        return begins

    @functools.cached_property
    def steps(self) -> Array:
        """(n,) s since the previous row; zero at the first row of a run."""
        return np.where(self.begins == 1, 0.0, np.diff(self.time, prepend=self.time[0]))

    @functools.cached_property
    def filled(self) -> Mapping[str, Array]:
        """x, y and unwrapped yaw, with the last reading repeated in rows without one."""
        at = np.flatnonzero(self.fresh)
        last = at[np.clip(np.searchsorted(at, np.arange(len(self.time)), side="right") - 1, 0, None)]
        turned = np.zeros(len(self.time))
        turned[at] = np.unwrap(self.yaw[at])
        return {"x": self.x[last], "y": self.y[last], "yaw": turned[last]}

    @functools.cached_property
    def means(self) -> Mapping[str, float]:
        """Means of x, y and yaw, subtracted while filtering."""
        return {name: float(np.mean(values[self.fresh])) for name, values in self.filled.items()}

    def centred(self, name: str) -> Array:
        """(n,) a pose coordinate less its mean."""
        return self.filled[name] - self.means[name]

    def fastest(self, *names: str) -> float:
        """Largest rate of change between consecutive readings of these coordinates."""
        at = np.flatnonzero(self.fresh)
        gaps = np.diff(self.time[at])
        usual = float(np.median(gaps[gaps > 0])) if np.any(gaps > 0) else 1.0
        changes = [np.abs(np.diff(self.filled[name][at])) for name in names]
        return float(np.max([np.max(change / np.maximum(gaps, usual)) for change in changes])) or 1.0

    def most_driven(self) -> list[int]:
        """First rows of the blocks used to estimate levels: of evenly spread blocks, those with the longest path."""
        n = len(self.time)
        if n <= BLOCK_ROWS * BLOCKS:
            return list(range(0, n, BLOCK_ROWS))
        steps = np.hypot(np.diff(self.filled["x"]), np.diff(self.filled["y"]))
        path = np.concatenate(([0.0], np.cumsum(np.where(self.begins[1:] == 1, 0.0, steps))))
        starts = np.linspace(0, n - BLOCK_ROWS, min(2 * BLOCKS, n // BLOCK_ROWS)).astype(int)
        far = np.argsort(path[starts] - path[starts + BLOCK_ROWS - 1], kind="stable")[:BLOCKS]
        return sorted(starts[far].tolist())


@dataclass(frozen=True)
class _Levels:
    """Logarithms of the levels: yaw (q_psi, r_psi), place (q_x, q_y, r_p); and the log-likelihood of the poses."""

    yaw: Array
    place: Array
    evidence: float


@dataclass(frozen=True)
class _Smoothed:
    """States p, v, a (n, 3 axes), their covariance, and each reading's residual against all others (n, axes), in sd."""

    state: Array
    P: Array
    against_others: Array


def _likeliest(poses: _Poses, start: _Levels | None) -> _Levels:
    """Maximum-likelihood levels, estimated on a part of the poses."""
    yaw, evidence = _climbed(poses, ("yaw",), None, None if start is None else start.yaw)
    psi = _through(poses, ("yaw",), yaw, None).state[:, 0]
    place, more = _climbed(poses, ("x", "y"), psi, None if start is None else start.place)
    return _Levels(yaw, place, evidence + more)


def _climbed(poses: _Poses, names: tuple[str, ...], psi: Array | None, start: Array | None) -> tuple[Array, float]:
    rows, loose = _rows(poses, names, psi), _loose(poses, names)
    parts = np.vstack([_on_its_own(rows[begin : begin + BLOCK_ROWS]) for begin in poses.most_driven()])

    def unlikeliness(levels: Array) -> float:
        result = -float(log_likelihood(parts, _variances(levels, loose), len(names)))
        return result if np.isfinite(result) else np.inf

    edge = 1.0 if start is None else 0.2
    if start is None:
        start = np.log([*[10 * poses.fastest(*names)] * len(names), _fast(poses, names[0])])
    simplex = np.vstack([start, start + edge * np.eye(len(start))])
    result = minimize(
        unlikeliness,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": TOLERANCE, "fatol": 0.1, "maxfev": 400},
    )
    return np.asarray(result.x), -float(result.fun)


def _fast(poses: _Poses, name: str) -> float:
    """Standard deviation of readings from third differences of changing values: an upper bound of their noise."""
    third = np.abs(np.diff(poses.filled[name][poses.fresh], 3))
    third = third[third > 0]
    return float(np.median(third)) / np.sqrt(20) if len(third) else 1e-6


def _loose(poses: _Poses, names: tuple[str, ...]) -> Array:
    """Logarithms of the initial standard deviations of p, v and a of a run: larger than any of them can be."""
    size = max(float(np.max(np.abs(poses.centred(name)))) for name in names) or 1.0
    rate = poses.fastest(*names)
    usual = float(np.median(poses.steps[poses.steps > 0])) if np.any(poses.steps > 0) else 1.0
    return np.log([2 * size, 2 * rate, rate / (10 * usual)])


def _rows(poses: _Poses, names: tuple[str, ...], psi: Array | None) -> Array:
    """Input rows of the smoother (see `pose_smoother`); `psi` rotates accelerations if positions are smoothed."""
    columns = [poses.steps, poses.begins, poses.fresh.astype(float), *(poses.centred(name) for name in names)]
    if psi is not None:
        once, twice = _turning(np.diff(psi, prepend=psi[0]))
        before = np.exp(1j * (np.concatenate([psi[:1], psi[:-1]]) + poses.means["yaw"]))
        columns += [(before * once).real, (before * once).imag, (before * twice).real, (before * twice).imag]
    return np.column_stack(columns)


def _turning(by: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Change of velocity and position by an acceleration that rotates evenly over a step, relative to a constant one.

    A constant acceleration a adds h a and h^2 a / 2 over a step h; one that rotates by delta, with z = i delta, adds
    h a (e^z - 1) / z and h^2 a (e^z - 1 - z) / z^2.
    """
    z = 1j * by
    small = np.abs(by) < 1e-2
    safe = np.where(small, 1.0, z)
    once = np.where(small, 1 + z / 2 + z**2 / 6 + z**3 / 24, (np.exp(safe) - 1) / safe)
    twice = np.where(small, 1 + z / 3 + z**2 / 12 + z**3 / 60, 2 * (np.exp(safe) - 1 - safe) / safe**2)
    return once, twice


def _variances(*logarithms: Array) -> Array:
    """Variances, from logarithms of standard deviations."""
    return np.exp(2 * np.concatenate(logarithms))


def _on_its_own(rows: Array) -> Array:
    """A block of input rows, marked as a separate run."""
    rows = rows.copy()
    rows[0, :2] = 0.0, 1.0
    return rows


def _through(poses: _Poses, names: tuple[str, ...], levels: Array, psi: Array | None) -> _Smoothed:
    """Filter and smooth all rows."""
    return _Smoothed(*smooth(_rows(poses, names, psi), _variances(levels, _loose(poses, names)), len(names)))


def _evened(time: Array) -> Array:
    """Time at even steps of one length, each run placed by the mean of its stamps."""
    runs = [(a, b) for a, b in split_runs(time) if b - a > 1]
    about = [(np.arange(b - a) - (b - a - 1) / 2, time[a:b] - np.mean(time[a:b])) for a, b in runs]
    weight = sum(float(k @ k) for k, _ in about)
    if not weight:
        return time
    step = sum(float(k @ t) for k, t in about) / weight
    even = time.copy()
    for (a, b), (k, _) in zip(runs, about, strict=True):
        even[a:b] = np.mean(time[a:b]) + step * k
    return even


def _without_glitches(
    poses: _Poses, levels: _Levels, notes: list[str]
) -> tuple[_Poses, _Levels, tuple[_Smoothed, _Smoothed]]:
    """Remove poses that disagree with all others, the worst of a neighbourhood first; then re-estimate the levels."""
    limit = -float(ndtri(GLITCHES / (2 * 3 * len(poses.time))))
    before = known = int(np.count_nonzero(poses.fresh))
    for _ in range(PASSES):
        yaw = _through(poses, ("yaw",), levels.yaw, None)
        place = _through(poses, ("x", "y"), levels.place, yaw.state[:, 0])
        against = np.max(np.abs(np.hstack([yaw.against_others, place.against_others])), axis=1)
        worst = _peaks(against, limit)
        left = int(np.count_nonzero(poses.fresh)) - len(worst)
        if worst:
            fresh = poses.fresh.copy()
            fresh[worst] = False
            poses = replace(poses, fresh=fresh)
        elif left == known:
            break
        else:
            levels, known = _likeliest(poses, levels), left
    if left < before:
        notes.append(
            f"{before - left} of {before} poses were left out: no plausible motion passes through them and their "
            "neighbours."
        )
    return poses, levels, (yaw, place)


def _peaks(values: Array, limit: float) -> list[int]:
    """Rows above a limit, none within `AROUND` of a larger one."""
    result: list[int] = []
    for row in sorted(np.flatnonzero(values > limit), key=lambda row: -values[row]):
        if all(abs(int(row) - other) > AROUND for other in result):
            result.append(int(row))
    return result


def _at_centre(
    poses: _Poses, levels: _Levels, smoothed: tuple[_Smoothed, _Smoothed], reference: Reference, notes: list[str]
) -> PoseMotion:
    turning, place = smoothed
    psi = turning.state[:, 0] + poses.means["yaw"] - reference.heading
    r, alpha = turning.state[:, 1], turning.state[:, 2]
    c, s = np.cos(psi), np.sin(psi)
    n = len(psi)
    R = np.empty((n, 2, 2))  # from the map's axes to the vehicle's
    R[:, 0, 0], R[:, 0, 1], R[:, 1, 0], R[:, 1, 1] = c, s, -s, c
    h = reference.heading
    turned = np.array([[np.cos(h), -np.sin(h)], [np.sin(h), np.cos(h)]])  # from the pose's axes to the vehicle's
    v = np.einsum("kij,kj->ki", R, place.state[:, 2:4])
    a = place.state[:, 4:6] @ turned.T
    f, left = reference.forward, reference.left
    at = place.state[:, :2] - np.stack([c * f - s * left, s * f + c * left], axis=1)
    signals = {
        "x": at[:, 0] + poses.means["x"],
        "y": at[:, 1] + poses.means["y"],
        "yaw": psi,
        "v_x": v[:, 0] + left * r,
        "v_y": v[:, 1] - f * r,
        "yaw_rate": r,
        "a_x": a[:, 0] + left * alpha + f * r**2,
        "a_y": a[:, 1] - f * alpha + left * r**2,
    }
    Y, P = turning.P, place.P
    V = np.einsum("kij,kjl,kml->kim", R, P[:, 2:4, 2:4], R)
    A = turned @ P[:, 4:6, 4:6] @ turned.T

    def lever(of_yaw: tuple[Array | float, Array | float, Array | float]) -> Array:
        """Variance due to errors of yaw, yaw rate and yaw acceleration, given the derivatives by these."""
        d = np.stack([np.broadcast_to(np.asarray(one, dtype=float), n) for one in of_yaw], axis=1)
        return np.asarray(np.einsum("ki,kij,kj->k", d, Y, d))

    variance = {
        "x": P[:, 0, 0] + lever((s * f + c * left, 0, 0)),
        "y": P[:, 1, 1] + lever((s * left - c * f, 0, 0)),
        "yaw": Y[:, 0, 0],
        "v_x": V[:, 0, 0] + lever((v[:, 1], left, 0)),
        "v_y": V[:, 1, 1] + lever((-v[:, 0], -f, 0)),
        "yaw_rate": Y[:, 1, 1],
        "a_x": A[:, 0, 0] + lever((a[:, 1], 2 * f * r, left)),
        "a_y": A[:, 1, 1] + lever((-a[:, 0], 2 * left * r, -f)),
    }
    sd = {name: np.sqrt(np.maximum(values, 0.0)) for name, values in variance.items()}
    _, v_loose, a_loose = np.exp(_loose(poses, ("x", "y")))
    loose = {
        "v_x": v_loose,
        "v_y": v_loose,
        "yaw_rate": np.exp(_loose(poses, ("yaw",)))[1],
        "a_x": a_loose,
        "a_y": a_loose,
    }
    for name in MADE:
        signals[name] = np.where(sd[name] > UNTOLD * loose[name], np.nan, signals[name])
    return PoseMotion(poses.time, signals, sd, tuple(notes))
