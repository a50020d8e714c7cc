"""What named effects leave: is there structure in the residuals that driving explains, whatever its name?"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..engine.simulation import FreeRuns
from ..estimation.calibration import CAL
from ..estimation.hypothesis import Hypothesis
from ..estimation.search import Search
from ..shorthands import Array


def left_gain(search: Search, found: Hypothesis, seen: Mapping[str, Array]) -> tuple[float, float]:
    """Log-likelihood that a regression on how the vehicle is driven would still gain, and what noise alone would give.

    Parameters
    ----------
    search, found : the hypothesis and what refitted it.
    seen : signals per row.
    """
    features = _features(search.bench, seen)
    gain, expected = 0.0, 0.0
    r = search.colour.white(found.e[:, :, None])[:, :, 0]
    for c in range(r.shape[1]):
        use = search.colour.usable[:, c]
        if np.count_nonzero(use) < 4 * features.shape[1]:
            continue
        X = features[use]
        G = X.T @ X + 1e-6 * len(X) * np.eye(X.shape[1])
        b = X.T @ r[use, c]
        gain += 0.5 * float(b @ cho_solve(cho_factor(G), b))
        expected += 0.5 * X.shape[1]
    return gain, expected


def _features(bench: FreeRuns, seen: Mapping[str, Array]) -> Array:
    """(N, K) products of what is driven, each of unit size, at a few lags."""
    count = len(bench.measured)
    unit = {name: values / max(float(np.std(values)), 1e-9) for name, values in seen.items()}
    zero = np.zeros(count)
    v, a_y, a_x, r = (unit.get(name, zero) for name in ("v_x", "a_y", "a_x", "yaw_rate"))
    steer, drive = unit.get("steer", zero), unit.get("drive", zero)
    v = v - np.mean(v)
    rate = np.concatenate([np.gradient(steer[rows]) for rows in bench.rows])
    rate = rate / max(float(np.std(rate)), 1e-9)
    time = np.linspace(-1, 1, count)
    now = [
        np.ones(count), time, v, v * v, steer, rate, a_y, a_x, r, np.abs(a_y), np.abs(a_x), a_y * np.abs(a_y),
        a_x * np.abs(a_x), a_y * a_x, a_y * v, a_x * v, steer * v, drive, drive * v, np.sign(a_y), time * a_y,
        time * a_x, a_y**3,
    ]  # fmt: skip
    columns = [column for column in now if np.any(column)]
    for lag in CAL.lags[1:]:
        rows = min(max(1, round(lag / bench.sample_time)), count)
        columns += [
            np.concatenate([np.zeros(rows), own[: count - rows]]) for own in (steer, a_y, a_x, drive, r) if np.any(own)
        ]
    X = np.column_stack(columns)
    return np.asarray(X / np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-9))
