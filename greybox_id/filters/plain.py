"""Filters in plain Python, for machines without a compiler: CasADi evaluates the model, filterpy is the UKF.

They do the same as the compiled ones. filterpy: R. R. Labbe, github.com/rlabbe/filterpy.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as cs
import numpy as np

from ..base.shorthands import Array
from .kernel import History, Kept, Kind, SigmaPoints, blank_history
from .state_space import StateSpace


class PlainFilter:
    """An EKF or a UKF in Python."""

    def __init__(self, space: StateSpace, kind: Kind, points: SigmaPoints) -> None:
        self.space, self.kind, self.points = space, kind, points

    def run(
        self, x: Array, P: Array, s: Array, y: Array, p: Array, gate: float, kept: Kept
    ) -> tuple[Array, History | None]:
        """As `CompiledFilter.run`."""
        cost, histories = np.zeros(len(x)), list[History]()
        for lane in range(len(x)):
            made = _Ekf if self.kind == "ekf" else _Ukf
            one = made(self.space, x[lane], P[lane], p[lane], gate, self.points)
            histories.append(_went_through(one, s, y))
            x[lane], P[lane], cost[lane] = one.x, one.P, one.cost
        if kept == "innovations":
            value = blank_history(len(x), len(s), x.shape[1], y.shape[1], kept)
            off, spread = (np.array([getattr(one, name) for one in histories]) for name in ("off", "spread"))
            return cost, replace(value, off=off, spread=spread)
        return cost, histories[0] if kept != "nothing" else None


def _went_through(filter_: _Ekf | _Ukf, s: Array, y: Array) -> History:
    count = len(s)
    history = blank_history(1, count, len(filter_.x), y.shape[1], "both ways")
    for k in range(count):
        history.predicted[k], history.predicted_P[k] = filter_.x, filter_.P
        history.off[k], history.spread[k] = filter_.read(s[k], y[k])
        history.filtered[k], history.filtered_P[k] = filter_.x, filter_.P
        if k + 1 < count:
            history.forward[k] = filter_.step(s[k])
    return history


def _numbers(function: cs.Function, *arguments: Array) -> list[Array]:
    return [np.asarray(value.full()) for value in function(*arguments)]


class _Ekf:
    """Extended Kalman filter: a reading at a time, covariances in Joseph's form."""

    def __init__(self, space: StateSpace, x: Array, P: Array, p: Array, gate: float, points: SigmaPoints) -> None:
        del points
        self.space, self.x, self.P, self.p, self.gate, self.cost = space, x.copy(), P.copy(), p, gate, 0.0

    def read(self, s: Array, y: Array) -> tuple[Array, Array]:
        """Update with readings; returns innovations and their variances."""
        y0, noise, H = _numbers(self.space.output, self.x, s, self.p)
        off, spread = np.full(len(y), np.nan), np.full(len(y), np.nan)
        x0 = self.x.copy()
        for i in np.flatnonzero(np.isfinite(y)):
            h = H[i]
            off[i] = y[i] - y0[i, 0] - h @ (self.x - x0)
            predicted_variance = float(h @ self.P @ h)
            spread[i] = predicted_variance + noise[i, 0]
            variance = max(spread[i], off[i] ** 2 / self.gate**2)
            self.cost += 0.5 * (off[i] ** 2 / variance + np.log(variance))
            K = self.P @ h / variance
            self.x = self.x + K * off[i]
            reduction = np.eye(len(h)) - np.outer(K, h)
            self.P = reduction @ self.P @ reduction.T + (variance - predicted_variance) * np.outer(K, K)
        return off, spread

    def step(self, s: Array) -> Array:
        """Predict the next segment; returns the covariance of x with its prediction."""
        ahead, noise, F = _numbers(self.space.step, self.x, s, self.p)
        forward = self.P @ F.T
        Q = np.diag(noise[:, 0])
        if self.space.throughout:  # the mean of (1 + t (F - 1)) Q (1 + t (F - 1))' over t from 0 to 1
            Q = (Q + 0.5 * (F @ Q + Q @ F.T) + F @ Q @ F.T) / 3
        self.x, self.P = ahead[:, 0], F @ forward + Q
        return forward


class _Ukf:
    """Unscented Kalman filter: filterpy's, with the gate before each of its updates."""

    def __init__(self, space: StateSpace, x: Array, P: Array, p: Array, gate: float, points: SigmaPoints) -> None:
        self.space, self.p, self.gate, self.cost = space, p, gate, 0.0
        n, m = space.size, len(space.model.outputs)
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter  # imported here: slow

        spread = MerweScaledSigmaPoints(n, points.alpha, points.beta, points.kappa, sqrt_method=_root)
        self._filter: Any = UnscentedKalmanFilter(n, m, 1.0, self._read, self._step, spread, x_mean_fn=_mean)
        self.x, self.P = x.copy(), P.copy()

    @property
    def x(self) -> Array:
        """The mean."""
        return np.asarray(self._filter.x)

    @x.setter
    def x(self, value: Array) -> None:
        self._filter.x = value

    @property
    def P(self) -> Array:
        """The covariance."""
        return np.asarray(self._filter.P)

    @P.setter
    def P(self, value: Array) -> None:
        self._filter.P = value

    def read(self, s: Array, y: Array) -> tuple[Array, Array]:
        """Update with readings; returns innovations and their variances."""
        read = np.flatnonzero(np.isfinite(y))
        off, spread = np.full(len(y), np.nan), np.full(len(y), np.nan)
        if len(read) == 0:
            return off, spread
        ukf = self._filter
        noise = _numbers(self.space.output, self.x, s, self.p)[1][read, 0]
        ukf.sigmas_f = ukf.points_fn.sigma_points(ukf.x, ukf.P)
        expected = np.array([self._read(point, s)[read] for point in ukf.sigmas_f])
        mean = ukf.Wm @ expected
        off[read] = y[read] - mean
        spread[read] = ukf.Wc @ (expected - mean) ** 2 + noise
        noise = noise + np.maximum(off[read] ** 2 / self.gate**2 - spread[read], 0)
        ukf.update(y[read], R=np.diag(noise), hx=lambda point: self._read(point, s)[read])
        ukf.P = (ukf.P + ukf.P.T) / 2
        self.cost += 0.5 * float(ukf.y @ ukf.SI @ ukf.y + np.linalg.slogdet(ukf.S)[1])
        return off, spread

    def step(self, s: Array) -> Array:
        """Predict the next segment; returns the covariance of x with its prediction."""
        ukf = self._filter
        before = ukf.points_fn.sigma_points(ukf.x, ukf.P)
        ukf.Q = np.diag(_numbers(self.space.step, self.x, s, self.p)[1][:, 0])
        ahead = np.array([self._step(point, 0.0, s) for point in before])
        ukf.compute_process_sigmas(0.0, s=s)
        before_deviations, ahead_deviations = before - _mean(before, ukf.Wm), ahead - _mean(ahead, ukf.Wm)
        forward = np.asarray(np.einsum("k,ki,kj->ij", ukf.Wc, before_deviations, ahead_deviations))
        ukf.predict(0.0, s=s)
        return forward

    def _step(self, point: Array, dt: float, s: Array) -> Array:
        del dt
        return _numbers(self.space.step, point, s, self.p)[0][:, 0]

    def _read(self, point: Array, s: Array) -> Array:
        return _numbers(self.space.output, point, s, self.p)[0][:, 0]


def _mean(points: Array, weights: Array) -> Array:
    """Weighted mean, relative to the first point, so that common values are exact."""
    return np.asarray(points[0] + weights @ (points - points[0]))


def _root(P: Array) -> Array:
    """Upper triangle U with U' U = P; zero in directions without variance."""
    n, L = len(P), np.zeros_like(P)
    for j in range(n):
        d = P[j, j] - L[j, :j] @ L[j, :j]
        if d > 1e-14 * P[j, j]:
            L[j, j] = np.sqrt(d)
            L[j + 1 :, j] = (P[j + 1 :, j] - L[j + 1 :, :j] @ L[j, :j]) / L[j, j]
    return np.asarray(L.T)
