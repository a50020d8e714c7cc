"""What residuals still tell: their correlation with themselves and with what drove the vehicle, with bands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameter import Array
from ..plot.figure import Figure, Panel
from ..plot.marks import Band, Curve, Mark, Rule
from ..plot.palette import INK, PALE, Line
from ..plot.scale import Axis
from ..recordings import Seen
from ..spectra import correlation
from .style import PROTOCOL_LINES, symbol

SECONDS, MOST = 2.0, 200
"""Lags reach so far, in so many samples at most."""
SHORTEST = 8
"""Rows without a gap that count."""
MOST_INPUTS = 2
NORMAL = 1.96

Parts = list[tuple[Array, Array]]


def residual_correlations(one: Seen, inputs: Sequence[str]) -> Figure | None:
    """For each output, correlations of its residuals over lags, and with inputs; None where stretches are too short.

    Bands hold 95 % of the correlations of two unrelated signals; of residuals with inputs they allow for the
    correlation of each with itself (Bartlett).
    """
    step = one.recording.sample_time
    most = max(2, min(round(SECONDS / step), MOST))
    driven = [name for name in inputs if name in one.recording and name not in one.outputs][:MOST_INPUTS]
    rows = [_row(one, k, driven, most) for k in range(len(one.outputs))]
    found = [row for row in rows if row is not None]
    if not found:
        return None
    titles = ["with itself", *(f"with {symbol(name)}" for name in driven)]
    first = tuple(Panel(p.marks, p.x, p.y, title) for p, title in zip(found[0], titles, strict=True))
    return Figure((first, *found[1:]), (52.0,) * len(found), joined=True)


def _row(one: Seen, k: int, driven: Sequence[str], most: int) -> tuple[Panel, ...] | None:
    lags = np.arange(most + 1.0) * one.recording.sample_time
    marks: list[Mark] = [Rule(0.0)]
    for protocol, line in PROTOCOL_LINES.items():
        parts = _parts(one, protocol, k, None)
        if protocol == "published" or not parts:
            continue
        own = correlation(parts, most)
        if len(marks) == 1:
            half = NORMAL / np.sqrt(sum(len(a) for a, _ in parts)) * np.ones(2)
            marks.insert(0, Band(lags[[0, -1]], -half, half, PALE, "95 % band of unrelated signals", 0.4))
        marks.append(Curve(lags, own, line))
    if len(marks) < 3:
        return None
    y = Axis(f"{symbol(one.outputs[k])} [1]", -0.4, 1.05, ticks=((0.0, "0"), (0.5, "0.5"), (1.0, "1")))
    x = Axis("lag [s]", 0.0, float(lags[-1]))
    return (Panel(tuple(marks), x, y), *(_with_input(one, k, name, most, lags) for name in driven))


def _with_input(one: Seen, k: int, name: str, most: int, lags: Array) -> Panel:
    """Residuals of the main protocol after (right of zero) and before an input."""
    parts = _parts(one, one.main, k, name)
    at = np.concatenate([-lags[:0:-1], lags])
    marks: list[Mark] = [Rule(0.0), Rule(0.0, Line(INK, width=0.4), upright=True)]
    if parts:
        after = correlation(parts, most)
        before = correlation([(b, a) for a, b in parts], most)
        spread = _bartlett(parts, most)
        half = NORMAL * spread * np.ones(2)
        marks.insert(0, Band(at[[0, -1]], -half, half, PALE, shade=0.4))
        marks.append(Curve(at, np.concatenate([before[:0:-1], after]), PROTOCOL_LINES[one.main]))
    y = Axis("", -1.05, 1.05, ticks=((-1.0, "−1"), (0.0, "0"), (1.0, "1")))
    return Panel(tuple(marks), Axis("lag behind the input [s]", float(at[0]), float(at[-1])), y)


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
