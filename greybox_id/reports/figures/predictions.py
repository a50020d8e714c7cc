"""Figures of predictions and measurements: traces, errors, horizons, residual correlations and spectra."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...base.numbers import pretty_unit
from ...base.shorthands import Array, Index
from ...base.statistics import NORMAL, correlation, welch
from ...engine.simulation import Prediction, breaks
from ...fitting.fit import Fit
from ...fitting.scores.metrics import FREE_RUN, ahead
from ...models.model import Model
from ..recordings import Noise, Seen, run_rows, typical_stretch
from .sheet import (
    BLUE,
    DASHED,
    DOTTED,
    INK,
    MEASURED,
    NOISE,
    ORANGE,
    PALE,
    ZERO,
    Look,
    Sheet,
    band,
    boxes,
    label,
    look,
    sheet_of,
    signal_label,
    symbol,
)

DRAWN_HORIZON = 0.5
"""Horizon that is drawn in addition to the free run, s."""

PROTOCOL_LINES = {
    "honest": look(ORANGE, 1.0, "one sample ahead"),
    "published": look(PALE, 1.0, "as published", dashes=DOTTED),
    "closed_loop": look(BLUE, 1.1, "closed loop", dashes=DASHED),
    ahead(DRAWN_HORIZON): look(ORANGE, 1.0, ahead(DRAWN_HORIZON)),
    FREE_RUN: look(BLUE, 1.1, FREE_RUN, dashes=DASHED),
}
"""Protocol of `greybox_id.fitting.scores.metrics` -> line."""
TALL, TALLEST, LOW = 130.0, 400.0, 62.0
"""Height of the panels of one output, largest height of all panels, and then least height per output, points."""
GAP = 1.5
"""Lines break at steps between rows that are larger than this multiple of the median step."""
DENSE = 0.5
"""Share of rows with readings above which a signal is drawn as a line with gaps, and otherwise as dots."""


def traces(one: Seen, tallest: float = TALLEST) -> Sheet:
    """Every output over a typical stretch of a recording: measured, predicted in each protocol, and residuals.

    Parameters
    ----------
    one : the recording.
    tallest : height of all panels, points, unless labels need more.
    """
    start, stop = typical_stretch(one)
    each = max(min(TALL, tallest / len(one.outputs)), LOW)
    sheet = Sheet((0.64 * each, 0.36 * each) * len(one.outputs), joined=True)
    for k, name in enumerate(one.outputs):
        above, below = sheet.grid[2 * k : 2 * k + 2, 0]
        reach = 1.15 * (_trace(above, below, one, k, start, stop) or 1.0)
        above.set_ylabel(_stacked(signal_label(one.recording, name)))
        below.set(ylabel=_stacked(label("error", one.recording.unit(name))), ylim=(-reach, reach))
    sheet.grid[-1, 0].set(xlabel="time [s]", xlim=one.recording.time[[start, stop - 1]])
    return sheet


def _stacked(words: str) -> str:
    """A label with its unit on a separate line, since panels are low."""
    return words.replace(" [", "\n[")


def _trace(above: Axes, below: Axes, one: Seen, k: int, start: int, stop: int) -> float:
    """Draw measurement, predictions and errors of one output; returns the largest error."""
    read = one.recording[one.outputs[k]][start:stop]
    above.plot(one.recording.time[start:stop], read, **MEASURED | _dotted(read))
    below.axhline(0.0, **ZERO)
    largest = 0.0
    for protocol, prediction in one.predicted.items():
        if protocol not in PROTOCOL_LINES or protocol == "published":  # the latter differs only where runs meet
            continue
        line = PROTOCOL_LINES[protocol]
        inside = (prediction.rows >= start) & (prediction.rows < stop)
        rows, shown = prediction.rows[inside], prediction.predicted[inside, k]
        at = one.recording.time[rows]
        above.plot(*_with_gaps(rows, at, shown), **line)
        error = shown - prediction.measured[inside, k]
        below.plot(*_with_gaps(rows, at, error), **line | _dotted(read))
        largest = max(largest, float(np.max(np.abs(error[np.isfinite(error)]), initial=0.0)))
    return largest


def _dotted(read: Array) -> Look:
    """Dots instead of a line for sparse readings."""
    return (
        {}
        if np.mean(np.isfinite(read)) > DENSE
        else {"linestyle": "", "marker": "o", "markersize": 2.4, "markeredgewidth": 0}
    )


def _with_gaps(rows: Index, at: Array, values: Array) -> tuple[Array, Array]:
    """Times and values with NaN inserted where rows are missing."""
    steps = np.diff(rows)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1 if len(steps) else np.empty(0, dtype=np.intp)
    return np.insert(at, gaps, np.nan), np.insert(values, gaps, np.nan)


MOST_RUNS = 6
"""Most runs of a recording that are shown separately."""
WIDE, APART = 0.19, 0.24
"""Width of a box, and distance between boxes of one group."""

_ROLES = {"train": "training", "validate": "validation"}


def errors(fit: Fit, recordings: Sequence[Seen]) -> Sheet:
    """Prediction minus measurement; boxes contain half of the samples, whiskers 95 %."""
    groups = _groups(recordings)
    sheet = Sheet((84.0,) * len(fit.model.outputs), joined=True)
    for k, (ax, name) in enumerate(zip(sheet.grid[:, 0], fit.model.outputs, strict=True)):
        _boxes(ax, recordings, groups, k)
        ax.set_ylabel(f"error of {label(name, recordings[0].recording.unit(name))}")
    ax.set(xlabel="recording and run [number]", xlim=(-0.6, len(groups) - 0.4))
    ax.set_xticks(range(len(groups)), [words for words, _, _ in groups])
    return sheet


Groups = Sequence[tuple[str, Seen, int | None]]


def _boxes(ax: Axes, recordings: Sequence[Seen], groups: Groups, output: int) -> None:
    ax.axhline(0.0, **ZERO)
    ax.grid(visible=False, axis="x")
    for n in range(1, len(groups)):
        if groups[n][1] is not groups[n - 1][1]:
            ax.axvline(n - 0.5, **look(PALE, 0.6, dashes=DOTTED))
    for protocol in (p for p in PROTOCOL_LINES if p in recordings[0].predicted):
        at, samples = [], []
        for n, (_, one, run) in enumerate(groups):
            shown = [p for p in PROTOCOL_LINES if p in one.predicted and (run is None or p != "published")]
            if protocol in shown:
                at.append(n + (shown.index(protocol) - (len(shown) - 1) / 2) * APART)
                samples.append(_residuals(one, protocol, run, output))
        colour, words = (PROTOCOL_LINES[protocol][name] for name in ("color", "label"))
        boxes(ax, at, samples, colour, WIDE, words)


def _groups(recordings: Sequence[Seen]) -> Groups:
    """Label, recording, and number of the run or None for the whole recording, of each group of boxes."""
    groups: list[tuple[str, Seen, int | None]] = []
    for one in recordings:
        groups.append((f"{_ROLES.get(one.role, one.role)},\nall runs", one, None))
        numbers = [number for number, _ in run_rows(one, "honest")]
        if 1 < len(numbers) <= MOST_RUNS:
            groups += [(f"run {number}", one, number) for number in numbers]
    return groups


def _residuals(one: Seen, protocol: str, run: int | None, output: int) -> Array:
    parts = dict(run_rows(one, protocol))
    part = one.predicted[protocol] if run is None else parts[run]
    residuals: Array = part.predicted[:, output] - part.measured[:, output]
    return residuals


ONE_ROW, COLUMNS = 4, 3
"""Most panels in a single row, and panels per row otherwise."""

LINES = {
    "train": look(BLUE, 0.9, "model, training", dashes=DASHED, dots=1.6),
    "validate": look(BLUE, 1.5, "model, validation", dots=1.6),
}
"""Role -> line."""
HELD = {
    "train": look(ORANGE, 0.9, "persistence, training", dashes=DASHED, dots=1.6),
    "validate": look(ORANGE, 1.5, "persistence, validation", dots=1.6),
}

Scores = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Role -> protocol -> output -> {rmse, rmse_sd}."""


def horizons(model: Model, outputs: Sequence[str], value: Scores, held: Scores, noise: Mapping[str, float]) -> Sheet:
    """RMSE with its standard error over the horizon and in free run, a panel per output.

    Parameters
    ----------
    model, outputs : the model, and its outputs in order.
    value, held : errors of the model and of persistence.
    noise : output -> standard deviation of the residuals of the fit.
    """
    protocols = list(dict.fromkeys(protocol for of_role in value.values() for protocol in of_role))
    sheet, axes = sheet_of(len(outputs), len(outputs) if len(outputs) <= ONE_ROW else COLUMNS, 108.0)
    for ax, name in zip(axes, outputs, strict=True):
        if name in noise:
            ax.axhline(noise[name], **NOISE | {"label": "residuals of the fit, sd"})
        if FREE_RUN in protocols[1:]:
            ax.axvline(protocols.index(FREE_RUN) - 0.5, **ZERO)
        for lines, scores in ((HELD, held), (LINES, value)):
            for role, of_role in scores.items():
                _over_horizons(ax, of_role, protocols, name, lines[role])
        ax.set(xlabel="horizon [s]", xlim=(-0.35, len(protocols) - 0.65), ylabel=label("RMSE", model.unit(name)),
               yscale="log", title=symbol(name))  # fmt: skip
        ax.set_xticks(range(len(protocols)), [_tick(protocol) for protocol in protocols])
    return sheet


def _over_horizons(
    ax: Axes, scores: Mapping[str, Mapping[str, Any]], protocols: Sequence[str], name: str, line: Look
) -> None:
    """One curve over the horizons, with a separate point for the free run."""
    at = np.array([k for k, protocol in enumerate(protocols) if name in scores.get(protocol, {})], dtype=float)
    errors = [scores[protocols[int(k)]][name] for k in at]
    rmse = np.array([error["rmse"] for error in errors])
    sd = np.array([error["rmse_sd"] if math.isfinite(error["rmse_sd"]) else 0.0 for error in errors])
    free = np.array([protocols[int(k)] == FREE_RUN for k in at], dtype=bool)
    ax.plot(at[~free], rmse[~free], **line)
    ax.plot(at[free], rmse[free], **line | {"linestyle": "", "label": None})
    ax.vlines(at, rmse - sd, rmse + sd, color=line["color"], linewidth=0.7)


def _tick(protocol: str) -> str:
    return "free" if protocol == FREE_RUN else protocol.removesuffix(" s ahead")


SECONDS, MOST = 2.0, 200
"""Largest lag, s, and most lags in samples."""
SHORTEST = 8
"""Least number of rows of a stretch without gap."""
MOST_INPUTS = 2

Parts = list[tuple[Array, Array]]


def residual_correlations(one: Seen, inputs: Sequence[str]) -> Sheet | None:
    """Correlations of each output's residuals over lags, and with inputs; None if stretches are too short.

    Bands contain 95 % of the correlations of two unrelated signals; for residuals with inputs they allow for the
    autocorrelation of both (Bartlett).
    """
    step = one.recording.sample_time
    most = max(2, min(round(SECONDS / step), MOST))
    driven = [name for name in inputs if name in one.recording and name not in one.outputs][:MOST_INPUTS]
    tested = {k: value for k in range(len(one.outputs)) if (value := _protocols(one, k))}
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
    """Protocol -> stretches of an output's residuals, for protocols that are drawn."""
    result = {protocol: _parts(one, protocol, k, None) for protocol in PROTOCOL_LINES if protocol != "published"}
    return {protocol: parts for protocol, parts in result.items() if parts}


def _with_itself(ax: Axes, result: dict[str, Parts], lags: Array) -> None:
    half = NORMAL / np.sqrt(sum(len(a) for a, _ in next(iter(result.values())))) * np.ones(2)
    band(ax, lags[[0, -1]], -half, half, PALE, "95 % band of unrelated signals", 0.4)
    ax.axhline(0.0, **ZERO)
    for protocol, parts in result.items():
        ax.plot(lags, correlation(parts, len(lags) - 1), **PROTOCOL_LINES[protocol])
    ax.set(xlim=(0.0, lags[-1]), ylim=(-0.4, 1.05))
    ax.set_yticks((0.0, 0.5, 1.0), ("0", "0.5", "1"))


def _with_input(ax: Axes, one: Seen, k: int, name: str, lags: Array) -> None:
    """Correlation of residuals of the main protocol with an input; at lags right of zero they follow the input."""
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
    """Standard deviation of the correlation of two unrelated signals, each of them autocorrelated."""
    product = correlation([(a, a) for a, _ in parts], most) * correlation([(b, b) for _, b in parts], most)
    counted = sum(len(a) for a, _ in parts)
    return float(np.sqrt(max(1.0 + 2.0 * np.nansum(product[1:]), 1.0) / counted))


def _parts(one: Seen, protocol: str, k: int, name: str | None) -> Parts:
    """Stretches of residuals without gap, paired with themselves or an input."""
    if protocol not in one.predicted:
        return []
    result = one.predicted[protocol]
    residual = result.predicted[:, k] - result.measured[:, k]
    other = residual if name is None else one.recording[name][result.rows]
    finite = np.flatnonzero(np.isfinite(residual) & np.isfinite(other))
    stretches = np.split(finite, breaks(result.rows[finite], result.run[finite]))
    return [(residual[p], other[p]) for p in stretches if len(p) >= SHORTEST]


LONGEST = 256
"""Longest Hamming window, samples, as in the papers; shorter if the runs are."""
SHORTEST_PART = 16
"""Least number of samples of a stretch for a spectrum."""
BELOW = 0.01
"""End of the axis relative to the median of the lowest curve: the spectrum of a filtered channel has no lower limit."""


def spectrum(one: Seen, noise: Noise | None) -> Sheet | None:
    """Spectra of every output of one recording, and of its noise if measured.

    Welch's method within stretches of readings without gap, Hamming windows that overlap by half. None if no stretch
    is long enough.
    """
    rate = 1.0 / one.recording.sample_time
    main = one.predicted[one.main]
    shown = [k for k in range(len(one.outputs)) if _unbroken(main, main.measured[:, k])]
    if not shown:
        return None
    columns = len(shown) if len(shown) <= ONE_ROW else COLUMNS
    sheet, axes = sheet_of(len(shown), columns, 130.0 if len(shown) < COLUMNS else 105.0)
    for ax, k in zip(axes, shown, strict=True):
        _densities(ax, one, k, noise, rate)
    return sheet


def _densities(ax: Axes, one: Seen, k: int, noise: Noise | None, rate: float) -> None:
    lowest = np.inf
    for line, parts in _curves(one, k, noise):
        frequency, density = psd(parts, rate)
        typical = float(np.median(density[1:]))
        if typical * BELOW > np.finfo(float).tiny:  # a constant channel has no spectrum
            ax.plot(frequency[1:], density[1:], **line)
            lowest = min(lowest, typical)
    unit = pretty_unit(one.recording.unit(one.outputs[k]))
    ax.set(
        xlabel="frequency [Hz]", ylabel=f"PSD of {symbol(one.outputs[k])} [({unit})²/Hz]", xscale="log", yscale="log"
    )
    ax.set_xlim(right=round(rate / 2, 6))  # includes a tick at the end
    ax.set_ylim(bottom=lowest * BELOW if np.isfinite(lowest) else None)


def _curves(one: Seen, k: int, noise: Noise | None) -> list[tuple[Look, Sequence[Array]]]:
    """The curves of one output: line and stretches of values without gap."""
    first = one.predicted[one.main] if "honest" not in one.predicted else one.predicted["honest"]
    curves: list[tuple[Look, Sequence[Array]]] = [(MEASURED, _unbroken(first, first.measured[:, k]))]
    for protocol, item in one.predicted.items():
        if protocol in PROTOCOL_LINES and protocol != "published":
            line = PROTOCOL_LINES[protocol]
            errors = _unbroken(item, item.predicted[:, k] - item.measured[:, k])
            curves.append((line | {"label": f"residual, {line['label']}"}, errors))
    if noise is not None and noise.of(one.outputs[k]):
        curves.append((NOISE | {"label": f"noise, {noise.where}"}, noise.of(one.outputs[k])))
    return [curve for curve in curves if curve[1]]


def _unbroken(of: Prediction, values: Array) -> list[Array]:
    """Stretches of finite values in consecutive rows of one run that are long enough."""
    finite = np.flatnonzero(np.isfinite(values))
    stretches = np.split(finite, breaks(of.rows[finite], of.run[finite]))
    return [values[part] for part in stretches if len(part) >= SHORTEST_PART]


def psd(parts: Sequence[Array], rate: float) -> tuple[Array, Array]:
    """Welch's spectrum averaged over stretches: frequency in Hz, one-sided density per Hz.

    The window is the largest power of two such that stretches of at least its length contain half of the samples;
    shorter stretches are left out.
    """
    lengths = np.sort([len(part) for part in parts])[::-1]
    filled = lengths[np.searchsorted(np.cumsum(lengths), lengths.sum() / 2)]
    length = min(LONGEST, 2 ** int(np.log2(filled)))
    total, weight, frequency = np.zeros(length // 2 + 1), 0, np.zeros(length // 2 + 1)
    for part in parts:
        if len(part) >= length:
            segments = (len(part) - length // 2) // (length - length // 2)
            frequency, density = welch(part, rate, length)
            total, weight = total + segments * density, weight + segments
    return frequency, np.maximum(total / weight, np.finfo(float).tiny)
