"""A clock that runs in uneven steps: stamps of receipt are regressed on the row, true ones are laid on an even grid.

Loggers stamp rows when they receive them: by turns 8 and 2 ms apart, or eight rows of one USB packet at once. The rows
were sampled evenly nevertheless. Others write a row whenever one of several sensors has spoken; their stamps are true.
The values tell which: where a row's stamp is d ahead of its place in an even grid, a value that was read at its stamp
departs from its neighbours by slope · d, one that was read evenly does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..base.numbers import exact
from ..base.shorthands import Array
from ..base.signals import COMMANDS
from .clocks import held, linear
from .recording import JITTER_TOLERANCE, Resampled

BROKEN = 0.02
"""Share of steps that leave the usual one from which a clock is uneven; fewer are gaps and joins."""
WINDOW = 32
"""Rows over which the mean step is taken, the median of which is the usual one."""
SHORTEST = 50
"""Rows of a stretch from which its step is told."""
GAP = 10.0
"""Usual steps, and three of the longest ones that recur, beyond which rows are lost."""
BOUNDED = 3.0
"""Usual steps, and as many of the longest ones that recur, that a stamp of receipt is ahead or behind at most."""
SURE = 2.0
"""Standard deviations."""
ROUNDING = 1e-3
"""Share of the usual step below which stamps are the same."""
AT_ONCE = 0.2
"""Share of the usual step below which rows came in one packet."""


@dataclass(frozen=True)
class Evened:
    """Rows on an even clock.

    Attributes
    ----------
    time : (m,) s.
    signals : name -> (m,).
    rows : (m,) the row of the file that each is taken from, or follows.
    resampled : how signals came onto the grid, where rows were not kept.
    note : what was done.
    """

    time: Array
    signals: Mapping[str, Array]
    rows: np.ndarray[tuple[int], np.dtype[np.int64]]
    resampled: Mapping[str, Resampled]
    note: str


def evened(time: Array, signals: Mapping[str, Array], hold: str, keep_rows: bool = False) -> Evened | None:
    """Rows of an uneven clock on an even one; None where the clock is even enough, or nothing can be told.

    Parameters
    ----------
    time : (n,) s, as stamped.
    signals : name -> (n,) values of the rows.
    hold : "zero" holds commands between rows, "linear" takes them as measured.
    keep_rows : True only regresses; what would have to be laid on a grid is None.
    """
    if len(time) < 2 * SHORTEST or not np.isfinite(time).all():
        return None
    steps = np.diff(time)
    ahead = steps[steps >= 0]
    step = float(np.median((time[WINDOW:] - time[:-WINDOW]) / WINDOW))
    if step <= 0 or not ahead.size:
        return None
    recurring = float(np.quantile(ahead, 0.99))
    gap = max(GAP * step, 3 * recurring)
    inside = (steps >= -ROUNDING * step) & (steps < gap)
    usual = float(np.median(steps))
    if np.mean((np.abs(steps - usual) > JITTER_TOLERANCE * max(usual, 0.0)) & inside) <= BROKEN:
        return None
    edges = [0, *(np.flatnonzero(~inside) + 1).tolist(), len(time)]
    parts = [(a, b) for a, b in zip(edges, edges[1:], strict=False) if b - a >= SHORTEST]
    if sum(b - a for a, b in parts) < (1 - BROKEN) * len(time):
        return None
    lines = [np.polyfit(np.arange(b - a), time[a:b], 1) for a, b in parts]
    behind = np.concatenate(
        [time[a:b] - np.polyval(line, np.arange(b - a)) for (a, b), line in zip(parts, lines, strict=True)]
    )
    bounded = float(np.quantile(np.abs(behind), 0.999)) <= BOUNDED * max(step, recurring)
    share, sd = _share_of_stamps(time, signals, parts, step, max(3, int(np.ceil(2 * recurring / step))))
    packets = bool(np.mean(steps[inside] < AT_ONCE * step) > 0.5 or np.any(steps[inside] <= ROUNDING * step))
    of_receipt = share + SURE * sd < 0.5 or (packets and not share - SURE * sd > 0.5)
    if bounded and of_receipt:
        return _regressed(time, signals, parts, lines, share, sd, packets)
    return (
        None
        if keep_rows or bool(np.any(steps[inside] <= ROUNDING * step))
        else _on_a_grid(time, signals, parts, step, hold)
    )


def _share_of_stamps(
    time: Array, signals: Mapping[str, Array], parts: list[tuple[int, int]], step: float, half: int
) -> tuple[float, float]:
    """The factor on slope · (stamp - even place) that explains the values best, 1 where stamps are true; and its sd."""
    from scipy.signal import savgol_filter  # which takes longer to load than most files to read

    moments = np.zeros(2)
    for values in signals.values():
        sums, count = np.zeros(3), 0
        for a, b in parts:
            run = values[a:b]
            if b - a <= 2 * half + 1 or not np.isfinite(run).all() or np.ptp(run) == 0:
                continue
            scaled = (run - np.mean(run)) / np.std(run)
            smooth, slope = (savgol_filter(scaled, 2 * half + 1, 2, deriv=item) for item in (0, 1))
            ahead = (time[a:b] - savgol_filter(time[a:b], 2 * half + 1, 2)) / step
            left, due = (scaled - smooth)[half:-half], (slope * ahead)[half:-half]
            sums += [left @ due, due @ due, left @ left]
            count += len(left)
        if count and sums[1] > 0 and sums[2] > 0:
            noise = max(sums[2] - sums[0] ** 2 / sums[1], 1e-12 * count) / count
            moments += sums[:2] / noise
    if moments[1] <= 0:
        return 0.5, np.inf
    return float(moments[0] / moments[1]), float(1 / np.sqrt(moments[1]))


def _regressed(
    time: Array, signals: Mapping[str, Array], parts: list[tuple[int, int]], lines: list[Array], share: float,
    sd: float, packets: bool,
) -> Evened:  # fmt: skip
    """Each stretch at its even step; rows outside of all stretches are left out."""
    rows = np.concatenate([np.arange(a, b) for a, b in parts])
    even = np.concatenate([np.polyval(line, np.arange(b - a)) for (a, b), line in zip(parts, lines, strict=True)])
    step = float(np.median([line[0] for line in lines]))
    why = (
        "rows came in packets"
        if packets
        else f"values follow the row number, not the time stamp (share {share:.2f} ± {sd:.2f})"
    )
    note = (
        f"stamps are uneven ({_span(time)}), and {why}: time is regressed on the row, {exact(step)} s a row "
        f"({1 / step:.4g} Hz)."
    )
    return Evened(even, {name: values[rows] for name, values in signals.items()}, rows, {}, note)


def _on_a_grid(
    time: Array, signals: Mapping[str, Array], parts: list[tuple[int, int]], step: float, hold: str
) -> Evened:
    """Values at their stamps, laid on an even grid of the mean step: straight lines between them."""
    grids, rows, columns = [], [], {name: list[Array]() for name in signals}
    costs: dict[str, tuple[float, float]] = {}
    for a, b in parts:
        grid = time[a] + step * np.arange(1 + int((time[b - 1] - time[a]) / step * (1 + 1e-12)))
        grids.append(grid)
        rows.append(a + np.clip(np.searchsorted(time[a:b], grid, side="right") - 1, 0, b - a - 1))
        for name, values in signals.items():
            join = held if name in COMMANDS and hold == "zero" else linear
            result, cost = join(time[a:b], values[a:b], grid, name)
            columns[name].append(result)
            costs[name] = max(costs.get(name, (0.0, 0.0)), cost)
    how = {
        name: Resampled("held" if name in COMMANDS and hold == "zero" else "linear", "its own stamps", 1 / step, *cost)
        for name, cost in costs.items()
    }
    note = f"rows are uneven in time ({_span(time)}): laid on an even grid of {exact(step)} s ({1 / step:.4g} Hz)."
    return Evened(
        np.concatenate(grids),
        {name: np.concatenate(column) for name, column in columns.items()},
        np.concatenate(rows),
        how,
        note,
    )


def _span(time: Array) -> str:
    low, high = np.quantile(np.diff(time), (0.05, 0.95))
    return f"steps of {1e3 * low:.3g} to {1e3 * high:.3g} ms"
