"""Residual analysis: their correlation with themselves and with what drove the vehicle, with bands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ...parameter import Array
from ...statistics import correlation
from ..recordings import Seen
from .sheet import Sheet, band
from .style import INK, PALE, PROTOCOL_LINES, ZERO, look, symbol

SECONDS, MOST = 2.0, 200
"""Lags reach so far, in so many samples at most."""
SHORTEST = 8
"""Rows without a gap that count."""
MOST_INPUTS = 2
NORMAL = 1.96

Parts = list[tuple[Array, Array]]


def residual_correlations(one: Seen, inputs: Sequence[str]) -> Sheet | None:
    """For each output, correlations of its residuals over lags, and with inputs; None where stretches are too short.

    Bands hold 95 % of the correlations of two unrelated signals; of residuals with inputs they allow for the
    correlation of each with itself (Bartlett).
    """
    step = one.recording.sample_time
    most = max(2, min(round(SECONDS / step), MOST))
    driven = [name for name in inputs if name in one.recording and name not in one.outputs][:MOST_INPUTS]
    tested = {k: own for k in range(len(one.outputs)) if (own := _protocols(one, k))}
    if not tested:
        return None
    sheet = Sheet((52.0,) * len(tested), 1 + len(driven), joined=True)
    lags = np.arange(most + 1.0) * step
    for axes, (k, parts) in zip(sheet.grid, tested.items(), strict=True):
        _with_itself(axes[0], parts, lags)
        axes[0].set_ylabel(f"{symbol(one.outputs[k])} [1]")
        for ax, name in zip(axes[1:], driven, strict=True):
            _with_input(ax, one, k, name, lags)
    for ax, title in zip(sheet.grid[0], ("with itself", *(f"with {symbol(name)}" for name in driven)), strict=True):
        ax.set_title(title)
    for ax in sheet.grid[-1]:
        ax.set_xlabel("lag [s]" if ax is sheet.grid[-1, 0] else "lag behind the input [s]")
    return sheet


def _protocols(one: Seen, k: int) -> dict[str, Parts]:
    """Of every protocol that is drawn, the stretches of an output's residuals."""
    found = {protocol: _parts(one, protocol, k, None) for protocol in PROTOCOL_LINES if protocol != "published"}
    return {protocol: parts for protocol, parts in found.items() if parts}


def _with_itself(ax: Axes, found: dict[str, Parts], lags: Array) -> None:
    half = NORMAL / np.sqrt(sum(len(a) for a, _ in next(iter(found.values())))) * np.ones(2)
    band(ax, lags[[0, -1]], -half, half, PALE, "95 % band of unrelated signals", 0.4)
    ax.axhline(0.0, **ZERO)
    for protocol, parts in found.items():
        ax.plot(lags, correlation(parts, len(lags) - 1), **PROTOCOL_LINES[protocol])
    ax.set(xlim=(0.0, lags[-1]), ylim=(-0.4, 1.05))
    ax.set_yticks((0.0, 0.5, 1.0), ("0", "0.5", "1"))


def _with_input(ax: Axes, one: Seen, k: int, name: str, lags: Array) -> None:
    """Residuals of the main protocol after (right of zero) and before an input."""
    parts, most = _parts(one, one.main, k, name), len(lags) - 1
    ax.axhline(0.0, **ZERO)
    ax.axvline(0.0, **look(INK, 0.4))
    if parts:
        after, before = correlation(parts, most), correlation([(b, a) for a, b in parts], most)
        half = NORMAL * _bartlett(parts, most) * np.ones(2)
        band(ax, lags[[-1, -1]] * (-1.0, 1.0), -half, half, PALE, opacity=0.4)
        at = np.concatenate([-lags[:0:-1], lags])
        ax.plot(at, np.concatenate([before[:0:-1], after]), **PROTOCOL_LINES[one.main])
    ax.set(xlim=(-lags[-1], lags[-1]), ylim=(-1.05, 1.05))
    ax.set_yticks((-1.0, 0.0, 1.0), ("−1", "0", "1"))


def _bartlett(parts: Parts, most: int) -> float:
    """Standard deviation of the correlation of two unrelated signals, each correlated with itself."""
    own = correlation([(a, a) for a, _ in parts], most) * correlation([(b, b) for _, b in parts], most)
    counted = sum(len(a) for a, _ in parts)
    return float(np.sqrt(max(1.0 + 2.0 * np.nansum(own[1:]), 1.0) / counted))


def _parts(one: Seen, protocol: str, k: int, name: str | None) -> Parts:
    """Unbroken stretches of residuals, beside themselves or an input."""
    if protocol not in one.predicted:
        return []
    found = one.predicted[protocol]
    residual = found.predicted[:, k] - found.measured[:, k]
    other = residual if name is None else one.recording[name][found.rows]
    known = np.flatnonzero(np.isfinite(residual) & np.isfinite(other))
    edges = np.flatnonzero((np.diff(found.rows[known]) != 1) | (np.diff(found.run[known]) != 0)) + 1
    return [(residual[p], other[p]) for p in np.split(known, edges) if len(p) >= SHORTEST]
